"""The canonical log of one or more joints: CSV or NPZ, with an optional sidecar of what the columns cannot say.

Columns are `time` [s] and, per joint, `position.<joint>` [rad], `velocity.<joint>` [rad/s], `target.<joint>` [rad],
`torque.<joint>` [N m], those that exist; a log of a single joint may drop the joint's name. The sidecar of `swing.csv`
is `swing.json`, an object with the fields of `LogSetup`. Nothing that executes code is ever read.
"""

from __future__ import annotations

import csv
import io
import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from stiction.formats.errors import StictionError

SIGNALS = ("position", "velocity", "target", "torque")
"""What a log may hold per joint."""

UNNAMED = "joint"
"""Name of a joint that neither the columns nor the user named."""

Columns = dict[str, np.ndarray]
"""Column name -> values, shape (num_samples,)."""


class LogError(StictionError):
    """A log that cannot be read, or that does not hold what was asked of it."""


@dataclass(frozen=True)
class LogSetup:
    """What a log cannot say in columns; a missing field is None."""

    kp: float | None = None
    """Proportional gain of the joint controller [N m/rad]."""
    kd: float | None = None
    """Derivative gain [N m s/rad]."""
    torque_limit: float | None = None
    """Largest torque of the motor [N m]."""
    torque_source: str | None = None
    """`motor_side` (joint friction not in it: motor current or command) or `output_side` (sensor after the gear)."""
    test_condition: str | None = None
    """`bare_motor`, `in_air` or `loaded`."""
    axis: str | None = None
    """`rotary` or `linear` (then read N for N m, m for rad, kg for kg m²)."""


@dataclass(frozen=True)
class JointSignals:
    """The signals of one joint, each of shape (num_samples,); what was not logged is None."""

    position: np.ndarray | None = None
    """θ [rad]."""
    velocity: np.ndarray | None = None
    """θ' [rad/s]."""
    target: np.ndarray | None = None
    """a, the position asked for [rad]."""
    torque: np.ndarray | None = None
    """τ [N m]."""


@dataclass(frozen=True)
class Log:
    """A log as read: nothing resampled, nothing filtered."""

    source: str
    """Name of the file, for messages."""
    time: np.ndarray
    """Time stamps [s], shape (num_samples,)."""
    joints: dict[str, JointSignals]
    """Joint name -> signals."""
    setup: LogSetup = field(default_factory=LogSetup)
    """The sidecar's content."""

    def joint(self, name: str | None) -> tuple[str, JointSignals]:
        """Return a joint by name, or the only one for None; raise `LogError` naming what there is."""
        if name is None and len(self.joints) == 1:
            return next(iter(self.joints.items()))
        if name in self.joints:
            return name, self.joints[name]
        asked = "no joint was chosen" if name is None else f"no joint {name!r}"
        raise LogError(f"{self.source}: {asked}; the log has {', '.join(self.joints)}; choose one with --joint")


def read_log(path: Path, columns: Mapping[str, str] | None = None, joint: str | None = None) -> Log:
    """Read a CSV or NPZ log and its sidecar.

    columns: role (`time` or one of `SIGNALS`) -> column name, for one joint of a log with other names. joint: the name
    to give a joint whose columns carry none. Raises `LogError` with one line for whatever is wrong with the file.
    """
    readers = {".csv": read_csv, ".npz": read_npz}
    if path.suffix.lower() not in readers:
        raise LogError(f"{path.name}: unknown kind of log {path.suffix!r}; expected .csv, .npz or .mat")
    return assemble(path, readers[path.suffix.lower()](path), columns, joint)


def assemble(path: Path, table: Columns, columns: Mapping[str, str] | None, joint: str | None) -> Log:
    """Turn named columns into a `Log`; see `read_log`."""
    if columns:
        unknown = set(columns) - {"time", *SIGNALS}
        if unknown:
            raise LogError(f"unknown role {sorted(unknown)[0]!r}; the roles are time, {', '.join(SIGNALS)}")
        missing = [name for name in columns.values() if name not in table]
        if missing:
            raise LogError(f"{path.name}: no column {missing[0]!r}; the columns are {_listed(table)}")
        time_name = columns.get("time", "time")
        signals = {role: table[name] for role, name in columns.items() if role != "time"}
        joints = {joint or UNNAMED: JointSignals(**signals)} if signals else {}
    else:
        time_name, joints = "time", _canonical(table, joint)
    if time_name not in table:
        raise LogError(f"{path.name}: no column {time_name!r}; the columns are {_listed(table)}; map it: time=NAME")
    if not joints:
        raise LogError(
            f"{path.name}: no column position, velocity, target or torque; the columns are {_listed(table)}; "
            "name them position.<joint> and so on, or map them: position=NAME"
        )
    return Log(path.name, table[time_name], joints, read_setup(path))


def _canonical(table: Columns, joint: str | None) -> dict[str, JointSignals]:
    """Group columns `position.<joint>` by joint; bare names belong to one joint."""
    found: dict[str, Columns] = {}
    for name, values in table.items():
        signal, dot, owner = name.partition(".")
        if signal in SIGNALS:
            found.setdefault(owner if dot else (joint or UNNAMED), {})[signal] = values
    return {owner: JointSignals(**signals) for owner, signals in found.items()}


def read_csv(path: Path) -> Columns:
    """Read a comma-separated file whose first line names the columns and whose every cell is a number."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise LogError(f"{path.name}: not a text file (byte {error.start} is not UTF-8); expected CSV") from error
    if not text.strip():
        raise LogError(f"{path.name}: the file is empty; expected a header that names the columns, and rows of numbers")
    first, _, body = text.partition("\n")
    try:
        names = [name.strip() for name in next(csv.reader([first.rstrip("\r")], strict=True), [])]
    except csv.Error as error:
        raise LogError(
            f"{path.name}: the header cannot be read ({error}); expected names separated by commas"
        ) from error
    if not all(names) or not names or len(set(names)) != len(names):
        raise LogError(f"{path.name}: the header is {first[:80]!r}; expected one different name a column")
    if len(names) == 1 and (mark := next((mark for mark in ";\t" if mark in first), "")):
        raise LogError(f"{path.name}: the columns are separated by {mark!r}; expected commas, and decimal points")
    if not body.strip():
        raise LogError(f"{path.name}: no samples after the header")
    try:
        values = np.loadtxt(io.StringIO(body), delimiter=",", comments=None, ndmin=2, dtype=float)
    except ValueError as error:
        raise LogError(f"{path.name}: {_first_fault(body, names) or str(error)[:160]}") from error
    if values.shape[1] != len(names):
        raise LogError(f"{path.name}: {_first_fault(body, names)}")
    return dict(zip(names, values.T.copy(), strict=True))


def _first_fault(body: str, names: list[str]) -> str:
    """Return what is wrong with the first line that is not one number a column; the file's first line is the header."""
    for number, line in enumerate(body.split("\n"), 2):
        cells = line.split(",")
        if not line.strip():
            continue
        if len(cells) != len(names):
            return f"line {number} has {len(cells)} values, the header names {len(names)} columns"
        for name, cell in zip(names, cells, strict=True):
            try:
                float(cell)
            except ValueError:
                return f"line {number}: {cell.strip()[:40]!r} in column {name!r} is not a number"
    return ""


def read_npz(path: Path) -> Columns:
    """Read an NPZ log: its arrays must be of one length."""
    arrays = read_npz_arrays(path)
    lengths = {len(array) for array in arrays.values()}
    if len(lengths) != 1:
        raise LogError(f"{path.name}: arrays of lengths {sorted(lengths)}; expected one length for all")
    return arrays


def read_npz_arrays(path: Path) -> Columns:
    """Read the arrays of an NPZ file, each of them numbers in one dimension; pickled objects are refused."""
    if path.is_file() and not zipfile.is_zipfile(path):
        raise LogError(f"{path.name}: not an NPZ file, which is a ZIP archive of arrays; write it with numpy.savez")
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except FileNotFoundError as error:
        raise LogError(f"cannot read {path}: {error.strerror}") from error
    except _BROKEN_ARCHIVE as error:
        raise LogError(f"{path.name}: not a readable NPZ file of plain arrays ({str(error)[:120]})") from error
    for name, array in arrays.items():
        if array.ndim != 1 or array.dtype.kind not in "fiu":
            raise LogError(f"{path.name}: array {name!r} is {array.dtype} of shape {array.shape}; expected 1-D numbers")
    return {name: array.astype(float) for name, array in arrays.items()}


_BROKEN_ARCHIVE = (
    *(OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error, NotImplementedError),
    *(RuntimeError, AttributeError, SyntaxError, TypeError, MemoryError, OverflowError),
)
"""What `np.load` lets through for damaged files: from the zip reader, the inflater and the parser of array headers."""


def read_setup(path: Path) -> LogSetup:
    """Read the sidecar of a log, `LOG.json` beside `LOG.csv`; an absent one is an empty setup."""
    sidecar = path.with_suffix(".json")
    if not sidecar.is_file():
        return LogSetup()
    try:
        data = json.loads(sidecar.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, ValueError, RecursionError) as error:
        raise LogError(f"{sidecar.name}: not readable as JSON ({str(error)[:120]})") from error
    return setup_from_dict(data, sidecar.name)


def setup_from_dict(data: Any, source: str) -> LogSetup:
    """Build a setup from plain data; `source` is named in messages."""
    names = [item.name for item in fields(LogSetup)]
    if isinstance(data, dict) and {"schema_version", "joints"} <= data.keys():
        raise LogError(
            f"{source}: this is a result of `stiction identify`, found where the log's sidecar belongs; "
            "rename the log, or move the result to a folder of its own"
        )
    if not isinstance(data, dict) or set(data) - set(names):
        raise LogError(f"{source}: expected an object with some of the fields {', '.join(names)}, got {str(data)[:80]}")
    choices = {"torque_source": TORQUE_SOURCES, "test_condition": TEST_CONDITIONS, "axis": AXES}
    for name, value in data.items():
        allowed = choices.get(name)
        if value is None:
            continue
        if allowed is not None and value not in allowed:
            raise LogError(f"{source}: {name} is {value!r}; expected one of {', '.join(allowed)}")
        if allowed is None and (
            isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value)
        ):
            raise LogError(f"{source}: {name} is {value!r}; expected a number")
    return LogSetup(**data)


TORQUE_SOURCES = ("motor_side", "output_side")
TEST_CONDITIONS = ("bare_motor", "in_air", "loaded")
AXES = ("rotary", "linear")


def write_log(path: Path, log: Log) -> None:
    """Write a log as CSV or NPZ, by the name of the file, and its sidecar if there is anything to say."""
    table = {"time": log.time}
    for joint, signals in log.joints.items():
        for name in SIGNALS:
            values = getattr(signals, name)
            if values is not None:
                table[f"{name}.{joint}"] = values
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix.lower() == ".npz":
        np.savez_compressed(path, allow_pickle=False, **table)
    elif path.suffix.lower() == ".csv":
        np.savetxt(
            path, np.column_stack(list(table.values())), fmt="%.9g", delimiter=",", header=",".join(table), comments=""
        )
    else:
        raise LogError(f"{path.name}: cannot write {path.suffix!r}; expected .csv or .npz")
    setup = {name: value for name, value in asdict(log.setup).items() if value is not None}
    if setup:
        path.with_suffix(".json").write_text(json.dumps(setup, indent=2) + "\n", encoding="utf-8")


def _listed(table: Columns) -> str:
    """Return the column names for a message, shortened if there are many."""
    names = list(table)
    return ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "")
