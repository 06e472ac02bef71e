"""The canonical log of one or more joints: CSV, NPZ or Parquet, with an optional sidecar of what columns cannot say.

Columns are `time` [s] and, per joint, `position.<joint>` [rad], `velocity.<joint>` [rad/s], `target.<joint>` [rad],
`torque.<joint>` [N m], `disturbance.<joint>` [N m] (from outside), `feedforward.<joint>` [N m] (added by the
controller), those that exist; a log of a single joint may drop the joint's name. The sidecar of `swing.csv` is
`swing.json` (`stiction.formats.log`). Nothing that executes code is ever read.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import LogError, unknown_name
from stiction.core.names import kind_of
from stiction.formats.plain import is_number, read_object
from stiction.formats.tables import Columns, read_csv, read_npz, read_parquet, write_csv, write_npz, write_parquet
from stiction.joints.net import TORQUE_SOURCES

TEST_CONDITIONS = ("bare_motor", "in_air", "loaded")
AXES = ("rotary", "linear")

CHOICES = {"torque_source": TORQUE_SOURCES, "test_condition": TEST_CONDITIONS, "axis": AXES}
"""Field -> the words that it may be."""

WHOLE_LOG = ("rate", "names", "joints")
"""Fields that hold for the whole log: no joint has its own."""

LARGEST_SIDECAR = 2**20
"""Nobody writes more by hand [B]."""

LARGEST_NUMBER = 1e12
"""Nothing physical has more, in its unit."""


@dataclass(frozen=True)
class LogSetup:
    """How a log was made; a missing field is None."""

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
    motor_strength: float | None = None
    """k: torque delivered over torque logged or commanded [1]."""
    delay: float | None = None
    """Delay of the whole loop, from command to torque [s]."""
    torque_calibrated: bool | None = None
    """False: the unit of the torque column is not known."""
    payload_mass: float | None = None
    """Mass of a known load [kg]."""
    payload_distance: float | None = None
    """Distance of its centre of mass from the joint's axis [m]."""
    payload_angle: float | None = None
    """Angle of the joint at which the load hangs straight down [rad]."""
    rate: float | None = None
    """Samples per second of a log without a time column [Hz]."""
    names: tuple[str, ...] = ()
    """Names of the joints of a log that only numbers them, in its order."""
    joints: Mapping[str, LogSetup] = field(default_factory=dict)
    """Joint name, or kind of joint (`FL_calf` is a `calf`) -> what is different for it."""

    def of_joint(self, joint: str) -> LogSetup:
        """Return the setup of one joint: what holds for all, then its kind's fields, then its own."""
        merged = replace(self, joints={})
        for name in dict.fromkeys((kind_of(joint), joint)):
            if name in self.joints:
                own = {item.name: getattr(self.joints[name], item.name) for item in fields(LogSetup)}
                merged = replace(
                    merged, **{key: own[key] for key in own if key not in WHOLE_LOG and own[key] is not None}
                )
        return merged

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON, without the fields that say nothing."""
        data = {key: value for key, value in asdict(self).items() if value is not None and value != () and value != {}}
        if self.names:
            data["names"] = list(self.names)
        if self.joints:
            data["joints"] = {name: setup.to_dict() for name, setup in self.joints.items()}
        return data


def read_setup(path: Path) -> LogSetup:
    """Read the sidecar of a log, `LOG.json` beside `LOG.csv`; an absent one is an empty setup."""
    sidecar = path.with_suffix(".json")
    return read_sidecar(sidecar) if sidecar.is_file() else LogSetup()


def read_sidecar(sidecar: Path) -> LogSetup:
    """Read a sidecar; raise `LogError` for a file that is none."""
    data = read_object(sidecar, "the sidecar of a log", LogError, LARGEST_SIDECAR)
    return setup_from_dict(data, sidecar.name)


def setup_from_dict(data: Any, source: str) -> LogSetup:
    """Build a setup from plain data; `source` is named in messages. Raises `LogError` naming the field."""
    if isinstance(data, dict) and {"schema_version", "joints"} <= data.keys():
        raise LogError(
            f"{source}: this is a result of `stiction identify`, found where the log's sidecar belongs; "
            "rename the log, or move the result to a folder of its own"
        )
    return _build(data, source, tuple(item.name for item in fields(LogSetup)))


def _build(data: Any, source: str, allowed: tuple[str, ...]) -> LogSetup:
    """Build a setup, or the part of one joint, of which only the fields `allowed` may be given."""
    if not isinstance(data, dict) or set(data) - set(allowed):
        raise LogError(
            f"{source}: expected an object with some of the fields {', '.join(allowed)}, got {str(data)[:80]}"
        )
    values = {name: value for name, value in data.items() if value is not None}
    for name, value in values.items():
        if name == "names":
            values[name] = _names(value, source)
        elif name == "joints":
            values[name] = _joints(value, source, tuple(item for item in allowed if item not in WHOLE_LOG))
        else:
            _check_field(name, value, source)
    return LogSetup(**values)


def _check_field(name: str, value: Any, source: str) -> None:
    """Refuse a word that is not one of the field's, and what is not a finite number where one belongs."""
    words = CHOICES.get(name)
    if words is not None:
        if value not in words:
            raise LogError(f"{source}: {name} is {str(value)[:80]!r}; expected one of {', '.join(words)}")
    elif name == "torque_calibrated":
        if not isinstance(value, bool):
            raise LogError(f"{source}: {name} is {str(value)[:80]!r}; expected true or false")
    elif not is_number(value, LARGEST_NUMBER):
        raise LogError(f"{source}: {name} is {str(value)[:80]!r}; expected a number of a physical size")


def _names(value: Any, source: str) -> tuple[str, ...]:
    """Return the names of joints, each different."""
    if not isinstance(value, list) or not all(isinstance(name, str) and name for name in value):
        raise LogError(f"{source}: names is {str(value)[:80]}; expected a list of joint names")
    if len(set(value)) != len(value):
        raise LogError(f"{source}: names has {max(value, key=value.count)!r} twice; expected different names")
    return tuple(value)


def _joints(value: Any, source: str, allowed: tuple[str, ...]) -> dict[str, LogSetup]:
    """Return the setups of single joints or kinds."""
    if not isinstance(value, dict):
        raise LogError(f"{source}: joints is {str(value)[:80]}; expected an object: joint name or kind -> its fields")
    return {name: _build(entry, f"{source}: joint {name!r}", allowed) for name, entry in value.items()}


SIGNALS = ("position", "velocity", "target", "torque", "disturbance", "feedforward")
"""What a log may hold per joint."""

UNNAMED = "joint"
"""Name of a joint that neither the columns nor the user named."""


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
    disturbance: np.ndarray | None = None
    """d, a known torque on the joint from outside, positive in the position's direction [N m]."""
    feedforward: np.ndarray | None = None
    """u, torque that the controller adds to that of its gains; a logged torque has it in it already [N m]."""


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
    notes: tuple[str, ...] = ()
    """What a reader of the results should know about how the file was read; each one sentence."""

    def joint(self, name: str | None) -> tuple[str, JointSignals]:
        """Return a joint by name, or the only one for None; raise `LogError` naming what there is."""
        if name is None and len(self.joints) == 1:
            return next(iter(self.joints.items()))
        if name is not None and name in self.joints:
            return name, self.joints[name]
        none = f"no joint was chosen; known: {', '.join(self.joints)}"
        asked = none if name is None else unknown_name("joint", name, self.joints)
        raise LogError(f"{self.source}: {asked}; choose one with --joint")

    def setup_of(self, joint: str) -> LogSetup:
        """Return the setup of one joint: the log's, then what the sidecar says of its kind, then of itself."""
        return self.setup.of_joint(joint)


def read_table(path: Path) -> tuple[Columns, tuple[str, ...]]:
    """Read the named columns of a CSV, NPZ or Parquet file, and notes on how that went. Raises `LogError`."""
    suffix = path.suffix.lower()
    if suffix == ".csv":
        return read_csv(path)
    if suffix == ".npz":
        return read_npz(path), ()
    if suffix == ".parquet":
        return read_parquet(path), ()
    raise LogError(f"{path.name}: unknown kind of table {path.suffix!r}; expected .csv, .npz or .parquet")


def by_joint(table: Columns, joint: str | None) -> dict[str, JointSignals]:
    """Group columns `position.<joint>` by joint; bare names belong to one joint, `joint` or `UNNAMED`."""
    found: dict[str, Columns] = {}
    for name, values in table.items():
        signal, dot, owner = name.partition(".")
        if signal in SIGNALS:
            found.setdefault(owner if dot and owner else (joint or UNNAMED), {})[signal] = values
    return {owner: JointSignals(**signals) for owner, signals in found.items()}


def write_log(path: Path, log: Log) -> None:
    """Write a log as CSV, NPZ or Parquet, by the name of the file, and its sidecar if there is anything to say."""
    writers = {".csv": write_csv, ".npz": write_npz, ".parquet": write_parquet}
    if path.suffix.lower() not in writers:
        raise LogError(f"{path.name}: cannot write {path.suffix!r}; expected .csv, .npz or .parquet")
    table = {"time": log.time}
    for joint, signals in log.joints.items():
        for name in SIGNALS:
            values = getattr(signals, name)
            if values is not None:
                table[f"{name}.{joint}"] = values
    path.parent.mkdir(parents=True, exist_ok=True)
    writers[path.suffix.lower()](path, table)
    setup = log.setup.to_dict()
    if setup:
        path.with_suffix(".json").write_text(json.dumps(setup, indent=2) + "\n", encoding="utf-8")


def listed(table: Columns) -> str:
    """Return the column names for a message, shortened if there are many."""
    names = list(table)
    return ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "")
