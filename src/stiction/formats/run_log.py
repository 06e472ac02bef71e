"""The log of a deployed run: a folder that stays readable whatever ended the run.

`log.json` says what the arrays cannot: robot, joints, gains, policy. Beside it lie parts, NPZ files of half a second
each, whole or not there at all, which are merged into one a minute:

    readings-000000-000119.npz   one row a reading of the robot, 500 a second
    steps-000000-000119.npz      one row a step of the policy, 50 a second

The two numbers are the first and the last half second in it. A part that a merged one covers does not count.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import FileError, LogError
from stiction.core.memory import claim
from stiction.formats.log import JointSignals, Log, LogSetup
from stiction.formats.plain import build, read_object, take_version, write_object
from stiction.formats.tables import Columns, read_npz_arrays
from stiction.formats.walk import LARGEST_JITTER, WalkHeader, WalkLog, is_walk, read_walk

LOG = "log"
"""Folder of the log in that of a run."""

HEADER = "log.json"
SCHEMA, SCHEMA_VERSION = "stiction-run-log", 1

READINGS, STEPS = "readings", "steps"
"""The two tables."""

PART = re.compile(r"(readings|steps)-(\d{6})-(\d{6})\.npz")
"""Name of a part."""

MOST_PARTS = 200_000
"""More than a day of half seconds, twice."""

MOVED = 1e-3
"""Range of a target beyond which its joint was moved [rad]."""

RUN_STAGE = 2
"""Stage of the supervisor in which policy or motion had the robot, see `deploy.runtime.supervisor.Stage`."""


@dataclass(frozen=True)
class RunLogHeader:
    """What the arrays of a run cannot say. Sequences over joints have the order of `joint_names`."""

    robot: str
    """Name of the robot: `saturn_lite`."""
    joint_names: tuple[str, ...]
    """Names of the joints."""
    foot_names: tuple[str, ...]
    """Names of the feet."""
    period: float
    """Time between two readings [s]."""
    control_period: float
    """Time between two steps of the policy [s]."""
    kp: tuple[float, ...]
    """Gains of the joint controllers in the run [N m/rad]."""
    kd: tuple[float, ...]
    """[N m s/rad]."""
    torque_limit: tuple[float, ...]
    """Largest torques of the motors [N m]."""
    policy: str
    """Name of the bundle, or of the motion that was played."""
    digest: str
    """Digest of the bundle; empty where a motion was played."""
    armed: bool
    """Whether commands were sent."""
    torque_source: str | None = "motor_side"
    """As in every log: `motor_side` for currents."""


@dataclass(frozen=True)
class RunLog:
    """A run as logged: its header, and both tables, matrices over joints with one row a sample."""

    header: RunLogHeader
    """What the arrays cannot say."""
    readings: Columns
    """`time`, `stage`, `position`, `velocity`, `torque`, `target`, `requested`, `limited_by`, `quaternion`, ..."""
    steps: Columns
    """`time`, `target`, `action`, `frame`, `lateness`, `wear`, ..."""
    notes: tuple[str, ...] = ()
    """What a reader should know of how the log was read."""


def write_run_header(folder: Path, header: RunLogHeader) -> None:
    """Write `log.json`."""
    write_object(folder / HEADER, {"schema": SCHEMA, "schema_version": SCHEMA_VERSION} | asdict(header))


def part_name(table: str, first: int, last: int) -> str:
    """Return the name of a part."""
    return f"{table}-{first:06d}-{last:06d}.npz"


def is_run_log(path: Path) -> bool:
    """Return whether a folder is the log of a run by its looks."""
    return (path / HEADER).is_file()


def find_run_log(path: Path) -> Path | None:
    """Return the folder of the log where a path is one, or the folder of a run that has one; else None."""
    return next((folder for folder in (path, path / LOG) if is_run_log(folder)), None)


def is_walk_log(path: Path) -> bool:
    """Return whether a path is a walking log by its looks: of our own form, or the log of a run with a policy."""
    folder = find_run_log(path)
    if folder is None:
        return path.suffix == ".npz" and path.is_file() and is_walk(path)
    return read_run_header(folder).policy != ""


def read_walk_log(path: Path) -> WalkLog:
    """Read a walking log, see `is_walk_log`; raises `LogError`."""
    folder = find_run_log(path)
    return read_walk(path) if folder is None else walk_log(read_run_log(folder))


def parts_of(names: Iterable[str], table: str) -> list[tuple[int, int, str]]:
    """Return first and last half second, and name, of the parts that count, in order: no part covers another."""
    found = [match for name in names if (match := PART.fullmatch(name)) and match[1] == table]
    parts = sorted((int(match[2]), -int(match[3]), match[0]) for match in found)
    chosen: list[tuple[int, int, str]] = []
    for first, last, name in parts:
        if not chosen or first > chosen[-1][1]:
            chosen.append((first, -last, name))
    return chosen


def read_run_log(folder: Path) -> RunLog:
    """Read the log of a run; nothing in it is executed.

    Raises:
        LogError: no such log, another version, a field of the wrong kind, no readings, or parts that do not fit.

    """
    header = read_run_header(folder)
    names = _names_in(folder)
    tables, notes = {}, []
    for table in (READINGS, STEPS):
        parts = parts_of(names, table)
        claim(folder.name, 4 * sum((folder / name).stat().st_size for *_, name in parts), "the log has", LogError)
        arrays, taken = [], 0
        for *_, name in parts:
            arrays.append(read_npz_arrays(folder / name))
            taken += sum(8 * array.size for array in arrays[-1].values())
            claim(folder.name, 2 * taken, "the log takes", LogError)
        tables[table] = _joined(folder, table, arrays)
        missing = sum(first - last - 1 for (_, last, _), (first, _, _) in pairwise(parts))
        if missing:
            notes.append(f"{missing} half seconds of the log's {table} are not there")
    if "time" not in tables[READINGS]:
        raise LogError(f"{folder}: no readings in it; the run ended before the first half second was written")
    wide = len(header.joint_names)
    for name in ("position", "velocity", "torque", "target"):
        shape = tables[READINGS].get(name, np.zeros(0)).shape
        if shape != (len(tables[READINGS]["time"]), wide):
            raise LogError(f"{folder}: {name!r} has the shape {shape}; expected a row a reading and {wide} joints")
    return RunLog(header, tables[READINGS], tables[STEPS], tuple(notes))


def read_run_header(folder: Path) -> RunLogHeader:
    """Read `log.json`; raise `LogError` where it is none."""
    data = read_object(folder / HEADER, "the header of a run's log", LogError, 2**20)
    if data.pop("schema", None) != SCHEMA:
        raise LogError(f"{folder / HEADER}: does not say {SCHEMA!r}; expected the log of `stiction deploy`")
    return build(RunLogHeader, take_version(data, SCHEMA_VERSION, HEADER, LogError), HEADER, LogError)


def _names_in(folder: Path) -> list[str]:
    """Return the names of a folder's files; raise `LogError` where there are too many."""
    names = []
    for path in folder.iterdir():
        names.append(path.name)
        if len(names) > MOST_PARTS:
            raise LogError(f"{folder}: more than {MOST_PARTS} files; expected the log of one run")
    return names


def _joined(folder: Path, table: str, parts: list[Columns]) -> Columns:
    """Return the arrays of all parts behind each other; raise `LogError` where they are of different kinds."""
    if not parts:
        return {}
    for arrays in parts:
        if arrays.keys() != parts[0].keys() or any(
            array.dtype.kind not in "fiub" or array.ndim not in (1, 2) or array.shape[1:] != parts[0][name].shape[1:]
            for name, array in arrays.items()
        ):
            raise LogError(f"{folder}: the {table} differ from part to part; they are of different runs")
    return {name: np.concatenate([arrays[name] for arrays in parts]).astype(np.float64) for name in parts[0]}


def _of_run(log: RunLog) -> np.ndarray:
    """Return which readings are of the run itself and can be used, bool, shape (T,); raise `LogError` if too few."""
    rows = log.readings
    used = (rows["stage"] == RUN_STAGE) & np.isfinite(rows["position"]).all(1) & np.isfinite(rows["target"]).all(1)
    if used.sum() < 2:
        raise LogError(f"the run's log has {len(used)} readings, and none of the run itself: it ended before it began")
    return used


def joint_log(source: str, log: RunLog) -> Log:
    """Return a run as a log of its joints, as `identify` reads one: the run itself, without standing up and damping.

    Joints whose target stood still are left out, and said. Raises `LogError` where no target moved.
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
    own = zip(header.joint_names, header.kp, header.kd, header.torque_limit, strict=True)
    joints = {name: LogSetup(kp=kp, kd=kd, torque_limit=limit) for name, kp, kd, limit in own}
    setup = LogSetup(torque_source=header.torque_source, joints=joints)
    time = rows["robot_time"][used]
    return Log(source, time - time[0], signals, setup, notes, float(time[0]))


def walk_log(log: RunLog) -> WalkLog:
    """Return a run as a walking log, the longest part of it in which no reading is missing.

    Raises `LogError` where it is none.
    """
    rows, header = log.readings, log.header
    used = _longest(np.flatnonzero(_of_run(log)), rows["robot_time"], header.period)
    own: dict[str, Any] = {name: getattr(header, name) for name in ("robot", "joint_names", "foot_names", "period")}
    own |= {name: getattr(header, name) for name in ("kp", "kd", "torque_limit", "torque_source", "policy")}
    optional = {}
    for name, column in (("specific_force", "acceleration"), ("joint_torque", "torque")):
        if np.isfinite(rows[column][used]).all():
            optional[name] = rows[column][used]
    contact = rows["foot_contact"][used]
    if header.foot_names and np.isfinite(contact).all():
        optional["foot_contact"] = contact > 0.5
    time = rows["robot_time"][used]
    return WalkLog(
        WalkHeader(**own),
        time=time - time[0],
        joint_position=rows["position"][used],
        joint_velocity=rows["velocity"][used],
        joint_target=rows["target"][used],
        angular_velocity=rows["angular_velocity"][used],
        quaternion=rows["quaternion"][used],
        velocity_command=rows["velocity_command"][used],
        **optional,
    )


def _longest(used: np.ndarray, time: np.ndarray, period: float) -> np.ndarray:
    """Return the longest part of the used readings, by their numbers, that are one period apart."""
    away = np.abs(np.diff(time[used]) / period - 1.0)
    ends = np.flatnonzero((np.diff(used) != 1) | (away > LARGEST_JITTER)) + 1
    return max(np.split(used, ends), key=len)


def check_empty(folder: Path) -> None:
    """Refuse a folder that has a log already: two runs must not become one. Raises `FileError`."""
    if is_run_log(folder):
        raise FileError(f"{folder} has the log of a run already; name another --out, or move it away")
