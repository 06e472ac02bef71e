"""A viewer beside a training: the newest checkpoint walks, a newer one takes over, and the viewer ends with it."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the extra train")

from stiction.core.errors import StictionError
from stiction.deploy.observation import Sensors
from stiction.evaluation.export import TrainedPolicy
from stiction.evaluation.newest import NewestPolicy
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.learning.run import RunDirectory
from stiction.learning.runner import load_student, train
from stiction.task.config import TaskCfg
from stiction.task.friction import FrictionCfg
from stiction.view import companion
from stiction.view.companion import watching
from stiction.view.simulation import Simulation, viewed

CFG = TrainCfg(
    task=TaskCfg(robot="go1", friction=FrictionCfg("deception", level=0.1)),
    network=NetworkCfg(actor=(8,), critic=(8,), privileged=(8,), history_frame=4, history=(8,), latent=3),
    teacher=TeacherCfg(iterations=1, steps=4, epochs=1, mini_batches=2),
    student=StudentCfg(iterations=1, steps=4, epochs=1, mini_batches=2),
    num_envs=2,
    checkpoint_every=1,
)


def test_the_robot_stands_until_there_is_a_checkpoint_and_walks_on_with_each(tmp_path: Path) -> None:
    """Stands without a checkpoint, then acts as the training's newest or chosen student or teacher."""
    directory = RunDirectory.create(tmp_path / "run", CFG, "stiction train", None)
    with pytest.raises(StictionError, match="has no checkpoint yet; wait for it with --follow"):
        NewestPolicy(directory.path)
    run = NewestPolicy(directory.path, wait=True)
    assert run.name == "run: no checkpoint yet, standing" and not run.refresh()
    simulation = Simulation([viewed(run)], run.robot)
    simulation.set_velocity((0.0, 0.0, 0.0))
    walker = simulation.walkers[0]
    simulation.step()
    assert walker.seen.step is not None
    np.testing.assert_array_equal(walker.seen.step.policy.target, run.contract.array("standing"))

    train(CFG, directory)
    assert run.refresh() and not run.refresh() and run.name == "run: student 000001"
    walker.teach(viewed(run))
    simulation.step()
    step = walker.seen.step
    assert np.abs(step.policy.target - run.contract.array("standing")).max() > 1e-6
    alone = TrainedPolicy(load_student(directory), run.contract)
    sensors: Sensors = step.before.sensors.each(lambda value: value[None])
    np.testing.assert_array_equal(alone.step(sensors, np.zeros((1, 3))).action[0], step.policy.action)

    assert run.checkpoints == ("newest", "student_000001", "teacher_000001")
    run.choose("teacher_000001")
    assert run.name == "run: teacher 000001" and not run.refresh(), "an older checkpoint stays chosen"
    with pytest.raises(StictionError, match=r"unknown checkpoint '\.\./config'"):
        run.choose("../config")
    run.choose("newest")
    assert run.name == "run: student 000001"
    assert walker.rewards is not None and {"track_linear", "torque"} <= walker.rewards.values.keys()

    for file in directory.checkpoints.glob("student_*"):
        file.unlink()
    teacher = NewestPolicy(directory.path)
    assert teacher.name == "run: teacher 000001"
    simulation = Simulation([viewed(teacher)], teacher.robot)
    simulation.step()
    assert np.isfinite(simulation.walkers[0].seen.step.policy.action).all()


def child(monkeypatch: pytest.MonkeyPatch, program: str) -> None:
    """Let a program of Python stand for the viewer."""
    monkeypatch.setattr(companion, "python_module", lambda module, words: [sys.executable, "-c", program])


def test_a_viewer_that_fails_costs_one_line_and_no_training(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Prints one line of a viewer that fails, and lets the training go on."""
    child(monkeypatch, "import sys; print('stiction view: no port is free', file=sys.stderr); sys.exit(1)")
    printed: list[str] = []
    with watching(tmp_path, printed.append) as process:
        assert process.wait(60) == 1
        trained = True
    assert trained and printed == ["stiction view: no port is free"]
