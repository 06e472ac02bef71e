"""Teacher and student on terrain: who sees the ground, who trains which encoder, and a resume on a course."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from actuators import pd_net
from rollouts import phase_runner
from stiction.core.errors import StictionError
from stiction.files.actuator import FILE, write_actuator
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.learning.models import StudentPolicy
from stiction.learning.phase import PhaseRunner
from stiction.learning.run import Interrupted, RunDirectory, latest_checkpoint, load_checkpoint, save_checkpoint
from stiction.learning.runner import train
from stiction.task.config import TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg
from stiction.task.terrain import TerrainCfg

CFG = TrainCfg(
    task=TaskCfg(
        robot="go1",
        terrain=TerrainCfg(kind="mixed"),
        friction=FrictionCfg("iterative", level=0.1, stages=2),
    ),
    network=NetworkCfg(
        actor=(16,), critic=(16,), privileged=(8,), history_frame=4, history=(8,), terrain=(8,), terrain_latent=5
    ),
    teacher=TeacherCfg(iterations=4, steps=4, epochs=1, mini_batches=2, alternate=2),
    student=StudentCfg(iterations=2, steps=4, epochs=1, mini_batches=2),
    num_envs=6,
    checkpoint_every=1,
)


@pytest.fixture(autouse=True)
def one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bits depend on the number of threads."""
    monkeypatch.setenv("STICTION_THREADS", "1")
    torch.manual_seed(0)


def phase(tmp_path: Path, name: str, cfg: TrainCfg = CFG) -> PhaseRunner:
    """A runner of one phase, on mixed ground."""
    return phase_runner(cfg, tmp_path, name)


def test_the_teacher_sees_the_ground_and_the_student_does_not(tmp_path: Path) -> None:
    """A student that peeks at the elevation map climbs in training and nowhere else."""
    teacher, student = phase(tmp_path, "teacher").alg, phase(tmp_path, "student").alg
    student.warm_start(teacher.get_policy().state_dict(), {})
    obs = phase(tmp_path, "teacher").env.get_observations()
    other = obs.clone()
    for name in ("elevation", "privileged", "explicit"):
        other[name] = other[name] + 1.0
    assert torch.equal(student.student(obs), student.student(other))
    torch.testing.assert_close(StudentPolicy(student.student)(obs["history"]), student.student(obs))
    other = obs.clone()
    other["elevation"] = other["elevation"] + 1.0
    assert not torch.equal(teacher.actor(obs), teacher.actor(other))
    assert not torch.equal(teacher.critic(obs), teacher.critic(other))
    assert not torch.equal(student.teacher(obs), student.teacher(other))


@pytest.mark.parametrize("terrain_loss", [True, False])
def test_the_history_learns_the_ground_from_its_loss_or_from_cloning(tmp_path: Path, terrain_loss: bool) -> None:
    """L_hist = MSE(e_t*, f_hist(o_H)) trains f_hist in both phases; without it the first leaves it as it began."""
    cfg = replace(CFG, network=replace(CFG.network, terrain_loss=terrain_loss))
    teacher, student = phase(tmp_path, "teacher", cfg), phase(tmp_path, "student", cfg)
    actor, obs = teacher.alg.actor, teacher.env.get_observations()
    losses = actor.supervised_losses(obs)
    assert ("terrain" in losses) == terrain_loss
    if terrain_loss:
        error = actor.terrain_history(obs["history"]) - actor.terrain_encoder(obs["elevation"])
        torch.testing.assert_close(losses["terrain"], error.square().sum() / error.numel())
    first = [p.detach().clone() for p in actor.terrain_history.parameters()]
    figures = teacher.iterate()
    moved = [p.detach().clone() for p in actor.terrain_history.parameters()]
    assert ("loss/terrain" in figures) == terrain_loss
    assert any(not torch.equal(a, b) for a, b in zip(first, moved, strict=True)) == terrain_loss
    student.alg.warm_start(actor.state_dict(), {})
    assert ("loss/terrain" in student.iterate()) == terrain_loss
    now = student.alg.student.terrain_history.parameters()
    assert any(not torch.equal(a, b) for a, b in zip(moved, now, strict=True))


def test_a_run_on_terrain_that_is_stopped_everywhere_is_the_same_run(tmp_path: Path) -> None:
    """In every stage of the schedule and on every course: parameters bit for bit."""
    whole, parts = (RunDirectory.create(tmp_path / name, CFG, "c", None) for name in ("whole", "parts"))
    train(CFG, whole)
    stops = 0
    while not parts.finished:
        try:
            train(CFG, parts, interrupted=lambda: True)
        except Interrupted:
            stops += 1
    assert stops == 5 and [row["friction/stage"] for row in parts.rows()] == [0.0, 0.0, 1.0, 2.0, 2.0, 2.0]
    left, right = (
        load_checkpoint(latest_checkpoint(run.checkpoints, "student"))["algorithm"]["student_state_dict"]
        for run in (whole, parts)
    )
    assert all(torch.equal(value, right[name]) for name, value in left.items())


def test_a_run_from_before_terrain_goes_on_and_another_state_is_one_line(tmp_path: Path) -> None:
    """A night's training on flat ground would be lost to a newer version; what does not fit must say so."""
    cfg = replace(CFG, task=replace(CFG.task, terrain=TerrainCfg(), friction=FrictionCfg("deception", level=0.1)))
    run = RunDirectory.create(tmp_path / "run", cfg, "c", None)
    with pytest.raises(Interrupted):
        train(cfg, run, interrupted=lambda: True)
    path = latest_checkpoint(run.checkpoints, "teacher")
    assert path is not None
    tree = load_checkpoint(path)
    for name in ("stage", "course", "ground", "motors"):
        del tree["environment"][name]
    save_checkpoint(path, tree)
    with pytest.raises(Interrupted, match="iteration 2"):
        train(cfg, run, interrupted=lambda: True)
    path = latest_checkpoint(run.checkpoints, "teacher")
    assert path is not None
    tree = load_checkpoint(path)
    del tree["environment"]["history"]
    save_checkpoint(path, tree)
    with pytest.raises(StictionError, match=r"cannot be restored.*'history'.*train again$"):
        train(cfg, run)


def test_a_policy_is_trained_on_an_actuator_net_on_stairs(tmp_path: Path) -> None:
    """Teacher and student, to the end: a net of torque behind the gear moves the robots, and no friction beside it."""
    write_actuator(tmp_path / "net" / FILE, pd_net("go1", torque_source="output_side"))
    task = replace(CFG.task, terrain=TerrainCfg(kind="stairs"), friction=FrictionCfg("none"))
    cfg = replace(CFG, task=task, actuator=str(tmp_path / "net"))
    run = RunDirectory.create(tmp_path / "run", cfg, "c", None)
    train(cfg, run)
    rows = run.rows()
    assert [row["phase"] for row in rows] == ["teacher"] * 4 + ["student"] * 2
    assert all(math.isfinite(value) for row in rows for value in row.values() if isinstance(value, float))
    env = LocomotionEnv(cfg.task, 4, seed=0, actuator=run.actuator())
    for _ in range(3):
        env.step(torch.zeros(4, env.num_actions))
    assert env.motors is not None and env.motors.holds_friction
    assert env.fleet.torque.any() and not env.fleet.friction.any() and not env.fleet.damping.any()
