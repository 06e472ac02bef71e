"""Virtual robots on their benches: what a grid has to know of its robots before they walk.

What identification finds in the log of a robot's own bench, in the same engine and at the same level, is what its user
could know; its hidden truth is never read for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from stiction.robots.spec import RobotSpec
from stiction.transfer.grid.config import ALONE
from stiction.transfer.grid.plan import Walk
from stiction.transfer.robot.factorial import Case, parse_level
from stiction.transfer.robot.identification import Bench, is_made, make_bench
from stiction.transfer.workers import spread

BENCH_WORK = "benches"
"""What progress calls the benches."""


def bench_of(walk: Walk, spec: RobotSpec) -> Bench | None:
    """Return the bench of the robot of a walk; None for the robot of the data sheet."""
    case = case_of(walk)
    return None if case is None else Bench(ALONE[walk.place.engine], case, spec)


def case_of(walk: Walk) -> Case | None:
    """Return the virtual robot of a walk; None for the robot of the data sheet."""
    if walk.robot is None or walk.place.cell is None:
        return None
    return Case(walk.robot, walk.place.cell, parse_level(walk.level))


def all_made(benches: Iterable[Bench], out: Path) -> bool:
    """Say whether every robot was on its bench; `out` as of `make_benches`."""
    return all(is_made(bench, out / bench.label) for bench in benches)


def make_benches(
    benches: Iterable[Bench],
    out: Path,
    jobs: int = 1,
    progress: Callable[[str, float], None] = lambda name, share: None,
) -> None:
    """Put the robots on their benches that have not been there yet.

    Args:
        benches: of the robots, some perhaps more than once.
        out: folder of what is identified, one folder a robot.
        jobs: processes at once; they do not change the result.
        progress: called with `BENCH_WORK` and the share that is done.

    Raises:
        StictionError: a file cannot be written.

    """
    missing = {bench.label: bench for bench in benches if not is_made(bench, out / bench.label)}
    workers = max(1, jobs // max(1, len(missing)))
    tasks = [(bench, out / label, workers) for label, bench in missing.items()]
    for count, _ in enumerate(spread(make_bench, tasks, jobs), 1):
        progress(BENCH_WORK, count / len(missing))
