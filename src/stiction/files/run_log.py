"""Log of a deployed run: a folder that stays readable however the run ended.

`log.json` holds robot, joints, gains, policy. Next to it are parts, NPZ files of half a second each, written
atomically, which are merged into one per minute:

  readings-000000-000119.npz   one row per reading of the robot, 500 a second
  steps-000000-000119.npz      one row per step of the policy, 50 a second

The two numbers are its first and last half second. A part that a merged one covers is ignored. Each part names its run,
so that parts of two runs are not mixed.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from itertools import islice, pairwise
from pathlib import Path

import numpy as np

from stiction.core.decode import from_plain, is_number
from stiction.core.errors import FileError, LogError
from stiction.core.memory import allowance
from stiction.files.log import JointSignals, Log, LogSetup
from stiction.files.plain import read_object, take_version, write_object
from stiction.files.tables import Columns, parse_npz, read_bytes
from stiction.files.walk import LARGEST_JITTER, WalkHeader, WalkLog, is_walk, read_walk
from stiction.joints.net import TorqueSource

LOG = "log"
"""Folder of the log in the folder of a run."""

HEADER = "log.json"
SCHEMA, SCHEMA_VERSION = "stiction-run-log", 1

READINGS, STEPS = "readings", "steps"
"""The two tables."""

PART = re.compile(r"(readings|steps)-(\d{6})-(\d{6})\.npz")
"""Pattern of a part's name."""

MOST_PARTS = 5000
"""Maximum number of parts: more than a day of minutes, twice."""

RUN = "run"
"""Array of a part with the name of its run."""

MOVED = 1e-3
"""Minimum range of a target for its joint to count as moved [rad]."""

RUN_STAGE = 2
"""Stage of the supervisor in which policy or motion controls the robot, see `deploy.runtime.supervisor.Stage`."""


@dataclass(frozen=True, kw_only=True)
class RunLogHeader(WalkHeader):
    """Description of a run. `policy`: name of the bundle; empty where a motion was played."""

    control_period: float
    """Time between two steps of the policy [s]."""
    digest: str
    """Digest of the bundle; empty where a motion was played."""
    armed: bool
    """True if commands were sent."""
    torque_source: TorqueSource | None = "motor_side"
    """Place of the torque measurement, as in every log: `motor_side` for currents."""
    run: str = ""
    """Unique name of the run, repeated in each part; empty in older logs."""
    walking_kp: tuple[float, ...] | None = None
    """Proportional gains of the bundle [N m/rad], also where a motion was played with others; None in older logs."""

    def __post_init__(self) -> None:
        super().__post_init__()
        gains, count = self.walking_kp, len(self.joint_names)
        if gains is not None and not (len(gains) == count and all(is_number(gain) and gain > 0 for gain in gains)):
            raise LogError(f"walking_kp: expected a number above 0 for each of {count} joints, or null")
        right = is_number(self.control_period) and self.control_period > 0
        right = right and isinstance(self.armed, bool) and all(isinstance(t, str) for t in (self.digest, self.run))
        if not right:
            raise LogError("control_period, armed, digest, run: expected a number above 0, true or false, and texts")

    def of_walk(self) -> WalkHeader:
        """Return the header of a walking log."""
        return WalkHeader(**{item.name: getattr(self, item.name) for item in fields(WalkHeader)})


NOT_OF_RUNS = ("recorded_in", "command", "noise")
"""Fields of a walking log's header that the log of a run lacks."""


@dataclass(frozen=True)
class RunLog:
    """Run as logged: its header, and both tables, matrices over joints with one row per sample."""

    header: RunLogHeader
    """Description of the run."""
    readings: Columns
    """`time`, `stage`, `position`, `velocity`, `torque`, `target`, `requested`, `limited_by`, `forward`, ..."""
    steps: Columns
    """`time`, `target`, `action`, `frame`, `lateness`, `wear`, ..."""
    notes: tuple[str, ...] = ()
    """Notes for readers on how the log was read."""


def write_run_header(folder: Path, header: RunLogHeader) -> None:
    """Write `log.json`."""
    plain = {name: value for name, value in asdict(header).items() if name not in NOT_OF_RUNS}
    write_object(folder / HEADER, {"schema": SCHEMA, "schema_version": SCHEMA_VERSION} | plain)


def part_name(table: str, first: int, last: int) -> str:
    """Return the name of a part."""
    return f"{table}-{first:06d}-{last:06d}.npz"


def is_run_log(path: Path) -> bool:
    """Return whether a folder looks like the log of a run."""
    return (path / HEADER).is_file()


def find_run_log(path: Path) -> Path | None:
    """Return the folder of the log, from its path or that of its run; else None."""
    return next((folder for folder in (path, path / LOG) if is_run_log(folder)), None)


def is_walk_log(path: Path) -> bool:
    """Return whether a path looks like a walking log: of the canonical form, or the log of a run with a policy."""
    folder = find_run_log(path)
    if folder is None:
        return path.suffix == ".npz" and path.is_file() and is_walk(path)
    return read_run_header(folder).policy != ""


def read_walk_log(path: Path) -> WalkLog:
    """Read a walking log, see `is_walk_log`; raises `LogError`."""
    folder = find_run_log(path)
    return read_walk(path) if folder is None else walk_log(read_run_log(folder))


def parts_of(names: Iterable[str], table: str) -> list[tuple[int, int, str]]:
    """Return first and last half second, and name, of the valid parts, in order: no part covers another."""
    matches = [match for name in names if (match := PART.fullmatch(name)) and match[1] == table]
    # Of parts that begin together the longest comes first: a minute before the half seconds that are in it.
    parts = sorted((int(match[2]), -int(match[3]), match[0]) for match in matches)
    chosen: list[tuple[int, int, str]] = []
    for first, last, name in parts:
        if not chosen or first > chosen[-1][1]:
            chosen.append((first, -last, name))
    return chosen


def read_run_log(folder: Path) -> RunLog:
    """Read the log of a run; nothing in it is executed.

    Raises `LogError`: another kind of folder, another version, a field of the wrong kind, no readings, parts of another
    run, repeated, in another order or of other shapes.
    """
    header = read_run_header(folder)
    names = _names_in(folder)
    tables, notes = {}, []
    for table in (READINGS, STEPS):
        parts, covered = _whole_parts(folder, names, table)
        tables[table] = _joined(folder, table, [name for *_, name in parts], header.run)
        for name in covered:
            if not np.isin(read_part(folder / name, header.run)["time"], tables[table]["time"]).all():
                raise LogError(f"{folder}: {name} is not in the part that covers it; the files have been mixed up")
        missing = sum(first - last - 1 for (_, last, _), (first, _, _) in pairwise(parts))
        if missing:
            notes.append(f"{missing} half seconds of the log's {table} are not there")
    if "time" not in tables[READINGS]:
        raise LogError(f"{folder}: no readings in it; the run ended before the first half second was written")
    return RunLog(header, _checked(folder, header, tables[READINGS]), tables[STEPS], tuple(notes))


def _whole_parts(folder: Path, names: list[str], table: str) -> tuple[list[tuple[int, int, str]], list[str]]:
    """Return the valid parts, see `parts_of`, and the names of those that they cover.

    Raises `LogError` for a part that overlaps another.
    """
    parts = parts_of(names, table)
    chosen = {name for *_, name in parts}
    covered = [match for name in names if name not in chosen and (match := PART.fullmatch(name)) and match[1] == table]
    for match in covered:
        if not any(begin <= int(match[2]) and int(match[3]) <= end for begin, end, _ in parts):
            raise LogError(f"{folder}: {match[0]} overlaps another part; the files have been mixed up")
    if odd := next((name for first, last, name in parts if last < first), None):
        raise LogError(f"{folder}: {odd} ends before it begins; the files have been mixed up")
    return parts, [match[0] for match in covered]


def read_part(path: Path, run: str, most: int | None = None) -> Columns:
    """Return the arrays of a part, numbers with one row per sample.

    run: name of its run; most: maximum inflated size [B]. Raises `LogError` for a part of another run, or of other
    contents.
    """
    arrays = parse_npz(path.name, read_bytes(path), most)
    part_run = str(arrays.pop(RUN, ""))
    if part_run != run:
        raise LogError(f"{path}: is a part of another run ({part_run[:40]!r}, the log's {HEADER} says {run[:40]!r})")
    lengths = {array.shape[:1] for array in arrays.values()}
    if (
        "time" not in arrays
        or len(lengths) != 1
        or any(array.dtype.kind not in "fiu" or array.ndim not in (1, 2) for array in arrays.values())
    ):
        raise LogError(f"{path}: not a part of a run's log: expected arrays of numbers, a row a sample, and their time")
    return arrays


def _joined(folder: Path, table: str, names: list[str], run: str) -> Columns:
    """Return the arrays of all parts concatenated; raise `LogError` where they are not parts of one table."""
    parts: list[Columns] = []
    # Half: parts and what is joined of them are in memory together.
    left = most = allowance() // 2
    for name in names:
        parts.append(read_part(folder / name, run, left))
        # As doubles, which they become.
        left -= sum(8 * array.size for array in parts[-1].values())
        if left < 0:
            raise LogError(
                f"{folder.name}: the log takes more than the {most} bytes that are read: cut it into parts, or allow "
                "more (--memory-limit)"
            )
        shapes = [{key: array.shape[1:] for key, array in part.items()} for part in (parts[0], parts[-1])]
        if shapes[0] != shapes[1]:
            raise LogError(f"{folder}: the {table} differ from part to part ({name}); they are of different runs")
    if not parts:
        return {}
    joined = {name: np.concatenate([arrays[name] for arrays in parts]).astype(np.float64) for name in parts[0]}
    time = joined["time"]
    if time.ndim != 1 or not np.isfinite(time).all() or not (np.diff(time) > 0).all():
        raise LogError(f"{folder}: the {table} are not in the order of their time; a part is repeated or misnamed")
    return joined


def _checked(folder: Path, header: RunLogHeader, readings: Columns) -> Columns:
    """Return the readings, with those of joints and feet as matrices, shape (T, width).

    Raises `LogError` for a missing column, or one of another width than in the header.
    """
    rows, joints, feet = len(readings["time"]), len(header.joint_names), len(header.foot_names)
    widths = dict.fromkeys(("position", "velocity", "torque", "target", "forward"), joints) | {"foot_contact": feet}
    widths |= dict.fromkeys(("angular_velocity", "acceleration", "velocity_command"), 3) | {"quaternion": 4}
    shapes: dict[str, tuple[int, ...]] = {name: (rows, width) for name, width in widths.items()}
    shapes |= dict.fromkeys(("stage", "robot_time"), (rows,))
    table = {"forward": np.zeros((rows, joints))} | readings  # Older logs know of no friction fed forward.
    for name, shape in shapes.items():
        if name not in table or table[name].size != math.prod(shape) or len(table[name]) != rows:
            came = table[name].shape if name in table else "not there"
            raise LogError(
                f"{folder}: the column {name!r} is {came}; expected {shape}: {rows} readings of the {joints} joints "
                f"and {feet} feet that {HEADER} names"
            )
        # Of a single joint or foot the recorder writes vectors.
        table[name] = table[name].reshape(shape)
    return table


def read_run_header(folder: Path) -> RunLogHeader:
    """Read `log.json`; raise `LogError` for another file."""
    data = read_object(folder / HEADER, "the header of a run's log", LogError, 2**20)
    if data.pop("schema", None) != SCHEMA:
        raise LogError(f"{folder / HEADER}: does not say {SCHEMA!r}; expected the log of `stiction deploy`")
    try:
        data = take_version(data, SCHEMA_VERSION, HEADER, LogError)
        return from_plain(RunLogHeader, data, HEADER, LogError, ("policy",))
    except LogError as error:
        raise LogError(f"{folder}: {error}") from error


def _names_in(folder: Path) -> list[str]:
    try:
        names = [path.name for path in islice(folder.iterdir(), MOST_PARTS + 1)]
    except OSError as error:
        raise LogError(f"cannot read {folder}: {error.strerror or error}") from error
    if len(names) > MOST_PARTS:
        raise LogError(f"{folder}: more than {MOST_PARTS} files; expected the log of one run")
    return names


def _of_run(log: RunLog) -> np.ndarray:
    """Return the mask of usable readings of the run itself, bool, shape (T,); raise `LogError` if too few."""
    rows = log.readings
    used = (rows["stage"] == RUN_STAGE) & np.isfinite(rows["position"]).all(1) & np.isfinite(rows["target"]).all(1)
    if used.sum() < 2:
        raise LogError(
            f"the run's log has {len(used)} readings, and none of the run itself: it ended before it began; "
            "report.json says why"
        )
    if not (np.diff(rows["robot_time"][used]) > 0).all():
        raise LogError("the run's log: the robot's own clock (robot_time) stands still, goes back, or says no number")
    return used


def joint_log(source: str, log: RunLog) -> Log:
    """Return a run as a log of its joints for `identify`: without standing up and damping.

    Joints with a constant target are left out, with a note. Raises `LogError` where no target moved.
    """
    used, rows, header = _of_run(log), log.readings, log.header
    signals, still = {}, []
    for number, name in enumerate(header.joint_names):
        if np.ptp(rows["target"][used, number]) > MOVED:
            roles = ("position", "velocity", "target", "torque")
            signals[name] = JointSignals(*(rows[role][used, number] for role in roles))
        else:
            still.append(name)
    if not signals:
        raise LogError(f"{source}: no target moved in this run; play a motion: deploy --excitation trajectory.csv")
    notes = (*log.notes, *([f"left out, as their targets stood still: {', '.join(still)}"] if still else []))
    gains = header.walking_kp or (None,) * len(header.kp)
    motors = zip(header.joint_names, header.kp, header.kd, gains, header.torque_limit, strict=True)
    joints = {
        name: LogSetup(kp=kp, kd=kd, walking_kp=walking, torque_limit=limit) for name, kp, kd, walking, limit in motors
    }
    setup = LogSetup(torque_source=header.torque_source, joints=joints)
    # By the robot's own clock: ours says when a reading was taken up, and several are at once.
    time = rows["robot_time"][used]
    return Log(source, time - time[0], signals, setup, notes, float(time[0]), robot=header.robot)


def walk_log(log: RunLog) -> WalkLog:
    """Return a run as a walking log: its longest part without a missing reading.

    Raises `LogError` for a run without a walk.
    """
    rows, header = log.readings, log.header
    used = np.flatnonzero(_of_run(log))
    deviation = np.abs(np.diff(rows["robot_time"][used]) / header.period - 1.0)
    gaps = np.flatnonzero((np.diff(used) != 1) | (deviation > LARGEST_JITTER)) + 1
    used = max(np.split(used, gaps), key=len)
    columns = {"specific_force": "acceleration", "joint_torque": "torque"}.items()
    optional = {name: rows[column][used] for name, column in columns if np.isfinite(rows[column][used]).all()}
    contact = rows["foot_contact"][used]
    if header.foot_names and np.isfinite(contact).all():
        optional["foot_contact"] = contact > 0.5
    time, kp = rows["robot_time"][used], np.array(header.kp)
    # kp (a + u/kp − θ) is kp (a − θ) + u: to readers of walks, torque fed forward is a target that is ahead.
    ahead = np.divide(rows["forward"][used], kp, out=np.zeros((len(used), len(kp))), where=kp > 0.0)
    return WalkLog(
        header.of_walk(),
        time=time - time[0],
        joint_target=rows["target"][used] + ahead,
        **{f"joint_{name}": rows[name][used] for name in ("position", "velocity")},
        **{name: rows[name][used] for name in ("angular_velocity", "quaternion", "velocity_command")},
        **optional,
    )


def log_digest(path: Path) -> str:
    """Return the SHA-256 of a log: of its file, or of the files of a run's log with their names."""
    folder = find_run_log(path)
    if folder is None:
        return hashlib.sha256(read_bytes(path)).hexdigest()
    parts = [name for table in (READINGS, STEPS) for *_, name in parts_of(_names_in(folder), table)]
    each = [f"{name} {hashlib.sha256(read_bytes(folder / name)).hexdigest()}" for name in (HEADER, *parts)]
    return hashlib.sha256("\n".join(each).encode()).hexdigest()


def check_empty(folder: Path) -> None:
    """Reject a folder with a log: two runs must not be mixed. Raises `FileError`."""
    if is_run_log(folder):
        raise FileError(f"{folder} has the log of a run already; choose another --out, or move it away")
