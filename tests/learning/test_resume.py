"""A run that is cut off anywhere goes on to the same bits, keeps its last good checkpoint, and ends where it should."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.learning import phase
from stiction.learning import run as checkpoint
from stiction.learning.config import NetworkCfg, StopCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.learning.phase import PhaseRunner, film_due
from stiction.learning.ppo import AdaptationPPO
from stiction.learning.run import Interrupted, RunDirectory, latest_checkpoint, load_checkpoint
from stiction.learning.runner import train
from stiction.task.config import TaskCfg
from stiction.task.friction import FrictionCfg

CFG = TrainCfg(
    task=TaskCfg(robot="go1", friction=FrictionCfg("iterative", level=0.1, stages=2)),
    network=NetworkCfg(actor=(8,), critic=(8,), privileged=(8,), history_frame=4, history=(8,), latent=3),
    teacher=TeacherCfg(iterations=5, steps=4, epochs=1, mini_batches=2, alternate=2),
    student=StudentCfg(iterations=3, steps=4, epochs=1, mini_batches=2),
    num_envs=2,
    checkpoint_every=2,
)


class Killed(BaseException):
    """Stands for kill -9: nothing catches it."""


@pytest.fixture(autouse=True)
def one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bits depend on the number of threads."""
    monkeypatch.setenv("STICTION_THREADS", "1")


def start(folder: Path, cfg: TrainCfg = CFG) -> RunDirectory:
    """A new run."""
    return RunDirectory.create(folder, cfg, "stiction train", None)


def results(run: RunDirectory) -> tuple[dict[str, torch.Tensor], list[dict]]:
    """The student's last parameters, and every figure that does not depend on the clock."""
    newest = latest_checkpoint(run.checkpoints, "student")
    assert newest is not None
    clocked = ("seconds", "rollout_seconds", "env_steps_per_second")
    rows = [{name: value for name, value in row.items() if name not in clocked} for row in run.rows()]
    return load_checkpoint(newest)["algorithm"]["student_state_dict"], rows


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, torch.Tensor], list[dict]]:
    """The results of a run that nobody disturbed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STICTION_THREADS", "1")
        run = start(tmp_path_factory.mktemp("whole") / "run")
        train(CFG, run)
    return results(run)


def assert_same(run: RunDirectory, whole: tuple[dict[str, torch.Tensor], list[dict]]) -> None:
    """Parameters and figures, bit for bit."""
    parameters, rows = results(run)
    assert parameters.keys() == whole[0].keys()
    assert all(torch.equal(parameters[name], value) for name, value in whole[0].items())
    assert rows == whole[1]
    assert run.finished


def dies(call: Callable, count: int, after: bool = False) -> Callable:
    """`call` that is killed at its `count`-th time, before or after its work."""
    calls = 0

    def wrapped(*args, **kwargs):
        nonlocal calls
        calls += 1
        if calls == count and not after:
            raise Killed
        result = call(*args, **kwargs)
        if calls == count:
            raise Killed
        return result

    return wrapped


MOMENTS = {
    "before the first iteration": (PhaseRunner, "iterate", 1, False),
    "in the teacher's fourth iteration": (PhaseRunner, "iterate", 4, False),
    "between the teacher's last figures and its checkpoint": (PhaseRunner, "_preserve", 5, False),
    "between the files of the second checkpoint": (checkpoint, "write_json", 2, False),
    "between the files of the student's first checkpoint": (checkpoint, "write_json", 4, False),
    "after the teacher's last checkpoint": (phase, "keep_newest", 3, True),
    "in the student's first iteration": (PhaseRunner, "iterate", 6, False),
    "after the student's first figures": (RunDirectory, "log", 6, True),
    "after the last iteration": (RunDirectory, "finish", 1, False),
}


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_kill_at_any_moment_changes_nothing(moment: str, tmp_path: Path, monkeypatch, whole) -> None:
    """A night's training must not be lost, or be a different one, because a machine went down at a bad moment."""
    owner, name, count, after = MOMENTS[moment]
    run = start(tmp_path / "run")
    with monkeypatch.context() as patch:
        patch.setattr(owner, name, dies(getattr(owner, name), count, after))
        with pytest.raises(Killed):
            train(CFG, run)
    assert not run.finished
    train(CFG, RunDirectory(run.path))
    assert_same(run, whole)


def test_a_run_that_is_asked_to_stop_does_so_with_a_checkpoint(tmp_path: Path, whole) -> None:
    """After every single iteration: each stop says how to go on, and the sum of the parts is the whole."""
    run = start(tmp_path / "run")
    stops = []
    while not run.finished:
        try:
            train(CFG, run, interrupted=lambda: True)
        except Interrupted as stop:
            stops.append(str(stop))
            assert f"--resume {run.path}" in str(stop)
    assert [text[:40].partition(" of ")[0] for text in stops] == [
        f"stopped after iteration {n}" for n in (1, 2, 3, 4, 5, 1, 2)
    ]
    assert_same(run, whole)


def test_a_phase_that_reached_its_target_ends_and_stays_ended(tmp_path: Path, monkeypatch) -> None:
    """The teacher in the second iteration of its last stage, the student in its second; resumed or not."""
    stop = StopCfg(tracking_error=100.0, iterations=2, falls=100.0)
    cfg = replace(CFG, stop=stop, teacher=replace(CFG.teacher, iterations=8))
    run = start(tmp_path / "whole", cfg)
    summary = train(cfg, run)
    assert {name: stop["iteration"] for name, stop in summary["stopped"].items()} == {"teacher": 8, "student": 2}
    assert summary["env_steps"] == (8 + 2) * 4 * 2
    again = start(tmp_path / "killed", cfg)
    with monkeypatch.context() as patch:
        patch.setattr(RunDirectory, "finish", dies(RunDirectory.finish, 1))
        with pytest.raises(Killed):
            train(cfg, again)
    train(cfg, again)
    assert_same(again, results(run))
    assert again.summary()["stopped"] == summary["stopped"]
    again.check_finished("student")


def test_a_diverged_run_leaves_its_last_good_checkpoint(tmp_path: Path, monkeypatch) -> None:
    """NaN in the parameters shows in no loss of that iteration, and would be saved."""
    run = start(tmp_path / "run")
    update = AdaptationPPO.update

    def poisoned(self: AdaptationPPO) -> dict[str, float]:
        losses = update(self)
        if self.iteration == 4:
            with torch.no_grad():
                next(self.actor.mlp.parameters()).fill_(float("nan"))
        return losses

    monkeypatch.setattr(AdaptationPPO, "update", poisoned)
    with pytest.raises(StictionError, match=r"iteration 4 of the teacher.*parameters.*teacher_000002\.safetensors"):
        train(CFG, run)
    assert latest_checkpoint(run.checkpoints, "teacher") == run.checkpoints / "teacher_000002.safetensors"


def test_what_looks_ill_does_not_replace_what_is_well(tmp_path: Path, monkeypatch) -> None:
    """Simulations blow up from iteration 3 on, the verdict comes after five: checkpoints 3 to 6 are not written."""
    cfg = replace(CFG, checkpoint_every=1, teacher=replace(CFG.teacher, iterations=9))
    run = start(tmp_path / "run", cfg)
    iterate = PhaseRunner.iterate

    def ill(self: PhaseRunner) -> dict[str, float]:
        figures = iterate(self)
        return figures | ({"walk/blown_up": 2.0} if self.current_learning_iteration >= 2 else {})

    monkeypatch.setattr(PhaseRunner, "iterate", ill)
    with pytest.raises(StictionError, match=r"iteration 7 of the teacher, since iteration 3.*--set task\.timestep"):
        train(cfg, run)
    kept = sorted(path.stem for path in run.checkpoints.glob("*.safetensors"))
    assert kept == ["teacher_000001", "teacher_000002"]


def test_a_full_disk_is_one_line(tmp_path: Path, monkeypatch) -> None:
    """No traceback, and the way on."""
    run = start(tmp_path / "run")

    def full(self: RunDirectory, row: dict) -> None:
        raise OSError(28, "No space left on device", str(self.metrics))

    monkeypatch.setattr(RunDirectory, "log", full)
    with pytest.raises(StictionError, match=r"No space left on device.*--resume"):
        train(CFG, run)


@pytest.mark.parametrize(
    ("iteration", "every", "last", "due"),
    [
        (100, 100, False, True),
        (50, 100, False, False),
        (350, 100, True, True),
        (340, 100, True, False),
        (4, 100, True, False),
        (80, 100, True, True),
        (100, 0, True, False),
    ],
)
def test_clips_are_made_regularly_and_of_the_end(iteration: int, every: int, last: bool, due: bool) -> None:
    """The last policy is the one that people want to see, but not twice in a row."""
    assert film_due(iteration, every, last) is due


@pytest.mark.parametrize("recorded", [True, False])
def test_other_matrix_products_are_named_where_a_run_goes_on(
    recorded: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """They round otherwise, and so they do behind a checkpoint from before there were fast ones, which names none."""
    run = start(tmp_path / "run")
    monkeypatch.setattr(phase, "gemm_path", lambda: "default")
    monkeypatch.setattr(PhaseRunner, "iterate", dies(PhaseRunner.iterate, 4))
    with pytest.raises(Killed):
        train(CFG, run)
    if not recorded:
        header = latest_checkpoint(run.checkpoints, "teacher").with_suffix(".json")
        tree = json.loads(header.read_text())
        tree["tree"]["__dict__"] = [entry for entry in tree["tree"]["__dict__"] if entry[0] != "gemm"]
        del tree["sha256"]  # nor digests
        header.write_text(json.dumps(tree))
    monkeypatch.setattr(phase, "gemm_path", lambda: "fast")
    monkeypatch.setattr(PhaseRunner, "iterate", dies(PhaseRunner.iterate, 1))
    with pytest.raises(Killed):
        main(["train", "--resume", str(run.path)])
    (warning,) = [line for line in capsys.readouterr().err.splitlines() if "matrix products" in line]
    assert warning.startswith("stiction train: warning: teacher_") and "numbers will differ" in warning
