"""Canonical log of one or more joints: CSV, NPZ or Parquet, with an optional sidecar for values outside the columns.

Columns are `time` [s] and, per joint, `position.<joint>` [rad], `velocity.<joint>` [rad/s], `target.<joint>` [rad],
`torque.<joint>` [N m], `disturbance.<joint>` [N m] (from outside), `feedforward.<joint>` [N m] (added by the
controller), those that exist; a log of a single joint may drop the joint's name. The sidecar of `swing.csv` is
`swing.json` (`stiction.files.log`). Nothing that executes code is ever read.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from stiction.core.decode import from_plain, short
from stiction.core.errors import LogError, escaped, unknown_name
from stiction.core.files import write_text
from stiction.core.names import kind_of
from stiction.files.plain import read_object
from stiction.files.tables import Columns, Table, publish_npz, read_npz, read_parquet, write_csv, write_parquet
from stiction.files.text import read_csv
from stiction.joints.pd import TorqueSource

TestCondition = Literal["bare_motor", "in_air", "loaded"]
Axis = Literal["rotary", "linear"]
TorqueColumn = Literal["torque", "current", "voltage", "duty"]


WHOLE_LOG = ("rate", "names", "joints", "columns", "time_scale", "begin", "end")
"""Fields of the whole log, which cannot be set per joint."""

WRITTEN = {"from": "begin", "to": "end"}
"""Name in the file, and on the command line -> field, where the name is a word of Python."""

UNKNOWNS = ("encoder_bias",)
"""Further unknowns that output error can estimate."""

MOST_JOINTS = 256
"""Maximum number of joints, and of names in a sidecar."""

LARGEST_SIDECAR = 2**20
"""Maximum size of a sidecar [B]."""

LARGEST_NUMBER = 1e12
"""Maximum of a physical quantity in its unit."""


@dataclass(frozen=True, kw_only=True)
class LogSetup:
    """Conditions of a log; a missing field is None."""

    kp: float | None = None
    """Proportional gain of the joint controller [N m/rad]."""
    kd: float | None = None
    """Derivative gain [N m s/rad]."""
    walking_kp: float | None = None
    """Proportional gain with which the robot walks [N m/rad], where the log was made with another."""
    torque_limit: float | None = None
    """Torque limit of the motor [N m]."""
    torque_source: TorqueSource | None = None
    """`motor_side` (joint friction not in it: motor current or command) or `output_side` (sensor after the gear)."""
    test_condition: TestCondition | None = None
    """`bare_motor`, `in_air` or `loaded`."""
    axis: Axis | None = None
    """`rotary` or `linear` (then read N for N m, m for rad, kg for kg m²)."""
    motor_strength: float | None = None
    """k: delivered over logged or commanded torque [1]."""
    delay: float | None = None
    """Delay of the whole loop, from command to torque [s]."""
    torque_calibrated: bool | None = None
    """False: the unit of the torque column is unknown."""
    payload_mass: float | None = None
    """Mass of a known load [kg]."""
    payload_distance: float | None = None
    """Distance of its centre of mass from the joint's axis [m]."""
    payload_angle: float | None = None
    """Angle of the joint at which the load hangs straight down [rad]."""
    pendulum_mass: float | None = None
    """Mass of all links and loads on the joint [kg]."""
    pendulum_length: float | None = None
    """Distance of its centre of mass from the joint's axis [m]."""
    pendulum_angle: float | None = None
    """Angle of the joint at which it hangs straight down [rad]; by default estimated from the log."""
    torque_column: TorqueColumn | None = None
    """`torque`, `current`, `voltage` or `duty`: quantity in the torque column, times the scale."""
    duty_voltage: float | None = None
    """Voltage at a duty of 1 [V]."""
    kt: float | None = None
    """Torque constant at the joint, gear included [N m/A]."""
    resistance: float | None = None
    """Resistance of the motor and its driver [Ω]."""
    ke: float | None = None
    """Back-EMF constant at the joint [V s/rad]; by default kt."""
    torque_scale: float | None = None
    """Scale of the torque column: N m (or N) per unit; A, V or a share where it holds those."""
    disturbance_scale: float | None = None
    """Scale of the disturbance column: N m (or N) per unit."""
    feedforward_scale: float | None = None
    """Scale of the feedforward column: N m (or N) per unit."""
    position_scale: float | None = None
    """Scale of position, target and velocity: rad (or m) per unit; 0.0174533 for degrees, one over the gear ratio for a
    motor's angle."""
    velocity_delay: float | None = None
    """Delay of the velocity that the controller uses [s]."""
    hanging_angle: float | None = None
    """Angle of the joint at which the link hangs straight down [rad]."""
    gravity: bool | None = None
    """True if gravity on the link is fitted."""
    cutoff: float | None = None
    """Corner frequency of the filter [Hz]."""
    unknowns: tuple[str, ...] = ()
    """Further unknowns of output error: `delay`, `encoder_bias`."""
    rate: float | None = None
    """Sampling rate of a log without a time column [Hz]."""
    time_scale: float | None = None
    """Scale of the time stamps: seconds per unit."""
    begin: float | None = None
    """Begin of the used part, from the first stamp [s]; `from` in the file."""
    end: float | None = None
    """End of the used part, from the first stamp [s]; `to` in the file."""
    columns: Mapping[str, str] = field(default_factory=dict)
    """Role -> column, columns or pattern, or topic; as for --columns."""
    names: tuple[str, ...] = ()
    """Names of the joints of a log with numbered joints, in its order."""
    joints: Mapping[str, LogSetup] = field(default_factory=dict)
    """Joint name, or kind of joint (`FL_calf` is a `calf`) -> its different settings."""

    def of_joint(self, joint: str) -> LogSetup:
        """Return the setup of one joint: that of the whole log, then its kind's fields, then its name's."""
        merged = replace(self, joints={})
        for name in dict.fromkeys((kind_of(joint), joint)):
            if name in self.joints:
                # False and 0 are said; only None and an empty tuple are not.
                settings = vars(self.joints[name]).items()
                merged = replace(merged, **{k: v for k, v in settings if k not in WHOLE_LOG and v not in (None, ())})
        return merged

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON, without unset fields."""
        data = {key: value for key, value in asdict(self).items() if value is not None and value != () and value != {}}
        data |= {written: data.pop(name) for written, name in WRITTEN.items() if name in data}
        data |= {name: list(data[name]) for name in ("names", "unknowns") if name in data}
        if self.joints:
            data["joints"] = {name: setup.to_dict() for name, setup in self.joints.items()}
        return data


def read_setup(path: Path) -> LogSetup:
    """Read the sidecar of a log, `LOG.json` next to `LOG.csv`; an absent one is an empty setup."""
    return read_sidecar(sidecar) if (sidecar := sidecar_of(path)).is_file() else LogSetup()


def read_sidecar(sidecar: Path) -> LogSetup:
    """Read a sidecar; raise `LogError` for another file."""
    data = read_object(sidecar, "the sidecar of a log", LogError, LARGEST_SIDECAR)
    return setup_from_dict(data, sidecar.name)


def setup_from_dict(data: Any, source: str) -> LogSetup:
    """Build a setup from plain data; messages name `source`. Raises `LogError` naming the field."""
    if isinstance(data, dict) and {"schema_version", "joints"} <= data.keys():
        raise LogError(
            f"{source}: this is a result of `stiction identify`, found where the log's sidecar belongs; "
            "rename the log, or move the result to a folder of its own"
        )
    return _build(data, source, tuple(item.name for item in fields(LogSetup)))


def _build(data: Any, source: str, allowed: tuple[str, ...]) -> LogSetup:
    """Build a setup, or the part of one joint, which may have only the fields `allowed`."""
    if not isinstance(data, dict):
        raise LogError(f"{source}: expected an object: field -> value, got {short(data)}")
    fields_set: dict[str, Any] = data
    _check_names(data, source, allowed)
    values = {WRITTEN.get(name, name): value for name, value in fields_set.items() if value is not None}
    parts = values.pop("joints", {})
    setup = from_plain(LogSetup, values, source, LogError)
    for name in values:
        _check_field(name, getattr(setup, name), source)
    if not isinstance(parts, dict):
        raise LogError(f"{source}: joints is {short(parts)}; expected an object: joint name or kind -> its fields")
    if len(parts) > MOST_JOINTS:
        raise LogError(f"{source}: joints has {len(parts)} entries; expected at most {MOST_JOINTS}")
    settable = tuple(name for name in allowed if name not in WHOLE_LOG)
    return replace(
        setup, joints={name: _build(part, f"{source}: joint {name!r}", settable) for name, part in parts.items()}
    )


def _check_names(data: Mapping[str, Any], source: str, allowed: tuple[str, ...]) -> None:
    """Reject unknown fields and fields that cannot be set per joint."""
    named = {field: written for written, field in WRITTEN.items()}
    for name in data:
        if name in named:
            raise LogError(f"{source}: unknown field {name!r}: write {named[name]!r}")
        if (field := WRITTEN.get(name, name)) in allowed:
            continue
        if field in WHOLE_LOG:
            raise LogError(f"{source}: {name} is of the whole log, not of a joint; set it outside `joints`")
        raise LogError(f"{source}: {unknown_name('field', name, (named.get(known, known) for known in allowed))}")


def _check_field(name: str, value: Any, source: str) -> None:
    """Reject a number without physical size, repeated names, and too many names."""
    if isinstance(value, float) and not abs(value) < LARGEST_NUMBER:
        raise LogError(f"{source}: {name} is {value}; expected a number of a physical size")
    if name == "columns" and (len(value) > 2 * len(SIGNALS + BODY) or not all(value.values())):
        raise LogError(f"{source}: columns is {short(value)}; expected an object: role -> column, as --columns has it")
    if name not in ("names", "unknowns"):
        return
    if not all(value):
        raise LogError(f"{source}: {name} has an empty name; expected names")
    if len(value) > MOST_JOINTS:
        raise LogError(f"{source}: {name} has {len(value)} entries; expected at most {MOST_JOINTS}")
    if len(set(value)) != len(value):
        raise LogError(f"{source}: {name} has {max(value, key=value.count)!r} twice; expected different names")
    if name == "unknowns" and (odd := sorted(set(value) - set(UNKNOWNS))):
        raise LogError(f"{source}: {unknown_name('unknown', odd[0], UNKNOWNS)}")


SIGNALS = ("position", "velocity", "target", "torque", "disturbance", "feedforward")

UNNAMED = "joint"
"""Name of a joint without one in the columns or options."""


@dataclass(frozen=True)
class JointSignals:
    """Signals of one joint, each of shape (num_samples,); signals not logged are None."""

    position: np.ndarray | None = None
    """θ [rad]."""
    velocity: np.ndarray | None = None
    """θ' [rad/s]."""
    target: np.ndarray | None = None
    """a, the commanded position [rad]."""
    torque: np.ndarray | None = None
    """τ [N m]."""
    disturbance: np.ndarray | None = None
    """d, a known torque on the joint from outside, positive in the position's direction [N m]."""
    feedforward: np.ndarray | None = None
    """u, torque that the controller adds to that of its gains; a logged torque includes it [N m]."""


BODY = ("quaternion", "gyroscope", "accelerometer", "foot_force")


@dataclass(frozen=True)
class BodySignals:
    """Measurements of the body of a walking robot, as logged, T samples; signals not logged are None."""

    quaternion: np.ndarray | None = None
    """Orientation estimated by the IMU, w x y z, shape (T, 4)."""
    gyroscope: np.ndarray | None = None
    """Angular velocity in the IMU's frame [rad/s], shape (T, 3)."""
    accelerometer: np.ndarray | None = None
    """Specific force in the IMU's frame [m/s²], shape (T, 3)."""
    foot_force: np.ndarray | None = None
    """Signal that grows with the load of each foot, in any unit, or 1 in contact, shape (T, F)."""
    foot_names: tuple[str, ...] = ()
    """Names of the F feet; empty where the log only numbers them."""
    period: float | None = None
    """Time between two messages of the IMU, if they came separately from the joints' [s]."""

    def each(self, change: Callable[[np.ndarray], np.ndarray]) -> BodySignals:
        """Return the signals, each transformed."""
        signals: dict[str, Any] = {n: change(values) for n in BODY if (values := getattr(self, n)) is not None}
        return replace(self, **signals)


@dataclass(frozen=True, repr=False)
class Log:
    """Log as read: not resampled, not filtered."""

    source: str
    time: np.ndarray
    """Time stamps [s], shape (num_samples,)."""
    joints: dict[str, JointSignals]
    setup: LogSetup = field(default_factory=LogSetup)
    notes: tuple[str, ...] = ()
    """Notes for readers of the results on how the file was read; one sentence each."""
    start: float = 0.0
    """Time subtracted from the time stamps of the file [s]: those of another part of the same log continue from
    there."""
    body: BodySignals | None = None
    """Measurements of the body; None unless requested."""
    robot: str | None = None
    """Name of the robot, where the log has it."""

    def __repr__(self) -> str:
        """Return its length, the signals of each joint, the settings of the motors, and the notes; a line each."""
        span = f"{self.time[-1] - self.time[0]:.4g} s" if len(self.time) else "nothing"
        lines = [f"{self.source}: {len(self.time)} samples, {span}"]
        for name, signals in self.joints.items():
            lines.append(f"{name}: {', '.join(role for role in SIGNALS if getattr(signals, role) is not None)}")
        settings = ", ".join(f"{name} {value}" for name, value in self.setup.to_dict().items())
        return escaped("\n".join([*lines, f"said: {settings or 'no gains, no torque limit'}", *self.notes]))

    def joint(self, name: str | None) -> tuple[str, JointSignals]:
        """Return a joint by name, or the only one for None; raise `LogError` with the known names."""
        if name is None and len(self.joints) == 1:
            return next(iter(self.joints.items()))
        if name is not None and name in self.joints:
            return name, self.joints[name]
        none = f"no joint was chosen; known: {', '.join(self.joints)}"
        cause = none if name is None else unknown_name("joint", name, self.joints)
        raise LogError(f"{self.source}: {cause}; choose one with --joint")

    def setup_of(self, joint: str) -> LogSetup:
        """Return the setup of one joint: the log's, then the sidecar's for its kind, then for its name."""
        return self.setup.of_joint(joint)


TEXT = (".csv", ".tsv", ".txt", ".dat", ".log", ".csv.gz", ".tsv.gz", ".txt.gz")
"""Suffixes of tables of text."""


def suffix_of(path: Path) -> str:
    """Return a file's suffix, in lower case, with the suffix before .gz."""
    name = path.name.lower()
    return Path(name.removesuffix(".gz")).suffix + ".gz" * name.endswith(".gz")


def sidecar_of(path: Path) -> Path:
    """Return the path of a log's sidecar: `swing.json` of `swing.csv`, `swing.csv.gz`; `swing.sidecar.json` of
    `swing.json`.
    """
    stem = Path(path.name.removesuffix(".gz")).stem
    return path.with_name(f"{stem}.sidecar.json" if suffix_of(path).startswith(".json") else f"{stem}.json")


def read_table(path: Path) -> Table:
    """Read the columns of a file of text, NPZ or Parquet, with the notes on them. Raises `LogError`."""
    readers = {**dict.fromkeys(TEXT, read_csv), ".npz": read_npz, ".parquet": read_parquet}
    if (suffix := suffix_of(path)) not in readers:
        raise LogError(f"{path.name}: unknown kind of table {path.suffix!r}; expected .csv, .npz or .parquet")
    return readers[suffix](path)


def by_joint(table: Columns, joint: str | None) -> dict[str, JointSignals]:
    """Group columns `position.<joint>` by joint; bare names belong to one joint, `joint` or `UNNAMED`."""
    groups: dict[str, Columns] = {}
    for name, values in table.items():
        signal, dot, owner = name.partition(".")
        if signal in SIGNALS:
            groups.setdefault(owner if dot and owner else (joint or UNNAMED), {})[signal] = values
    return {owner: JointSignals(**signals) for owner, signals in groups.items()}


def write_log(path: Path, log: Log) -> None:
    """Write a log as CSV, NPZ or Parquet, by its suffix, and its sidecar if any setting is known."""
    writers: dict[str, Callable[[Path, Columns], None]] = {".csv": write_csv, ".parquet": write_parquet}
    writers[".npz"] = partial(publish_npz, compressed=True)
    if path.suffix.lower() not in writers:
        raise LogError(f"{path.name}: cannot write {path.suffix!r}; expected .csv, .npz or .parquet")
    table = {"time": log.time}
    for joint, signals in log.joints.items():
        table |= {f"{name}.{joint}": v for name in SIGNALS if (v := getattr(signals, name)) is not None}
    writers[path.suffix.lower()](path, table)
    if setup := log.setup.to_dict():
        write_text(path.with_suffix(".json"), json.dumps(setup, indent=2) + "\n")


def listed(table: Columns) -> str:
    """Return the column names for a message, shortened if there are many."""
    names = list(table)
    return ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "")
