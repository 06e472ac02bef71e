"""Progress: the time left of the whole run, and lines that a log file can keep."""

import io
from pathlib import Path

import pytest
from rich.console import Console

from stiction.cli.progress import Display, RunClock, busy_text, figures_line, processor_times
from stiction.learning.config import StudentCfg, TeacherCfg, TrainCfg
from stiction.robots.catalog import find_robot
from stiction.task.config import TaskCfg
from stiction.task.friction import FrictionCfg

CFG = TrainCfg(
    task=TaskCfg(friction=FrictionCfg("deception", level=0.2)),
    teacher=TeacherCfg(iterations=100, steps=24, epochs=4),
    student=StudentCfg(iterations=50, steps=12, epochs=2),
)
FIGURES = {
    "reward": 0.04,
    "walk/tracking_error": 0.171,
    "walk/tripod_share": 0.52,
    "walk/falls": 0.0,
    "friction/stage": 0.0,
    "friction/low": 0.0,
    "friction/high": 1.2,
    "env_steps_per_second": 5321.4,
    "rollout_seconds": 1.0,
    "seconds": 2.0,
}


def test_the_time_left_covers_both_phases() -> None:
    """Ten iterations of 2 s done of 100, and a student not yet measured: half the steps, (12/24)·2/5 of the passes.

    90·2 + 50·(0.5 + 1·0.2) = 215 s. Once the student is measured, its own rate counts.
    """
    clock = RunClock(CFG)
    for _ in range(10):
        clock.add("teacher", FIGURES)
    assert clock.remaining("teacher", 10) == pytest.approx(215.0)
    clock.add("student", FIGURES | {"seconds": 3.0})
    assert clock.remaining("student", 10) == pytest.approx(120.0)


def test_the_time_left_follows_a_machine_that_slows_down() -> None:
    """Only the last 20 iterations count: 21 of 4 s after many of 2 s."""
    clock = RunClock(CFG)
    for seconds in [2.0] * 50 + [4.0] * 21:
        clock.add("student", FIGURES | {"seconds": seconds})
    assert clock.rate("student") == pytest.approx(4.0)


def test_a_file_gets_a_line_every_half_minute() -> None:
    """A log of a night must show that the run goes on, in few lines: begin, every 30 s, end of each phase."""
    now, file = [0.0], io.StringIO()
    display = Display(CFG, Console(file=file, width=40), lambda: now[0], lambda: (now[0], now[0], 0.0))
    for iteration in range(1, 101):
        now[0] += 2.0
        display("teacher", iteration, 100, FIGURES)
    display("student", 1, 50, FIGURES)
    lines = file.getvalue().splitlines()
    assert [line.partition(":")[0] for line in lines] == [
        *(f"teacher {i}/100" for i in (1, 16, 31, 46, 61, 76, 91, 100)),
        "student 1/50",
    ]
    assert lines[0] == (
        "teacher 1/100: 4 min left, 5,321 env-steps/s, reward 0.0400, error 0.171 m/s, tripod 52%, falls 0.000/s, "
        "friction 0 to 0.24"
    )


@pytest.mark.parametrize(
    ("robot", "gait"), [("saturn_lite", ", tripod 52%,"), ("go2", ", trot 52%,"), ("g1", " m/s, falls ")]
)
def test_a_line_has_the_gait_that_its_robot_can_have(robot: str, gait: str) -> None:
    """A quadruped trots, and a biped without contact groups has no such number."""
    figures = dict(FIGURES)
    if robot == "g1":
        del figures["walk/tripod_share"]
    assert gait in figures_line(CFG, figures, find_robot(robot).gait)


@pytest.mark.parametrize(
    ("now", "load", "text"),
    [
        # Ten seconds in which the process had 6 s of a core and waited 4 s for it.
        ((10.0, 6.0, 4.0), 0.0, "machine busy: this process gets 0.6 of a core"),
        # Two threads: 12 s of the 20 s that they could have computed.
        ((10.0, 12.0, 8.0), 0.0, "machine busy: this process gets 1.2 of the 2.0 cores that it can use"),
        # 10 % of the time waiting, and one that waits for a disk or a GPU: neither is other people's work.
        ((10.0, 9.0, 1.0), 9.0, ""),
        ((10.0, 3.0, 0.0), 9.0, ""),
        # No more than its two threads can use.
        ((10.0, 5.0, 90.0), 0.0, "machine busy: this process gets 0.5 of the 2.0 cores that it can use"),
        # Not counted: by the load of the machine.
        ((10.0, 6.0, None), 1.5, "machine busy: this process gets 0.6 of a core"),
        ((10.0, 6.0, None), 0.8, ""),
        ((10.0, 9.5, None), 1.5, ""),
        # Too short to be judged.
        ((4.0, 1.0, 3.0), 9.0, ""),
    ],
)
def test_a_busy_machine_is_told(now: tuple, load: float, text: str) -> None:
    """Names what the process gets of what it could use, where a fifth of the time or more is lost to other work."""
    assert busy_text((0.0, 0.0, None if now[2] is None else 0.0), now, load, threads=2) == text


def test_the_time_left_is_told_with_what_takes_the_machine() -> None:
    """Begins the line in a log file; the window is that of the last 20 iterations, as for the time left."""
    times = iter([(0.0, 0.0, 0.0), *((100.0 + 2 * n, 100.0 + n, float(n)) for n in range(21))])
    clock = RunClock(CFG, lambda: next(times))
    for _ in range(21):
        clock.add("student", FIGURES | {"seconds": 2.0})
    assert clock.left("student", 20) == "1 min left (machine busy: this process gets 0.5 of a core)"


def test_waiting_is_counted_over_all_threads(tmp_path: Path) -> None:
    """Adds the second number of each schedstat [ns]; a thread that has just ended counts nothing."""
    for number, text in ((1, "5 2000000000 7\n"), (2, "5 500000000 7\n"), (3, "")):
        (tmp_path / str(number)).mkdir()
        (tmp_path / str(number) / "schedstat").write_text(text)
    assert processor_times(tmp_path)[2] == pytest.approx(2.5)
    assert processor_times(tmp_path / "none")[2] is None
