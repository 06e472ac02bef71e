"""How well benches find the friction of virtual robots: what they say beside the truth.

The truth goes into `bench.csv` alone, which nothing that trains or drives reads. The folders of the robots beside it
have what a person with such a robot would have: `bench.npz` and its sidecar, `joints.json`, `training.json`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import median

import numpy as np

from stiction.core.cache import has_entry, publish_entry, read_entry, sealed
from stiction.core.decode import from_plain
from stiction.core.errors import EngineError, StictionError, UnwrittenError
from stiction.core.files import write_text
from stiction.core.parallel import spread
from stiction.core.records import column
from stiction.deploy.control import JointCommand, Reading
from stiction.engines.catalog import missing_engine
from stiction.files.joints import JointsFile
from stiction.files.log import write_log
from stiction.virtual.bench import Bench, bench_log, identified, write_bench_results
from stiction.virtual.hidden import draw
from stiction.virtual.robot import VirtualRobot


@dataclass(frozen=True)
class IdentifiedFriction:
    """The dry friction of one joint of one robot."""

    robot: str
    """Name of the robot's folder: `saturn_lite--physx--all--0.1--1000`."""
    engine: str
    cell: str
    """Real effects of the robot."""
    level: str
    """Its dry friction, as people type it: `0.1`, `bench+0.02`."""
    seed: int
    joint: str = field(metadata=column("joint"))
    friction: float = field(metadata=column("f", "N m", ".4g"))
    """Truth: Coulomb friction without load, f [N m]."""
    load: float = field(metadata=column("load", "N m"))
    """Truth: what the load law adds to it while the joint moves on the bench, mean [N m]."""
    strength: float = field(metadata=column("k", "1", form=".3f"))
    """Truth: torque that the motor gives over torque that it reports, k [1]."""
    identified: float | None = field(metadata=column("found", "N m", ".4g"))
    """Coulomb friction that was found [N m]; None where the joint was refused."""
    low: float | None = field(metadata=column("from", "N m", ".4g"))
    """Lower end of its 95 % interval [N m]."""
    high: float | None = field(metadata=column("to", "N m", ".4g"))

    @property
    def shown(self) -> float:
        """Return the friction in a perfect log, (f + load)/k [N m], in the unit of the motor's own reports."""
        return (self.friction + self.load) / self.strength

    def holds(self, true: float) -> bool:
        """Return whether the interval holds a friction, `shown` or f itself [N m]."""
        return self.low is not None and self.high is not None and self.low <= true <= self.high

    def error(self, true: float) -> float | None:
        """Return the relative error of what was found against a friction [1]; None where there is neither."""
        return None if self.identified is None or true == 0.0 else self.identified / true - 1.0


@dataclass(frozen=True)
class Score:
    """How well the friction of some joints was found."""

    joints: int = field(metadata=column("joints"))
    identified: int = field(metadata=column("identified"))
    """... that were not refused."""
    held: int = field(metadata=column("hold (f + load)/k", "joints"))
    """... whose interval holds what a perfect log shows."""
    held_friction: int = field(metadata=column("hold f", "joints"))
    """... whose interval holds f itself."""
    median_error: float | None = field(metadata=column("median error", "%", form=".1%"))
    """Median size of the relative error against what a perfect log shows [1]; None where no joint has one."""
    worst_error: float | None = field(metadata=column("worst", "%", form="+.1%"))
    """Relative error of the largest size, with its sign [1]."""
    worst_joint: str = field(metadata=column("of", form=lambda name: name.rpartition(" ")[2]))
    """Robot and joint that have it; empty without one."""
    median_friction_error: float | None = field(metadata=column("median error of f", "%", form=".1%"))
    """Median size of the relative error against f itself [1]."""
    worst_friction_error: float | None = field(metadata=column("worst of f", "%", form="+.1%"))
    """Relative error of the largest size against f itself, with its sign [1]."""


def score(rows: Sequence[IdentifiedFriction]) -> Score:
    """Return how well the friction of these joints was found."""
    errors = {f"{row.robot} {row.joint}": error for row in rows if (error := row.error(row.shown)) is not None}
    true_errors = [error for row in rows if (error := row.error(row.friction)) is not None]
    worst = max(errors, key=lambda name: abs(errors[name]), default="")
    return Score(
        joints=len(rows),
        identified=sum(row.identified is not None for row in rows),
        held=sum(row.holds(row.shown) for row in rows),
        held_friction=sum(row.holds(row.friction) for row in rows),
        median_error=median(map(abs, errors.values())) if errors else None,
        worst_error=errors.get(worst),
        worst_joint=worst,
        median_friction_error=median(map(abs, true_errors)) if true_errors else None,
        worst_friction_error=max(true_errors, key=abs, default=None),
    )


LOG = "bench.npz"
"""Name of a robot's log."""

MOVING = 0.1
"""Speed from which a joint counts as moving [rad/s]; the slow part of the bench's motion has 0.35."""


class LoadMeter:
    """`Port` of a robot that also averages the true load of every joint while it moves."""

    def __init__(self, robot: VirtualRobot) -> None:
        """Start with no load."""
        self._robot = robot
        self.joint_names, self.period = robot.handle.joint_names, robot.handle.period
        self._sum = np.zeros(len(self.joint_names))
        self._count = np.zeros(len(self.joint_names), int)

    def read(self) -> Reading:
        """Return what came last; see `Port.read`."""
        return self._robot.handle.read()

    def exchange(self, command: JointCommand) -> Reading:
        """Send a command and wait for one period; see `Port.exchange`."""
        reading = self._robot.handle.exchange(command)
        motion = self._robot.ground_truth().motion
        moving = np.abs(motion.joint_velocity) > MOVING
        self._sum += np.where(moving, motion.joint_force + motion.joint_torque, 0.0)
        self._count += moving
        return reading

    @property
    def load(self) -> np.ndarray:
        """Mean of |F| + |T| while the joint moved, numbers of N and N m added up, shape (J,); 0 where it never did."""
        return self._sum / np.maximum(self._count, 1)


def beside_truth(bench: Bench, joints: JointsFile, load: np.ndarray) -> list[IdentifiedFriction]:
    """Return what was found beside what was there, one row a joint that was logged; load: as of `LoadMeter`."""
    hidden, case = bench.case.robot(draw(bench.spec, bench.case.seed)), bench.case
    friction = case.coulomb(hidden, bench.spec)
    added = case.level.load * hidden.friction.load_share * load
    rows = []
    for joint, record in joints.joints.items():
        number, estimate = bench.spec.joint_names.index(joint), record.coulomb_friction
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
                identified=None if estimate is None else estimate.value,
                low=None if estimate is None else estimate.interval95[0],
                high=None if estimate is None else estimate.interval95[1],
            )
        )
    return rows


def judge_bench(bench: Bench, folder: Path, workers: int = 1) -> list[IdentifiedFriction] | str:
    """Log a robot on its bench, identify it, and return what was found beside the truth; or why there is nothing.

    folder: of the robot; workers: processes.
    """
    meter = LoadMeter(bench.robot())
    try:
        log = bench_log(meter, bench.spec, bench.cfg)
        # The log of a robot that cannot be identified is there to look into.
        write_log(folder / LOG, log)
        joints = identified(log, workers)
        rows = beside_truth(bench, joints, meter.load)
        with publish_entry(folder, bench.key, bench.label) as partial:
            write_log(partial / LOG, log)
            write_bench_results(joints, partial)
        return rows
    except UnwrittenError:
        raise
    except StictionError as error:
        return str(error)


def study_benches(
    benches: Sequence[Bench],
    out: Path,
    jobs: int = 1,
    progress: Callable[[str, float], None] = lambda name, share: None,
) -> tuple[list[IdentifiedFriction], dict[str, str]]:
    """Put robots on their benches, those of which `out` has nothing yet; return rows, and robot -> why it has none.

    benches: of different robots. out: folder of the results; it exists. jobs: processes at once, which do not change
    the result.

    Raises:
        StictionError: an engine is not installed, a file cannot be written, or a process was killed.

    """
    for bench in benches:
        if why := missing_engine(bench.engine, bench.spec):
            raise EngineError(why)
    # Not in the robots' own folders, in which nothing but what was found may be.
    files = {bench.label: out / "judged" / f"{bench.label}.json" for bench in benches}
    rows, failed = dict[str, list[IdentifiedFriction]](), dict[str, str]()
    for bench in benches:
        label = bench.label
        if has_entry(out / label, bench.key) and (stored := read_entry(files[label], bench.key)):
            rows[label] = [from_plain(IdentifiedFriction, row, label) for row in stored["rows"]]
    new = [bench for bench in benches if bench.label not in rows]
    workers = max(1, jobs // max(1, len(new)))
    tasks = [(bench, out / bench.label, workers) for bench in new]
    for left, (number, outcome) in zip(reversed(range(len(new))), spread(judge_bench, tasks, jobs), strict=True):
        label = new[number].label
        if isinstance(outcome, str):
            failed[label] = outcome
        else:
            rows[label] = outcome
            entry = sealed({"key": new[number].key, "rows": [asdict(row) for row in outcome]})
            write_text(files[label], json.dumps(entry) + "\n")
        progress("benches", 1.0 - left / len(benches))
    return [row for bench in benches for row in rows.get(bench.label, ())], failed
