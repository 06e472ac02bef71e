"""`joints.json`: what identification found out about each joint, with intervals. What is not known is null.

The names are fixed; the symmetric viscous and Coulomb fit always stands under them, so that a reader never has to ask
which law was fitted. Linear axes use the same names with N, kg and m.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from stiction.formats.errors import StictionError
from stiction.formats.sidecar import AXES, TEST_CONDITIONS, TORQUE_SOURCES

SCHEMA_VERSION = 1
"""Raised when a reader of the older form would misunderstand the newer one."""

PARAMETERS = ("inertia", "viscous_friction", "coulomb_friction", "offset")
"""Parameters of the symmetric law, in the order of the regressor."""

QUANTITIES = (
    *PARAMETERS,
    *("gravity_sin", "gravity_cos", "static_friction", "stribeck_velocity", "load_coefficient"),
    *("motor_strength", "encoder_bias", "delay", "friction_ratio", "dead_band"),
)
"""Everything in a record that is an `Estimate` or null."""


class JointsError(StictionError):
    """A `joints.json` that cannot be read, or that does not know the joint asked for."""


@dataclass(frozen=True)
class Estimate:
    """A number with its uncertainty."""

    value: float
    """Best estimate."""
    std: float
    """Standard deviation of the estimate."""
    interval95: tuple[float, float]
    """95 % confidence interval, lower and upper end."""

    def scaled(self, factor: float) -> Estimate:
        """Return the estimate of `factor` times the quantity; `factor` is positive and exactly known."""
        low, high = self.interval95
        return Estimate(self.value * factor, self.std * factor, (low * factor, high * factor))

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {"value": self.value, "std": self.std, "interval95": list(self.interval95)}

    @classmethod
    def from_dict(cls, data: Any, where: str) -> Estimate:
        """Build from plain data; `where` is named in messages."""
        try:
            low, high = data["interval95"]
            numbers = (data["value"], data["std"], low, high)
        except (KeyError, TypeError, ValueError) as error:
            raise JointsError(
                f"{where}: expected an object with value, std and interval95, got {str(data)[:80]}"
            ) from error
        if any(isinstance(n, bool) or not isinstance(n, int | float) or not math.isfinite(n) for n in numbers):
            raise JointsError(f"{where}: expected finite numbers, got {str(data)[:80]}")
        if data["std"] < 0 or not low <= data["value"] <= high:
            raise JointsError(f"{where}: expected std >= 0 and the value within interval95, got {str(data)[:80]}")
        return cls(float(data["value"]), float(data["std"]), (float(low), float(high)))


@dataclass(frozen=True)
class JointRecord:
    """What is known about one joint."""

    inertia: Estimate | None = None
    """I, rotor included [kg m²]."""
    viscous_friction: Estimate | None = None
    """B [N m s/rad]."""
    coulomb_friction: Estimate | None = None
    """b_c [N m]."""
    offset: Estimate | None = None
    """Constant torque that the motor supplies [N m]."""
    gravity_sin: Estimate | None = None
    """Torque that holds the link against gravity is gravity_sin sin θ + gravity_cos cos θ [N m]."""
    gravity_cos: Estimate | None = None
    """See `gravity_sin` [N m]."""
    static_friction: Estimate | None = None
    """Friction at rest, where it was told apart from Coulomb friction [N m]."""
    stribeck_velocity: Estimate | None = None
    """Speed at which static friction has given way to Coulomb friction [rad/s]."""
    load_coefficient: Estimate | None = None
    """Friction per unit of transmitted load [1]."""
    motor_strength: Estimate | None = None
    """k, torque delivered over torque logged or commanded, where a known payload told it [1]."""
    encoder_bias: Estimate | None = None
    """Logged angle less the true one, where it was asked for and the log tells it [rad]."""
    delay: Estimate | None = None
    """How late the controller is, where it was asked for and the log tells it [s]."""
    friction_ratio: Estimate | None = None
    """Coulomb friction over torque limit [1]."""
    dead_band: Estimate | None = None
    """Friction at rest over kp [rad]: Coulomb friction, or static friction where the law has it."""
    combinations: dict[str, Estimate] = field(default_factory=dict)
    """What is identifiable where a parameter alone is not, such as `(B + k·kd)/k`."""
    friction_law: dict[str, Any] | None = None
    """The law that was chosen, Coulomb's too. From a joint's log: `law`, which it is, `parameters`, and `candidates`,
    what else was tried. From a walk the load law, or null where it was refused."""
    axis: str = "rotary"
    """`rotary` or `linear`."""
    test_condition: str | None = None
    """`bare_motor`, `in_air` or `loaded`; null if nobody said."""
    torque_source: str | None = None
    """`motor_side` or `output_side`; null without torque."""
    kp: float | None = None
    """Proportional gain during the test [N m/rad]."""
    kd: float | None = None
    """Derivative gain during the test [N m s/rad]."""
    torque_limit: float | None = None
    """Largest torque of the motor [N m]."""
    diagnostics: dict[str, Any] = field(default_factory=dict)
    """Plain data about the fit: conditioning, residuals, what the other estimator found, and so on."""
    warnings: tuple[str, ...] = ()
    """What a reader should know before trusting the numbers."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        data: dict[str, Any] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            data[item.name] = value.to_dict() if isinstance(value, Estimate) else value
        data["combinations"] = {name: value.to_dict() for name, value in self.combinations.items()}
        data["warnings"] = list(self.warnings)
        return data

    @classmethod
    def from_dict(cls, data: Any, where: str) -> JointRecord:
        """Build from plain data; `where` is named in messages. Absent fields take their defaults."""
        known = [item.name for item in fields(cls)]
        if not isinstance(data, dict) or set(data) - set(known):
            raise JointsError(f"{where}: expected an object with some of {', '.join(known)}, got {str(data)[:80]}")
        values = dict(data)
        for name in QUANTITIES:
            if values.get(name) is not None:
                values[name] = Estimate.from_dict(values[name], f"{where}.{name}")
        for name, kind in (("combinations", dict), ("diagnostics", dict), ("warnings", list)):
            if not isinstance(values.get(name, kind()), kind):
                raise JointsError(f"{where}.{name}: expected a JSON {kind.__name__}, got {str(values[name])[:80]}")
        values["combinations"] = {
            name: Estimate.from_dict(entry, f"{where}.combinations.{name}")
            for name, entry in values.get("combinations", {}).items()
        }
        values["warnings"] = tuple(str(text) for text in values.get("warnings", []))
        _check_settings(values, where)
        return cls(**values)


def _check_settings(values: dict[str, Any], where: str) -> None:
    """Refuse settings of the test that are not what they should be."""
    choices = {"axis": AXES, "test_condition": (*TEST_CONDITIONS, None), "torque_source": (*TORQUE_SOURCES, None)}
    for name, allowed in choices.items():
        if name in values and values[name] not in allowed:
            raise JointsError(f"{where}.{name}: {values[name]!r}; expected one of {', '.join(map(str, allowed))}")
    for name in ("kp", "kd", "torque_limit"):
        value = values.get(name)
        if value is not None and (
            isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < math.inf
        ):
            raise JointsError(f"{where}.{name}: {value!r}; expected a number that is not negative, or null")
    law = values.get("friction_law")
    if law is not None and not isinstance(law, dict):
        raise JointsError(f"{where}.friction_law: {str(law)[:80]}; expected an object or null")


@dataclass(frozen=True)
class JointsFile:
    """The whole file."""

    joints: dict[str, JointRecord]
    """Joint name (`FL_shank`), or kind of joint (`shank`) -> record."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Every joint's warnings, with the joint's name in front."""
        return tuple(f"{name}: {text}" for name, record in self.joints.items() for text in record.warnings)

    def key(self, joint: str) -> str | None:
        """Return the name that `FL_shank` is recorded under: its own, else its kind, `shank`; None where neither is."""
        return next((name for name in (joint, joint.rpartition("_")[2]) if name in self.joints), None)

    def record(self, joint: str) -> JointRecord:
        """Return the record of `FL_shank`: under that name, else under its kind, `shank`; else raise `JointsError`."""
        key = self.key(joint)
        if key is not None:
            return self.joints[key]
        raise JointsError(f"no record for joint {joint!r} or its kind; the file has {', '.join(self.joints)}")

    def nominal(self, joints: Sequence[str], quantity: str) -> tuple[float, ...]:
        """Return one quantity's value for each joint, as simulators take it: what is below zero is zero.

        quantity: one of `QUANTITIES`. Raises `JointsError` for a joint without a record, and where the quantity
        is null. An inertia must be positive; friction whose interval reaches below zero may have a negative estimate.
        """
        values = []
        for joint in joints:
            estimate = getattr(self.record(joint), quantity)
            if estimate is None:
                why = next((f": {text}" for text in self.record(joint).warnings), "")
                raise JointsError(f"{quantity} of joint {joint!r} is null in this file, it was not identified{why}")
            if quantity == "inertia" and estimate.value <= 0:
                raise JointsError(f"inertia of joint {joint!r} is {estimate.value}; expected a positive number")
            values.append(estimate.value if quantity == "offset" else max(0.0, estimate.value))
        return tuple(values)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON, the schema version first."""
        return {
            "schema_version": SCHEMA_VERSION,
            "joints": {name: record.to_dict() for name, record in self.joints.items()},
            "warnings": list(self.warnings),
        }

    def write(self, path: Path) -> None:
        """Write the file."""
        text = json.dumps(self.to_dict(), indent=2, allow_nan=False, ensure_ascii=False)
        path.write_text(text + "\n", encoding="utf-8")


def load_joints(path: Path) -> JointsFile:
    """Read and validate a `joints.json`; raise `JointsError` that names the field that is wrong."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise JointsError(f"cannot read {path}: {error.strerror or error}") from error
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise JointsError(
            f"{path.name}: not JSON ({str(error)[:120]}); expected the joints.json of identify"
        ) from error
    if isinstance(data, dict) and "friction" in data:
        raise JointsError(f"{path.name}: this proposes what to train; expected the joints.json that lies beside it")
    if not isinstance(data, dict) or data.get("schema_version") != SCHEMA_VERSION:
        found = data.get("schema_version") if isinstance(data, dict) else None
        raise JointsError(f"{path.name}: schema version {found!r}; this program reads version {SCHEMA_VERSION}")
    joints = data.get("joints")
    if not isinstance(joints, dict) or not joints:
        raise JointsError(f"{path.name}: field 'joints' must be an object with at least one joint")
    return JointsFile({name: JointRecord.from_dict(entry, f"{path.name}: {name}") for name, entry in joints.items()})
