"""Settings have bounds, and memory is computed before it is taken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from stiction.core import memory
from stiction.core.decode import from_plain
from stiction.core.errors import StictionError
from stiction.core.memory import check_memory, free_memory
from stiction.core.provenance import num_threads, stream_seed
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.grid import GridCfg
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.report.terminal import jobs_of
from stiction.task.config import RandomizationCfg, TaskCfg

NAN, HUGE = float("nan"), 10**400


@pytest.mark.parametrize(
    "make",
    [
        lambda: TrainCfg(teacher=TeacherCfg(learning_rate=NAN)),
        lambda: TrainCfg(student=StudentCfg(learning_rate=float("inf"))),
        lambda: TrainCfg(teacher=TeacherCfg(gamma=1.5)),
        lambda: TrainCfg(num_envs=10**6),
        lambda: TrainCfg(seed=HUGE),
        lambda: TrainCfg(network=NetworkCfg(actor=(10**9,))),
        lambda: TaskCfg(decimation=10**6),
        lambda: TaskCfg(timestep=4e-9),
        lambda: TaskCfg(action_clip=NAN),
        lambda: RandomizationCfg(damping=(0.0, float("inf"))),
        lambda: EvaluationCfg(episodes=10**9),
        lambda: GridCfg(EvaluationCfg(episodes=10_000), robots=tuple(range(1000, 1100)), engines=("physx+all",)),
        lambda: jobs_of(2 * 10**9),
        lambda: stream_seed(HUGE, "x"),
    ],
)
def test_what_cannot_be_meant_is_refused(make: Callable[[], object]) -> None:
    """It would fill the memory, never end, or train a network of no numbers."""
    with pytest.raises(StictionError) as told:
        make()
    assert len(str(told.value)) < 400


@pytest.mark.parametrize("text", ["2000000000", "1025", "9" * 5000, "0", "1e3"])
def test_threads_are_bounded(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two thousand million of them would take the machine down before the first step."""
    monkeypatch.setenv("STICTION_THREADS", text)
    with pytest.raises(StictionError, match="at most 1024"):
        num_threads()


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("num_envs",), HUGE, "num_envs is a huge integer; expected a number"),
        (("teacher", "learning_rate"), HUGE, "learning_rate is a huge integer; expected a finite number"),
        (("network", "actor"), [8, "x"], r"actor\[1\] is 'x'; expected a whole number"),
        (("task", "commands", "forward"), [1.0], "forward is .*; expected a list of 2"),
        (("task", "robot"), ["go1"], "robot is .*; expected text"),
        (("task",), 3, "task is 3; expected the fields of TaskCfg"),
        (("other",), 3, "TrainCfg has no field 'other'"),
    ],
)
def test_a_setting_of_another_type_is_named(path: tuple[str, ...], value: object, message: str) -> None:
    """A file of somebody else's would fail far from here, with a traceback."""
    import json

    plain = json.loads(json.dumps(asdict(TrainCfg())))
    assert from_plain(TrainCfg, plain) == TrainCfg()
    inner = plain
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    with pytest.raises(StictionError, match=message):
        from_plain(TrainCfg, plain)


def test_memory_is_that_of_machine_container_and_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The least of the three decides: 3 GB are available, the container has 1.5 of 2 GB left."""
    (tmp_path / "meminfo").write_text("MemTotal: 8000000 kB\nMemAvailable: 3000000 kB\n")
    monkeypatch.setattr(memory, "MEMINFO", tmp_path / "meminfo")
    monkeypatch.setattr(memory, "GROUP", tmp_path)
    assert free_memory() == 3_000_000 * 1024
    (tmp_path / "memory.max").write_text("2000000000\n")
    (tmp_path / "memory.current").write_text("500000000\n")
    assert free_memory() == 1_500_000_000
    check_memory(1.4e9, "this", "ask for less")
    with pytest.raises(StictionError, match=r"this needs about 1\.6 GB of memory, 1\.5 GB are free; ask for less"):
        check_memory(1.6e9, "this", "ask for less")


def test_the_memory_of_a_training_grows_with_what_it_holds() -> None:
    """As measured: 548 MB for 512 robots of Saturn Lite over 24 steps, 1011 MB with 51 frames in place of 11."""
    from stiction.robots.catalog import find_robot

    robot, needed = find_robot("saturn_lite"), []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("stiction.learning.config.check_memory", lambda size, what, remedy: needed.append(size / 1e6))
        for cfg in (TrainCfg(), replace(TrainCfg(), task=TaskCfg(history=51))):
            cfg.check_memory(robot)
    assert needed == [pytest.approx(548, rel=0.15), pytest.approx(1011, rel=0.15)]
