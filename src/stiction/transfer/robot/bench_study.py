"""How well benches find the friction of virtual robots: a referee beside each bench, who knows the truth.

What the referee writes goes into `bench.csv` alone. The folders of the robots, one each beside it, have what a person
with such a robot would have: `bench.npz` and its sidecar, `joints.json`, `training.json`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from stiction.formats.errors import StictionError
from stiction.formats.identified import IdentifiedFriction
from stiction.formats.joints import JointsFile
from stiction.formats.log import write_log
from stiction.formats.rows import read_rows, write_rows
from stiction.transfer.engines.catalog import what_is_missing
from stiction.transfer.robot.bench import bench_log
from stiction.transfer.robot.draw import draw
from stiction.transfer.robot.identification import Bench, is_made, write_identified
from stiction.transfer.robot.port import JointCommand, Reading
from stiction.transfer.robot.virtual import VirtualRobot
from stiction.transfer.workers import spread

LOG, TABLE = "bench.npz", "bench.csv"
"""Name of a robot's log, and of the referee's table."""

MOVING = 0.1
"""Speed from which a joint counts as moving [rad/s]; the slow part of the bench's motion has 0.35."""


class LoadMeter:
    """`Port` of a robot, and beside it a referee who notes the load of every joint while it moves."""

    def __init__(self, robot: VirtualRobot) -> None:
        """Stand beside a robot."""
        self._robot = robot
        self.joint_names, self.period = robot.plug.joint_names, robot.plug.period
        self._sum = np.zeros(len(self.joint_names))
        self._count = np.zeros(len(self.joint_names), int)

    def read(self) -> Reading:
        """Return what came last; see `Port.read`."""
        return self._robot.plug.read()

    def exchange(self, command: JointCommand) -> Reading:
        """Send a command and wait for one period; see `Port.exchange`."""
        reading = self._robot.plug.exchange(command)
        motion = self._robot.witness().motion
        moving = np.abs(motion.joint_velocity) > MOVING
        self._sum += np.where(moving, motion.joint_force + motion.joint_torque, 0.0)
        self._count += moving
        return reading

    @property
    def load(self) -> np.ndarray:
        """Mean of |F| + |T| while the joint moved, numbers of N and N m added up, shape (J,); 0 where it never did."""
        return self._sum / np.maximum(self._count, 1)


def referee(bench: Bench, joints: JointsFile, load: np.ndarray) -> list[IdentifiedFriction]:
    """Return what was found beside what was there, one row a joint that was logged; load: as of `LoadMeter`."""
    hidden, case = bench.case.robot(draw(bench.spec, bench.case.seed)), bench.case
    friction = case.level.coulomb(bench.spec) * hidden.friction.share
    added = case.level.load * hidden.friction.load_share * load
    rows = []
    for joint, record in joints.joints.items():
        number, found = bench.spec.joint_names.index(joint), record.coulomb_friction
        rows.append(
            IdentifiedFriction(
                robot=bench.label,
                engine=bench.engine,
                cell=case.cell,
                level=case.level.label,
                seed=case.seed,
                joint=joint,
                friction=float(friction[number]),
                load=float(added[number]),
                strength=float(hidden.motors.strength[number]),
                identified=None if found is None else found.value,
                low=None if found is None else found.interval95[0],
                high=None if found is None else found.interval95[1],
            )
        )
    return rows


def judge_bench(bench: Bench, folder: Path, workers: int = 1) -> list[IdentifiedFriction] | str:
    """Log a robot on its bench, identify it from its log, and return the referee's rows; or why there are none.

    folder: of the robot; workers: processes.
    """
    meter = LoadMeter(bench.robot())
    try:
        log = bench_log(meter, bench.spec, bench.cfg)
        write_log(folder / LOG, log)
        return referee(bench, write_identified(bench, log, folder, workers), meter.load)
    except OSError as error:
        return f"{folder} cannot be written: {error}; choose another --out"
    except StictionError as error:
        return str(error)


def study_benches(
    benches: Sequence[Bench],
    out: Path,
    jobs: int = 1,
    progress: Callable[[str, float], None] = lambda name, share: None,
) -> tuple[list[IdentifiedFriction], dict[str, str]]:
    """Put robots on their benches, those of which `out` has nothing yet; return rows, and robot -> why it has none.

    Args:
        benches: of different robots.
        out: folder of the results; it exists. `bench.csv` there grows robot by robot, and keeps what it has of robots
            that are not among `benches`.
        jobs: processes at once. They do not change the result.
        progress: called with `benches` and the share that is done.

    Raises:
        StictionError: an engine is not installed, `bench.csv` is not one or cannot be written, or a process was killed.

    """
    for bench in benches:
        if why := what_is_missing(bench.engine, bench.spec):
            raise StictionError(why)
    table = out / TABLE
    kept = read_rows(table, IdentifiedFriction) if table.exists() else []
    rows: dict[str, list[IdentifiedFriction]] = {}
    for row in kept:
        rows.setdefault(row.robot, []).append(row)
    failed: dict[str, str] = {}
    new = [bench for bench in benches if not (rows.get(bench.label) and is_made(bench, out / bench.label))]
    workers = max(1, jobs // max(1, len(new)))
    tasks = [(bench, out / bench.label, workers) for bench in new]
    for left, (number, found) in zip(reversed(range(len(new))), spread(judge_bench, tasks, jobs), strict=True):
        label = new[number].label
        if isinstance(found, str):
            rows[label], failed[label] = [], found
        else:
            rows[label] = found
            _write(table, list(chain.from_iterable(rows.values())))
        progress("benches", 1.0 - left / len(benches))
    # From the file, whose numbers have nine digits: the same command again says the same.
    done = read_rows(table, IdentifiedFriction) if table.exists() else []
    found_of = [bench.label for bench in benches if bench.label not in failed]
    return [row for label in found_of for row in done if row.robot == label], failed


def _write(table: Path, rows: Sequence[IdentifiedFriction]) -> None:
    """Write the table so that an interruption leaves the old one."""
    temporary = table.with_suffix(".tmp")
    try:
        write_rows(temporary, rows)
        temporary.replace(table)
    except OSError as error:
        raise StictionError(f"{table} cannot be written: {error}; choose another --out") from error
