"""DreamWaQ as a method of the trainer: its runs, resumed and exported, its symmetry, its options, its name."""

from __future__ import annotations

import contextlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from rollouts import phase_runner, rollout
from stiction.core.errors import ConfigurationError
from stiction.deploy.policy import Network
from stiction.evaluation.export import contract_of, export_run, write_card
from stiction.evaluation.newest import LatentPolicy
from stiction.evaluation.policies import method_of, method_texts
from stiction.learning.arguments import parse
from stiction.learning.begin import begin_run
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.learning.run import Interrupted, RunDirectory, latest_checkpoint, load_checkpoint
from stiction.learning.runner import load_actor, load_student, train
from stiction.task.config import TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg
from stiction.task.rewards import RewardCfg
from stiction.task.symmetry import task_mirror
from stiction.view.simulation import plain_name
from stiction_experiments.methods.dreamwaq import DreamWaQCfg

CFG = TrainCfg(
    task=TaskCfg(
        robot="go1",
        episode=0.2,
        friction=FrictionCfg("dreamwaq", level=0.2, range=(0.0, 1.2), per="joint"),
        rewards=RewardCfg(track_linear=20.0),  # of a loss nobody would be bootstrapped
    ),
    network=NetworkCfg(actor=(16, 8), critic=(16,), history_frame=4, history=(8,)),
    method_settings=DreamWaQCfg(code=4, frame=4, encoder=(8,), decoder=(8,)),
    teacher=TeacherCfg(latent="history", iterations=9, steps=4, epochs=2, mini_batches=2),
    student=StudentCfg(iterations=0),
    num_envs=8,
)
FRICTIONLESS = replace(CFG, task=replace(CFG.task, friction=FrictionCfg("dreamwaq", level=0.2)))
HEADER = {"command": "stiction train", "revision": "abc1234", "identified": None}


@pytest.fixture(autouse=True)
def one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bits depend on the number of threads."""
    monkeypatch.setenv("STICTION_THREADS", "1")


def start(folder: Path, cfg: TrainCfg = CFG) -> RunDirectory:
    """A new run."""
    return RunDirectory.create(folder, cfg, "stiction train --method dreamwaq", None)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> RunDirectory:
    """A run that nobody disturbed, in which episodes end and others begin."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STICTION_THREADS", "1")
        run = start(tmp_path_factory.mktemp("whole") / "run")
        train(CFG, run)
    return run


def rows_of(run: RunDirectory) -> list[dict]:
    """Every figure that does not depend on the clock."""
    clocked = ("seconds", "rollout_seconds", "env_steps_per_second")
    return [{name: value for name, value in row.items() if name not in clocked} for row in run.rows()]


def test_a_run_that_is_stopped_everywhere_is_the_same_run(tmp_path: Path, whole: RunDirectory) -> None:
    """Draws, returns and who is fed what survive a resume: parameters and figures bit for bit."""
    cut = start(tmp_path / "run")
    while not cut.finished:
        with contextlib.suppress(Interrupted):
            train(CFG, cut, interrupted=lambda: True)
    kept = [load_checkpoint(latest_checkpoint(run.checkpoints, "teacher"))["algorithm"] for run in (whole, cut)]
    for part in ("actor_state_dict", "critic_state_dict"):
        assert all(torch.equal(value, kept[1][part][name]) for name, value in kept[0][part].items())
    returns, again = (one["bootstrapping"] for one in kept)
    assert returns["known"].any() and all(torch.equal(returns[k], again[k]) for k in ("last", "known", "bootstrapped"))
    assert rows_of(cut) == rows_of(whole)


def test_what_a_run_says_of_its_code(whole: RunDirectory) -> None:
    """KL, active dimensions, the prediction beside repeating, and each joint's friction; in every row, all finite."""
    joints = {f"code/friction/{name}" for name in LocomotionEnv(CFG.task, 1, 0).spec.joint_names}
    names = {"code/kl", "code/active", "code/reconstruction", "code/repeat", "bootstrap/probability", "bootstrap/share"}
    names |= {"loss/estimator", "loss/reconstruction", "loss/code", "estimator/velocity_error"} | joints
    for row in whole.rows():
        assert names <= row.keys() and "latent/explained" not in row and "estimator/contact_error" not in row
        assert all(np.isfinite(row[name]) for name in names)
    assert {row["bootstrap/share"] for row in whole.rows()} != {0.0}


def test_the_exported_network_is_the_trained_one(tmp_path: Path, whole: RunDirectory) -> None:
    """To 1e-6, on what the robot observes: the code's mean and the estimated velocity, and no draw."""
    check = export_run(whole.path, tmp_path / "bundle")
    contract = check.bundle.contract
    assert check.action_error < 1e-6 and check.steps >= 500
    assert (contract.method, contract.phases, contract.friction_range) == ("dreamwaq", 1, (0.0, pytest.approx(0.24)))
    student, actor = load_student(whole), load_actor(whole, "student")
    env = LocomotionEnv(CFG.task, 64, 3)
    for _ in range(5):
        obs = env.step(torch.randn(64, 12))[0]
    network = Network(check.bundle.policy, contract.observation.size, 12, estimates=True)
    expected = student(obs["history"]).detach()
    np.testing.assert_allclose(network(obs["history"].numpy()), expected.numpy(), atol=1e-6, rtol=1e-6)
    torch.testing.assert_close(expected, actor(obs), atol=1e-6, rtol=0)
    torch.testing.assert_close(LatentPolicy(actor)(obs["history"]), expected, atol=1e-6, rtol=0)
    assert "DreamWaQ's actor" in check.bundle.card


def anything(env: LocomotionEnv) -> TensorDict:
    """Observations that no robot has, of the right sizes."""
    sizes = {name: value.shape for name, value in env.get_observations().items()}
    return TensorDict({name: torch.randn(shape) for name, shape in sizes.items()}, [env.num_envs])


def test_the_symmetric_context_is_mirrored(tmp_path: Path) -> None:
    """Velocity with the reflection, code and prediction with theirs, the action as ever."""
    runner = phase_runner(replace(CFG, symmetry="network"), tmp_path)
    rollout(runner)
    runner.alg.update()
    mirror, obs, actor = task_mirror(runner.env), anything(runner.env), runner.alg.actor
    image = mirror(obs)
    seen, other = actor.context(obs["history"]), actor.context(image["history"])
    torch.testing.assert_close(other.velocity, seen.velocity * torch.tensor([1.0, -1.0, 1.0]), atol=1e-6, rtol=0)
    for name in ("mean", "log_variance"):
        torch.testing.assert_close(getattr(other, name), getattr(seen, name).roll(2, -1), atol=1e-6, rtol=0)
    guesses = [actor.context.predict(one.velocity, one.mean) for one in (seen, other)]
    torch.testing.assert_close(guesses[1], mirror.group("proprioception")(guesses[0]), atol=1e-6, rtol=0)
    torch.testing.assert_close(actor(image), mirror.action(actor(obs)), atol=1e-6, rtol=0)


@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("--method dreamwaq --set dreamwaq.code=5", "dreamwaq.code is 5"),
        ("--method dreamwaq --set dreamwaq.decoder=[8,5]", r"dreamwaq.decoder\[1\] is 5"),
        ("--method none --set network.latent=5", "network.latent is 5"),
        ("--method none --set network.latent=4 --set network.history=[5]", r"network.history\[0\] is 5"),
        ("--method hinf --set network.critic=[5]", r"network.critic\[0\] is 5"),
    ],
)
def test_an_odd_layer_has_no_halves(words: str, name: str) -> None:
    """One line that says which size, and what would do, before there is a folder."""
    with pytest.raises(ConfigurationError, match=f"{name}, and a layer of 5 units has no left and right half"):
        parse(words.split())
    parse([*words.split(), "--symmetry", "half"])


@pytest.mark.parametrize(
    "words",
    [
        "--method dreamwaq --set dreamwaq.decoder=[]",
        "--method hinf --set hinf.actor=[]",
        "--method none --set network.critic=[]",
    ],
)
def test_a_network_without_hidden_layers_is_refused(words: str) -> None:
    """Not an error of an index, which would be called a fault of the program."""
    with pytest.raises(ConfigurationError, match=r"has 0 layers; expected 1 to 10"):
        parse(words.split())


@pytest.mark.parametrize("symmetry", ["batches", "half"])
def test_images_walk_on_their_own_context(symmetry: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The code of an image is that of the mirrored history by the original's draw; so is what follows it."""
    runner = phase_runner(replace(CFG, symmetry=symmetry), tmp_path)
    runner.alg.bootstrapped = (torch.arange(8) % 2.0)[:, None]
    rollout(runner)
    actor, mirror = runner.alg.actor, task_mirror(runner.env)
    obs = runner.alg.storage.observations.flatten(0, 1)
    both, _ = runner.alg.symmetry.with_images(runner.env, obs, torch.zeros(len(obs), 12))
    original, image = both[: len(obs)], both[len(obs) :]
    context = actor.context(image["history"])
    torch.testing.assert_close(image["guess"], context.code(original["noise"]), atol=1e-6, rtol=0)
    truth = original["explicit"][:, :3] * torch.tensor([1.0, -1.0, 1.0])
    expected = torch.where(original["bootstrapped"] > 0, context.velocity, truth)
    torch.testing.assert_close(image["estimate"], expected, atol=1e-6, rtol=0)
    mixed, _ = runner.alg.symmetry.supervised(obs)
    first = mirror.group("proprioception")(obs["next"][:1])
    torch.testing.assert_close(mixed["next"][:1], first, atol=1e-6, rtol=0)
    assert torch.equal(mixed["lasts"][:1], obs["lasts"][:1])
    assert len(mixed) == len(obs) * (2 if symmetry == "batches" else 1)
    assert np.isfinite(list(runner.alg.update().values())).all()


def test_the_method_alone_makes_a_run(tmp_path: Path) -> None:
    """`--method dreamwaq` is all that has to be said: the preset leaves out what its context takes the place of."""
    cfg = parse(["--method", "dreamwaq", "--friction-level", "0.2", "--preset", "quick"]).config
    assert cfg.method.name == "dreamwaq" and not cfg.task.estimated_friction and cfg.teacher.iterations == 440
    assert not cfg.task.friction.has_friction and cfg.task.friction.last.range == (0.0, 0.0)
    assert cfg.method_settings == DreamWaQCfg(beta=0.35, free_bits=0.05, code=16)
    messages: list[str] = []
    begin_run(tmp_path / "run", replace(cfg, num_envs=8), "stiction train", (), messages.append)
    assert messages == ["dreamwaq trains without dry friction, as in its paper; with: --task.friction.range 0 1.2"]
    words = ["--method=dreamwaq", "--friction-level", "0", "--set", "dreamwaq.beta=0.1"]
    begin_run(tmp_path / "level", replace(parse(words).config, num_envs=8), "stiction train")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--method dreamwaq --preset two-phase", "learns in one phase.*--preset full or quick"),
        ("--method dreamwaq --student.iterations 5", "learns in one phase"),
        ("--method dreamwaq --set network.latent=8", "--set network.latent requires another --method"),
        ("--method dreamwaq --set task.estimated_friction=true", "--set task.estimated_friction requires another"),
        ("--method dreamwaq --set teacher.velocity_weight=3", "--set teacher.velocity_weight requires another"),
        ("--method deception --set dreamwaq.beta=1", "--set dreamwaq.beta requires --method dreamwaq"),
        ("--method dreamwaq --set dreamwaq.beta=-1", "dreamwaq.beta is -1.0; expected at least 0"),
        ("--method dreamwaq --set dreamwaq.code=0", "dreamwaq.code is 0; expected at least 1"),
        ("--method dreamwaq --task.known-friction", "known_friction with the method 'dreamwaq'"),
    ],
)
def test_options_that_contradict_the_method_are_refused(words: str, message: str) -> None:
    """In one line, before any folder is made."""
    with pytest.raises(ConfigurationError, match=message):
        parse(words.split())


def test_its_name_says_whether_it_met_friction() -> None:
    """Two methods in every table: as in its paper, and with friction, which is no method of its paper."""
    plain, aware = (contract_of(cfg, HEADER) for cfg in (FRICTIONLESS, CFG))
    assert (method_of(plain), method_of(aware)) == ("dreamwaq", "dreamwaq-friction")
    assert {"dreamwaq", "dreamwaq-friction"} <= method_texts().keys()
    assert plain_name(plain) == "dreamwaq: trained without friction"
    assert plain_name(aware) == "dreamwaq: trained at 0 to 24 % friction"
    assert "0 to 0.24 of the torque limit" in write_card(aware)


def test_a_run_from_before_methods_were_installed_is_read(tmp_path: Path) -> None:
    """Its config.json had the groups of all methods: the one of the run's method counts."""
    run = start(tmp_path / "run")
    file = run.path / "config.json"
    header = json.loads(file.read_text())
    settings = header["config"].pop("method_settings")
    header["config"] |= {"dreamwaq": settings, "hinf": {"disturber": "force", "limit": None}}
    file.write_text(json.dumps(header))
    assert run.config() == CFG
    header["config"]["task"]["friction"] |= {"method": "deception"}
    file.write_text(json.dumps(header))
    assert run.config().method_settings is None
