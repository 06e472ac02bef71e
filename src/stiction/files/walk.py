"""Log of a walking robot: measurements of its joints, its IMU and its feet, and their conditions. NPZ, never pickled.

Every stage that has a robot walk writes this form, in simulation and on hardware, and every stage that learns from a
walk reads it. Quantities unknown on a robot, such as the friction of its joints, are left out on purpose in simulation
too: identification must not use them.

The archive holds one array per field of `WalkLog` that is not None, with the field's name, and `header`, a text: a JSON
object with `schema`, `schema_version`, and every field of `WalkHeader`.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path

import numpy as np

from stiction.core.decode import from_plain, is_number, is_text
from stiction.core.errors import FileError, LogError, StictionError
from stiction.files.tables import BROKEN_ARCHIVE, publish_npz, read_header, read_npz_arrays, write_header
from stiction.joints.net import TORQUE_SOURCES, TorqueSource


@dataclass(frozen=True)
class Recording:
    """Motion of N robots in T control steps."""

    period: float
    """Control period [s]."""
    velocity: np.ndarray
    """Forward and sideways velocity of the base [m/s] and its yaw rate [rad/s], base frame, shape (T, N, 3)."""
    position: np.ndarray
    """Horizontal position of the base in the world [m], shape (T, N, 2)."""
    contact: np.ndarray
    """Feet on the ground, bool, shape (T, N, L)."""
    power: np.ndarray
    """Sum over joints of |torque * joint velocity| [W], shape (T, N)."""
    square_acceleration: np.ndarray
    """Mean over joints of the squared change of joint velocity since the last step over `period` [rad²/s⁴], shape
    (T, N)."""
    upright: np.ndarray
    """False from the step of a fall on, bool, shape (T, N)."""
    friction: np.ndarray | None = None
    """Dry friction available at the joints, mean over joints [N m], shape (T, N); None if not recorded."""
    square_chatter: np.ndarray | None = None
    """Mean over joints and physics steps of the squared joint acceleration [rad²/s⁴], shape (T, N); None if not
    recorded."""

    @property
    def signals(self) -> dict[str, np.ndarray]:
        """Recorded signals, by name."""
        return {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}

    def of(self, robots: slice, first_step: int = 0, end: int | None = None) -> Recording:
        """Return the recording of some robots, from a step on and before `end`."""
        return self._each(lambda values: values[first_step:end, robots])

    def extended(self, steps: int) -> Recording:
        """Return the recording extended to a number of steps, as in a batch: a fallen robot stays where it is."""
        more = steps - len(self.upright)
        longer = self._each(lambda values: np.concatenate((values, np.repeat(values[-1:], more, axis=0))))
        longer.upright[len(self.upright) :] = False
        return longer

    def _each(self, change: Callable[[np.ndarray], np.ndarray]) -> Recording:
        return replace(self, **{name: change(value) for name, value in self.signals.items()})  # type: ignore[arg-type]


SCHEMA = "stiction-walk"

SCHEMA_VERSION = 1

LARGEST = 1e6

LARGEST_JITTER = 0.5
"""Maximum deviation of a time step from the period, in periods: beyond, samples were dropped or doubled."""


@dataclass(frozen=True)
class WalkHeader:
    """Description of a walking log."""

    robot: str
    joint_names: tuple[str, ...]
    """Names of the joints, in the order of every signal over joints: `FL_hip`, ..."""
    foot_names: tuple[str, ...]
    """Names of the feet, in the order of `foot_contact`: `FL_foot`, ..."""
    period: float
    """Time between two samples [s]."""
    kp: tuple[float, ...]
    """Proportional gains of the joint controllers [N m/rad]."""
    kd: tuple[float, ...]
    """Derivative gains of the joint controllers [N m s/rad]."""
    torque_limit: tuple[float, ...]
    """Torque limits of the motors [N m]."""
    torque_source: TorqueSource | None = None
    """`motor_side` (current or command: joint friction not in it) or `output_side` (behind the gear: in it); None if
    not declared."""
    recorded_in: str = "robot"
    """`robot`, or the engine of the simulation: `mujoco`."""
    policy: str = ""
    """Name of the walking policy, or empty."""
    command: str = ""
    """Commanded velocity, if constant: `vx=0.5`."""
    noise: dict[str, float] = field(default_factory=dict)
    """Name of a sensor's error -> its size, as far as known: in a simulated log the added one, on a robot the data
    sheet's."""

    def __post_init__(self) -> None:
        texts = (self.robot, self.recorded_in)
        _expect(all(map(is_text, texts)), "robot, recorded_in", texts, "texts")
        for name in ("joint_names", "foot_names"):
            value = getattr(self, name)
            different = all(map(is_text, value)) and len(set(value)) == len(value)
            _expect(different and (len(value) > 0 or name == "foot_names"), name, value, "different names")
        _expect(is_number(self.period) and 1e-5 <= self.period <= 0.1, "period", self.period, "1e-5 to 0.1 s")
        for name, least in (("kp", 0.0), ("kd", 0.0), ("torque_limit", 1e-9)):
            value = getattr(self, name)
            right = len(value) == len(self.joint_names) and all(is_number(n) and n >= least for n in value)
            _expect(right, name, value, f"{len(self.joint_names)} numbers of at least {least:g}, one per joint")
        sources = (*TORQUE_SOURCES, None)
        _expect(self.torque_source in sources, "torque_source", self.torque_source, " or ".join(TORQUE_SOURCES))
        _expect(all(isinstance(t, str) for t in (self.policy, self.command)), "policy, command", self.policy, "texts")
        named = isinstance(self.noise, dict) and all(map(is_number, self.noise.values()))
        _expect(named, "noise", self.noise, "an object of numbers")


@dataclass(frozen=True)
class WalkLog:
    """Walk of one robot: T samples, J joints, L feet. Signals not measured are None."""

    header: WalkHeader
    time: np.ndarray
    """Time since the start [s], one period apart, shape (T,)."""
    joint_position: np.ndarray
    """Measured angles [rad], shape (T, J)."""
    joint_velocity: np.ndarray
    """Measured velocities [rad/s], shape (T, J)."""
    joint_target: np.ndarray
    """Joint targets of the policy [rad], shape (T, J)."""
    angular_velocity: np.ndarray
    """Gyroscope: angular velocity of the base in the base frame [rad/s], shape (T, 3)."""
    quaternion: np.ndarray
    """Orientation of the base estimated by the IMU, w x y z, shape (T, 4)."""
    joint_torque: np.ndarray | None = None
    """Torque of the motors at the joint, mean over the following period [N m], shape (T, J)."""
    specific_force: np.ndarray | None = None
    """Accelerometer at the base's origin: acceleration minus gravity, base frame [m/s²], shape (T, 3)."""
    linear_velocity: np.ndarray | None = None
    """Velocity of the base in the base frame, if measured [m/s], shape (T, 3)."""
    foot_contact: np.ndarray | None = None
    """True for each foot that bears load, bool, shape (T, L)."""
    velocity_command: np.ndarray | None = None
    """Commanded velocity: forward, sideways [m/s], turn [rad/s], shape (T, 3)."""

    def __post_init__(self) -> None:
        joints, feet = len(self.header.joint_names), len(self.header.foot_names)
        widths = {name: joints for name in ("joint_position", "joint_velocity", "joint_target", "joint_torque")}
        widths |= {"quaternion": 4, "foot_contact": feet}
        samples = len(self.time) if isinstance(self.time, np.ndarray) and self.time.ndim == 1 else 0
        _expect(samples >= 2, "time", samples, "at least two samples in one dimension")
        for name in SIGNALS:
            array = getattr(self, name)
            if array is None and name in OPTIONAL:
                continue
            shape = (samples,) if name == "time" else (samples, widths.get(name, 3))
            kind = "b" if name == "foot_contact" else "f"
            right = isinstance(array, np.ndarray) and array.shape == shape and array.dtype.kind == kind
            got = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else type(array).__name__
            _expect(right, name, got, f"{'bool' if kind == 'b' else 'float'} {shape}")
            sane = kind == "b" or bool((np.abs(array) <= LARGEST).all())
            _expect(sane, name, "not finite, or huge", f"finite numbers of at most {LARGEST:g}")
        uneven = float(np.abs(np.diff(self.time) / self.header.period - 1).max())
        expected = f"{self.header.period} s, the period, within {LARGEST_JITTER:.0%}"
        _expect(uneven <= LARGEST_JITTER, "time", f"uneven by {uneven:.3g} periods", expected)
        length = np.linalg.norm(self.quaternion, axis=1)
        _expect(bool(np.abs(length - 1).max() < 0.01), "quaternion", "not of length 1", "unit quaternions w x y z")

    def __len__(self) -> int:
        return len(self.time)


SIGNALS = tuple(item.name for item in fields(WalkLog) if item.name != "header")

OPTIONAL = ("joint_torque", "specific_force", "linear_velocity", "foot_contact", "velocity_command")


def _expect(condition: bool, name: str, value: object, expected: str) -> None:
    if not condition:
        raise LogError(f"walking log, field {name!r}: {str(value)[:80]}; expected {expected}")


def write_walk(path: Path, log: WalkLog) -> None:
    """Write a log as NPZ, atomically: signals in single precision, time in double."""
    publish_npz(path, _arrays(log), compressed=True)


def has_walk(path: Path, log: WalkLog) -> bool:
    """Return whether a file is this log, as `write_walk` writes it, number for number."""
    try:
        saved = read_npz_arrays(path)
    except StictionError:
        return False
    both = [{n: (a.dtype, a.shape, a.tobytes()) for n, a in arrays.items()} for arrays in (saved, _arrays(log))]
    return both[0] == both[1]


def _arrays(log: WalkLog) -> dict[str, np.ndarray]:
    # Sensors have fewer digits than single precision; time has more.
    arrays = {
        name: array if array.dtype == bool or name == "time" else array.astype(np.float32)
        for name in SIGNALS
        if (array := getattr(log, name)) is not None
    }
    return arrays | {"header": write_header(SCHEMA, SCHEMA_VERSION, asdict(log.header))}


def is_walk(path: Path) -> bool:
    """Return whether a file looks like a walking log: an archive with a `header` and a `quaternion`."""
    try:
        with zipfile.ZipFile(path) as archive:
            return {"header.npy", "quaternion.npy"} <= set(archive.namelist())
    except BROKEN_ARCHIVE:
        return False


def read_walk(path: Path) -> WalkLog:
    """Read a log; nothing in it is executed, and memory is bounded by its contents.

    Raises `LogError`: another kind of file, another version, a field missing, unknown, of the wrong type, shape or
    value.
    """
    arrays = read_npz_arrays(path)
    data = read_header(arrays, SCHEMA, SCHEMA_VERSION, path.name)
    if unknown := sorted(set(arrays) - set(SIGNALS)):
        raise LogError(f"{path.name}: unknown array {unknown[0]!r}; expected some of {', '.join(SIGNALS)}")
    if missing := [name for name in SIGNALS if name not in arrays and name not in OPTIONAL]:
        raise LogError(f"{path.name}: no array {missing[0]!r}; log it")
    complete = {item.name for item in fields(WalkHeader)} - {"torque_source"}
    try:
        header = from_plain(WalkHeader, data, "header", LogError, complete)
        doubles = {name: a if a.dtype.kind != "f" else a.astype(np.float64) for name, a in arrays.items()}
        return WalkLog(header, **doubles)
    except LogError as error:
        raise LogError(f"{path.name}: {error}") from error


@dataclass(frozen=True)
class WalkFit:
    """Point clouds and gait of one walk."""

    swing: dict[str, tuple[np.ndarray, np.ndarray]]
    """Joint -> velocity [rad/s] and torque without links and rotor inertia [N m] in swing, each shape (R,)."""
    gait_time: np.ndarray
    """Times of the first steps [s], shape (T,)."""
    gait: dict[str, np.ndarray]
    """Foot -> mask of load-bearing at those times, bool, shape (T,)."""
    load: dict[str, tuple[np.ndarray, np.ndarray]]
    """Kind of joint -> load and friction as forces on the body, other forces subtracted [N], each shape (R,)."""


PAIRS = ("swing", "load")
"""Fields with two arrays per name: `swing.x.<joint>` and `swing.y.<joint>`."""


def write_walk_fit(path: Path, fit: WalkFit) -> None:
    """Write the arrays in single precision."""
    arrays = {"gait.time": fit.gait_time} | {f"gait.{foot}": down for foot, down in fit.gait.items()}
    for group in PAIRS:
        for name, pair in getattr(fit, group).items():
            for axis, values in zip("xy", pair, strict=True):
                arrays[f"{group}.{axis}.{name}"] = values.astype(np.float32)
    publish_npz(path, arrays, compressed=True)


def read_walk_fit(path: Path) -> WalkFit:
    """Read the file of `write_walk_fit`; raise `StictionError` for a missing array or one of the wrong length."""
    arrays = read_npz_arrays(path)
    if "gait.time" not in arrays:
        raise FileError(f"{path.name}: no gait.time; expected the fit.npz of a walking log: run identify again")
    time = arrays.pop("gait.time")
    gait = {name.removeprefix("gait."): array for name, array in arrays.items() if name.startswith("gait.")}
    pairs: dict[str, dict[str, tuple[np.ndarray, np.ndarray]]] = {group: {} for group in PAIRS}
    for group, arrays_of in pairs.items():
        for name in [key.removeprefix(f"{group}.x.") for key in arrays if key.startswith(f"{group}.x.")]:
            first, second = arrays[f"{group}.x.{name}"], arrays.get(f"{group}.y.{name}", np.zeros(0))
            if first.shape != second.shape or first.ndim != 1:
                raise FileError(f"{path.name}: {group} of {name!r} is not complete; run identify again")
            arrays_of[name] = (first, second)
    if any(array.shape != time.shape for array in gait.values()):
        raise FileError(f"{path.name}: the gait's arrays differ in length; run identify again")
    return WalkFit(pairs["swing"], time, gait, pairs["load"])
