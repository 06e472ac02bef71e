"""Networks symmetric by construction: π(M o) = M π(o) and V(M o) = V(o), in training, after it, and as exported."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from rollouts import phase_runner
from stiction.core.errors import StictionError
from stiction.deploy.policy import Network
from stiction.evaluation.export import export_network
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.learning.models import StudentPolicy
from stiction.learning.phase import PhaseRunner
from stiction.learning.run import Interrupted, RunDirectory
from stiction.learning.runner import load_actor, load_student, train
from stiction.learning.symmetry import EquivariantLinear, make_equivariant
from stiction.robots.physics import PhysicsCfg
from stiction.task.config import TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg
from stiction.task.symmetry import Rows, TaskMirror, task_mirror
from stiction.task.terrain import TerrainCfg

CFG = TrainCfg(
    task=TaskCfg(robot="go1", friction=FrictionCfg("deception", level=0.2, per="joint")),
    network=NetworkCfg(
        actor=(16, 8),
        critic=(16,),
        privileged=(8,),
        history_frame=4,
        history=(8,),
        latent=4,
        terrain=(8,),
        terrain_latent=4,
    ),
    teacher=TeacherCfg(iterations=2, steps=4, epochs=2, mini_batches=2, alternate=2),
    student=StudentCfg(iterations=2, steps=4, epochs=1, mini_batches=2),
    symmetry="network",
    num_envs=8,
)
ALONE = replace(
    CFG,
    task=replace(CFG.task, first_side=True, physics=PhysicsCfg("plastic-first", stiffness=100.0)),
    network=replace(CFG.network, latent=0),
    teacher=TeacherCfg(latent="history", iterations=4, steps=4, epochs=1, mini_batches=2),
    student=StudentCfg(iterations=0),
)
"""One phase without a latent, on sliders and then on rows."""
STAIRS = replace(CFG, task=replace(CFG.task, terrain=TerrainCfg(kind="stairs")))


@pytest.fixture(autouse=True)
def one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bits depend on the number of threads."""
    monkeypatch.setenv("STICTION_THREADS", "1")


def phase(tmp_path: Path, name: str, cfg: TrainCfg = CFG, **env: object) -> PhaseRunner:
    """A runner of one phase."""
    runner = phase_runner(cfg, tmp_path, name, LocomotionEnv(cfg.task, cfg.num_envs, seed=0, **env))
    if name == "student" and cfg.student.algorithm != "ppo":
        runner.alg.warm_start(runner.alg.teacher.state_dict(), {})
    return runner


def anything(env: LocomotionEnv) -> TensorDict:
    """Observations that no robot ever makes: symmetry must not rest on what is likely."""
    generator = torch.Generator().manual_seed(1)
    return env.get_observations().apply(lambda value: torch.randn(value.shape, generator=generator))


def check_actor(actor, mirror: TaskMirror, obs: TensorDict) -> None:
    """Mean action, estimate and latents of the image are the images of those of the original."""
    with torch.no_grad():
        image = mirror(obs)
        action = actor(obs)
        assert action.abs().max() > 0.1
        torch.testing.assert_close(actor(image), mirror.action(action), atol=1e-6, rtol=0)
        explicit = mirror.group("explicit")(actor.estimator(obs["history"]))
        torch.testing.assert_close(actor.estimator(image["history"]), explicit, atol=1e-6, rtol=0)


@pytest.mark.parametrize("cfg", [CFG, STAIRS], ids=["flat", "stairs"])
def test_a_teacher_is_symmetric_before_and_after_updates(tmp_path: Path, cfg: TrainCfg) -> None:
    """On z and on z*; the standard deviations of left and right stay equal; the critic values an image the same."""
    runner = phase(tmp_path, "teacher", cfg)
    mirror, obs = task_mirror(runner.env), anything(runner.env)
    actor, critic = runner.alg.actor, runner.alg.critic
    before = [parameter.detach().clone() for parameter in (*actor.parameters(), *critic.parameters())]
    for source in ("privileged", "history"):
        actor.latent_source = source
        check_actor(actor, mirror, obs)
        torch.testing.assert_close(critic(mirror(obs)), critic(obs), atol=1e-6, rtol=0)
        runner.iterate()
    check_actor(actor, mirror, obs)
    std = actor.distribution.std_param.detach()
    assert torch.equal(std, std[mirror.action.index]) and std.unique().numel() > 1
    after = (*actor.parameters(), *critic.parameters())
    assert not any(torch.equal(a, b) for a, b in zip(before, after, strict=True))


@pytest.mark.parametrize("cfg", [CFG, STAIRS], ids=["flat", "stairs"])
def test_a_student_is_symmetric(tmp_path: Path, cfg: TrainCfg) -> None:
    """Its labels, its blind latents and what distillation makes of it."""
    runner = phase(tmp_path, "student", cfg)
    mirror, obs = task_mirror(runner.env), anything(runner.env)
    for _ in range(2):
        check_actor(runner.alg.student, mirror, obs)
        check_actor(runner.alg.teacher, mirror, obs)
        policy = StudentPolicy(runner.alg.student)
        with torch.no_grad():
            image = policy(mirror.group("history")(obs["history"]))
            torch.testing.assert_close(image, mirror.action(policy(obs["history"])), atol=1e-6, rtol=0)
        runner.iterate()


def test_a_policy_without_a_latent_is_symmetric_and_exports(tmp_path: Path) -> None:
    """It sees the present frame and its estimates; of the history the estimator alone makes something."""
    run = RunDirectory.create(tmp_path / "run", ALONE, "c", None)
    train(ALONE, run)
    env = LocomotionEnv(ALONE.task, 8, seed=0)
    mirror, obs, actor = task_mirror(env), anything(env), load_actor(run, "student")
    check_actor(actor, mirror, obs)
    assert actor.mlp[0].in_features == obs["proprioception"].shape[1] + obs["explicit"].shape[1]
    student, size = load_student(run), obs["history"].shape[1]
    network = Network(export_network(student, size), size, 12)
    np.testing.assert_allclose(network(obs["history"].numpy()), student(obs["history"]).detach().numpy(), atol=1e-5)


def test_the_check_finds_an_ordinary_network(tmp_path: Path) -> None:
    """And a symmetric one of which one weight is not averaged."""
    plain = phase(tmp_path, "teacher", replace(CFG, symmetry="none"))
    mirror, obs = task_mirror(plain.env), anything(plain.env)
    with pytest.raises(AssertionError):
        check_actor(plain.alg.actor, mirror, obs)
    runner = phase(tmp_path, "teacher")
    actor = runner.alg.actor
    weight, bias = actor.mlp[0].averaged()
    actor.mlp[0] = torch.nn.Linear(weight.shape[1], weight.shape[0])
    with torch.no_grad():
        actor.mlp[0].weight.copy_(weight)
        actor.mlp[0].bias.copy_(bias)
        check_actor(actor, mirror, obs)
        actor.mlp[0].weight[0, 3] += 0.1
    with pytest.raises(AssertionError):
        check_actor(actor, mirror, obs)


def test_a_layer_by_hand() -> None:
    """Two inputs that are exchanged with opposite sign, one output that keeps its sign: ½ (w_1 - w_2) (x_1 - x_2)."""
    layer = torch.nn.Linear(2, 1)
    with torch.no_grad():
        layer.weight.copy_(torch.tensor([[3.0, 1.0]]) / 2**0.5)
        layer.bias.fill_(0.25)
    symmetric = EquivariantLinear(layer, Rows(np.array([1, 0]), np.array([-1.0, -1.0])), Rows.signed(np.ones(1)))
    seen = symmetric(torch.tensor([[2.0, 0.5]]))
    torch.testing.assert_close(seen, torch.tensor([[0.5 * (3.0 - 1.0) * (2.0 - 0.5) + 0.25]]))


def test_a_run_and_its_exported_student(tmp_path: Path) -> None:
    """A loaded checkpoint and its ONNX network are the symmetric policy that was trained."""
    run = RunDirectory.create(tmp_path / "run", STAIRS, "c", None)
    train(STAIRS, run)
    env = LocomotionEnv(STAIRS.task, 8, seed=0)
    mirror, obs = task_mirror(env), anything(env)
    for who in ("teacher", "student"):
        actor = load_actor(run, who)
        assert not any(isinstance(module, EquivariantLinear) for module in actor.modules())
        check_actor(actor, mirror, obs)
    student = load_student(run)
    size = obs["history"].shape[1]
    network = Network(export_network(student, size), size, 12)
    acted = network(obs["history"].numpy())
    np.testing.assert_allclose(acted, student(obs["history"]).detach().numpy(), atol=1e-5)
    image = network(mirror.group("history")(obs["history"]).numpy())
    np.testing.assert_allclose(image, mirror.action(torch.from_numpy(acted)).numpy(), atol=1e-6)


def test_one_worn_joint_is_answered_on_its_side(tmp_path: Path) -> None:
    """A symmetric policy is not one that treats both sides alike: a worn left joint alone moves both sides apart."""
    runner = phase(tmp_path, "teacher")
    env, mirror, actor = runner.env, task_mirror(runner.env), runner.alg.actor
    level = TensorDict({name: torch.zeros(3, value.shape[1]) for name, value in env.get_observations().items()}, [3])
    names = env.spec.joint_names
    level["privileged"][1, -12 + names.index("FL_calf_joint")] = 3.0
    level["privileged"][2, -12 + names.index("FR_calf_joint")] = 3.0
    with torch.no_grad():
        healthy, left, right = actor(level)
    torch.testing.assert_close(mirror.action(healthy), healthy, atol=1e-6, rtol=0)
    torch.testing.assert_close(mirror.action(left), right, atol=1e-6, rtol=0)
    assert (mirror.action(left) - left).abs().max() > 0.01


def test_a_symmetric_policy_has_a_first_step_on_either_side(tmp_path: Path) -> None:
    """In a pose that is its own mirror image: the same step on the other side, and none without the side."""
    cfg = replace(CFG, task=replace(CFG.task, first_side=True))
    runner = phase(tmp_path, "teacher", cfg)
    mirror, actor = task_mirror(runner.env), runner.alg.actor
    level = TensorDict({name: torch.zeros(2, v.shape[1]) for name, v in runner.env.get_observations().items()}, [2])
    level["proprioception"][:, -1] = torch.tensor([1.0, -1.0])
    with torch.no_grad():
        left, right = actor(level)
    torch.testing.assert_close(mirror.action(left), right, atol=1e-6, rtol=0)
    assert (mirror.action(left) - left).abs().max() > 0.01


@pytest.mark.parametrize("cfg", [replace(CFG, symmetry="half"), CFG, ALONE], ids=["half", "network", "rows at last"])
def test_a_run_that_is_stopped_everywhere_is_the_same_run(tmp_path: Path, cfg: TrainCfg) -> None:
    """Mirrored samples, the standard deviations of left and right, and the joints' physics resume bit by bit."""
    cfg = replace(cfg, checkpoint_every=1)
    whole, parts = (RunDirectory.create(tmp_path / name, cfg, "c", None) for name in ("whole", "parts"))
    train(cfg, whole)
    while not parts.finished:
        with contextlib.suppress(Interrupted):
            train(cfg, parts, interrupted=lambda: True)
    for name in ("teacher", "student"):
        left, right = (load_actor(run, name).state_dict() for run in (whole, parts))
        assert all(torch.equal(value, right[key]) for key, value in left.items())


def test_a_layer_without_a_left_half_is_refused(tmp_path: Path) -> None:
    """Seven units cannot be exchanged in pairs."""
    with pytest.raises(StictionError, match="a layer of 7 units has no left and right half"):
        phase(tmp_path, "teacher", replace(CFG, network=replace(CFG.network, actor=(7,))))


def test_a_part_without_a_rule_is_refused(tmp_path: Path) -> None:
    """A new encoder that stays as it is would break the symmetry without a word."""
    plain = phase(tmp_path, "teacher", replace(CFG, symmetry="none"))
    plain.alg.actor.gait = torch.nn.Linear(3, 3)
    with pytest.raises(StictionError, match="RMAActor: the layer 'gait' has no rule for --symmetry network"):
        make_equivariant(plain.alg.actor, task_mirror(plain.env))
    plain = phase(tmp_path, "teacher", replace(CFG, symmetry="none"))
    plain.alg.actor.gait = torch.nn.GRUCell(4, 4)
    with pytest.raises(StictionError, match="RMAActor: the layer 'gait'"):
        make_equivariant(plain.alg.actor, task_mirror(plain.env))
    with pytest.raises(StictionError, match="a recurrent encoder has no rule"):
        replace(CFG, network=replace(CFG.network, recurrent=True))  # before any folder is made
