"""`joints.json`: results of identification for each joint, with intervals. Unknown values are null.

The names are fixed; the symmetric viscous and Coulomb fit is always under them, so that a reader need not know which
law was fitted. Linear axes use the same names with N, kg and m.

`training.json`, which is read and written here too, proposes a training. Its object `friction` holds fields of a run's
`config.json` under `task.friction`, so that proposal and run can be compared line by line; the rest is for readers: the
basis of the level, joint by joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from stiction.core.decode import from_plain, value_of
from stiction.core.errors import FileError, unknown_name
from stiction.core.names import kind_of
from stiction.files.log import Axis, TestCondition
from stiction.files.plain import read_object, take_version, write_object
from stiction.files.tables import publish_npz, read_npz_arrays
from stiction.joints.friction import SYMMETRIC
from stiction.joints.pd import TorqueSource

SCHEMA_VERSION = 1
"""Version of joints.json."""

TRAINING_VERSION = 2
"""Version of training.json."""

PARAMETERS = ("inertia", *SYMMETRIC)
"""Parameters of the symmetric law, in the order of the regressor."""

QUANTITIES = (
    *PARAMETERS,
    *("gravity_sin", "gravity_cos", "static_friction", "stribeck_velocity", "load_coefficient"),
    *("motor_strength", "encoder_bias", "delay", "friction_ratio", "dynamic_ratio", "dead_band"),
)


ARMATURE = "armature"
"""Name, among the combinations, of a rotor's inertia at its joint, links apart [kg m²]: the log of a whole limb gives
it in place of an inertia, which there depends on the pose of the other joints."""

BRAKE = "B + kt·ke/R"
"""Name, among the combinations, of viscous friction plus the brake of a motor that is driven by voltage [N m s/rad]."""


@dataclass(frozen=True)
class Estimate:
    """Estimate of a quantity, with its uncertainty."""

    value: float
    std: float
    interval95: tuple[float, float]

    def scaled(self, factor: float) -> Estimate:
        """Return the estimate of `factor` times the quantity; `factor` is positive and exact."""
        low, high = self.interval95
        return Estimate(self.value * factor, self.std * factor, (low * factor, high * factor))

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {"value": self.value, "std": self.std, "interval95": list(self.interval95)}

    @classmethod
    def from_dict(cls, data: Any, where: str) -> Estimate:
        """Build from plain data; messages name `where`."""
        estimate = from_plain(cls, data, where)
        estimate.check(where)
        return estimate

    def check(self, where: str) -> None:
        """Raise `FileError`, beginning with `where`, if the numbers contradict each other."""
        low, high = self.interval95
        if self.std < 0 or not low <= self.value <= high:
            raise FileError(f"{where}: expected std >= 0 and the value within interval95, got {self.to_dict()}")


FRICTION_REACHES_ZERO = "friction_reaches_zero"
"""Reason of the one objection that concerns dry friction alone: the rest of the fit is valid."""

NEGLIGIBLE = 0.01
"""Friction over torque limit that changes no walk of policies that were trained without it (results/paper, sentence
14): where friction cannot be distinguished from zero, and is at most this, simulators may use zero."""

LOAD_REGRESSORS = {"gravity": "|gravity and known torque from outside| [N m]", "motor_torque": "|motor torque| [N m]"}
"""Regressors of a load coefficient -> the same in words: the first from a joint's log, the second from a walk. Training
has the second as its law `effort`; its law `load`, of |F| + |T| at the joint, is neither."""

FRICTIONS = (
    *("coulomb_friction", "static_friction", "stribeck_velocity", "load_coefficient"),
    *("friction_ratio", "dynamic_ratio", "dead_band"),
)
"""Quantities that measure dry friction."""


@dataclass(frozen=True)
class Finding:
    """Finding: what a reader must know before using a number."""

    reason: str
    """Identifier for programs: `unexplained_torque`; empty for a warning of a file, which has only its sentence."""
    seen: str
    """Observation, with its number; for a warning also the remedy."""
    remedy: str = ""
    """First remedy of an error."""
    severity: Literal["error", "warning", "note"] = "error"
    """An error makes the whole fit invalid, a warning concerns a part of it, a note says how the log was read."""

    @property
    def text(self) -> str:
        """Observation and remedy in one sentence."""
        return f"{self.seen}. Do first: {self.remedy}" if self.remedy else self.seen


def warning(reason: str, seen: str) -> Finding:
    """Return a finding that leaves the fit valid."""
    return Finding(reason, seen, severity="warning")


def refused(why: str) -> JointRecord:
    """Return the record of a joint that was not identified: empty except for the reason."""
    return JointRecord(findings=(warning("refused", REFUSED + why),))


REFUSED = "not identified: "
"""Prefix of the warning for a refused joint."""


@dataclass(frozen=True, kw_only=True)
class JointRecord:
    """Identified properties of one joint."""

    inertia: Estimate | None = None
    """I, rotor included [kg m²]."""
    viscous_friction: Estimate | None = None
    """B [N m s/rad]."""
    coulomb_friction: Estimate | None = None
    """b_c [N m]."""
    offset: Estimate | None = None
    """Constant torque that the motor supplies [N m]."""
    gravity_sin: Estimate | None = None
    gravity_cos: Estimate | None = None
    """Torque that holds the link against gravity is gravity_sin sin θ + gravity_cos cos θ [N m]."""
    static_friction: Estimate | None = None
    """Friction at rest, if the log distinguishes it from Coulomb friction [N m]."""
    stribeck_velocity: Estimate | None = None
    """Speed at which static friction has changed to Coulomb friction [rad/s]."""
    load_coefficient: Estimate | None = None
    """Friction per unit of load [1]; the load is that of `load_regressor`, and `regressor` in `friction_law`."""
    motor_strength: Estimate | None = None
    """k, delivered over logged or commanded torque, if a known payload shows it [1]."""
    encoder_bias: Estimate | None = None
    """Logged minus true angle, if requested and shown by the log [rad]."""
    delay: Estimate | None = None
    """Delay of the controller, if requested and shown by the log [s]."""
    friction_ratio: Estimate | None = None
    """Dry friction over torque limit [1]: Coulomb friction, or static friction if that is more."""
    dynamic_ratio: Estimate | None = None
    """Coulomb friction over torque limit, if static friction is more [1]; else null, and `friction_ratio` is it."""
    dead_band: Estimate | None = None
    """Dry friction over kp [rad]: Coulomb friction, or static friction if that is more."""
    combinations: dict[str, Estimate] = field(default_factory=dict)
    """Identifiable combinations of parameters that are not identifiable alone, such as `(B + k·kd)/k`."""
    friction_law: dict[str, Any] | None = None
    """Chosen law, also Coulomb's. From a joint's log: `law`, its name, `parameters`, and `candidates`, the other laws
    tried. From a walk the load law, or null if it was refused."""
    axis: Axis = "rotary"
    test_condition: TestCondition | None = None
    torque_source: TorqueSource | None = None
    kp: float | None = None
    """Proportional gain during the test [N m/rad]."""
    kd: float | None = None
    """Derivative gain during the test [N m s/rad]."""
    torque_limit: float | None = None
    """Torque limit of the motor [N m]."""
    walking_kp: float | None = None
    """Proportional gain with which the robot walks [N m/rad], where it is not that of the test."""
    diagnostics: dict[str, Any] = field(default_factory=dict)
    """Plain data about the fit: conditioning, residuals, result of the other estimator, and so on."""
    findings: tuple[Finding, ...] = ()
    """Findings: errors first, the plainest at the head, then warnings and notes."""

    @property
    def used_kp(self) -> float | None:
        """Proportional gain with which the robot walks [N m/rad], that of the test where no other is known."""
        return self.walking_kp or self.kp

    @property
    def objections(self) -> tuple[Finding, ...]:
        """Errors that make the fit invalid; with any, neither training nor simulation uses its friction."""
        return tuple(finding for finding in self.findings if finding.severity == "error")

    @property
    def warnings(self) -> tuple[str, ...]:
        """Observations, one sentence per finding."""
        return tuple(finding.seen for finding in self.findings)

    def objection_to(self, quantity: str) -> Finding | None:
        """Return why a quantity must not be used, or None.

        Dry friction that cannot be distinguished from zero invalidates nothing else, and may be used as zero where it
        is at most `NEGLIGIBLE` of the torque limit.
        """
        for objection in self.objections:
            if objection.reason != FRICTION_REACHES_ZERO:
                return objection
            small = self.friction_ratio is not None and self.friction_ratio.interval95[1] <= NEGLIGIBLE
            if quantity in FRICTIONS and not small:
                return objection
        return None

    def usable(self) -> JointRecord:
        """Return the record without the quantities that its objections forbid to use."""
        withheld: dict[str, Any] = {name: None for name in QUANTITIES if self.objection_to(name) is not None}
        if self.objection_to("inertia") is not None:
            withheld["combinations"] = {}
        return replace(self, **withheld)

    @property
    def moving_friction(self) -> Estimate | None:
        """Dry friction in motion [N m], or over the motor strength k where N m are unknown."""
        return self.coulomb_friction or self.combinations.get("f/k")

    @property
    def holding_friction(self) -> Estimate | None:
        """Dry friction at rest in the unit of `moving_friction`; None unless the log shows that it is more."""
        law, moving = self.friction_law or {}, self.moving_friction
        static = self.static_friction
        if static is None and law.get("over_strength") and "static_friction" in law.get("parameters", {}):
            static = Estimate.from_dict(law["parameters"]["static_friction"], "friction_law.parameters.static_friction")
        return static if static and static.value > max(moving.value if moving else 0.0, 0.0) else None

    @property
    def load_regressor(self) -> str | None:
        """Regressor of the load coefficient, one of `LOAD_REGRESSORS`; None without a coefficient."""
        law = self.friction_law or {}
        if self.load_coefficient is None:
            return None
        if law.get("regressor") in LOAD_REGRESSORS:
            return str(law["regressor"])
        # Older files named it in words alone, and those of walks alone.
        return "motor_torque" if str(law.get("load", "")).startswith("|motor") else "gravity"

    @property
    def unloaded_friction(self) -> Estimate | None:
        """Friction without load, to use with `load_coefficient` [N m]; `coulomb_friction` includes the load of the
        test.

        None without a coefficient, or where that friction is not known in N m.
        """
        law = self.friction_law or {}
        constant = law.get("parameters", law).get("coulomb_friction")
        if self.load_coefficient is None or constant is None or law.get("over_strength"):
            return None
        return Estimate.from_dict(constant, "friction_law.coulomb_friction")

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        data = vars(self) | {name: value.to_dict() for name, value in vars(self).items() if isinstance(value, Estimate)}
        data["combinations"] = {name: value.to_dict() for name, value in self.combinations.items()}
        del data["findings"]
        # Only where it says something: programs from before it read the other files as they did.
        if self.walking_kp is None:
            del data["walking_kp"]
        objections = [
            {"reason": finding.reason, "seen": finding.seen, "remedy": finding.remedy} for finding in self.objections
        ]
        return data | {"objections": objections, "warnings": list(self.warnings)}

    @classmethod
    def from_dict(cls, data: Any, where: str) -> JointRecord:
        """Build from plain data; messages name `where`. Absent fields take their defaults."""
        texts_of = {name: data[name] for name in ("objections", "warnings") if isinstance(data, dict) and name in data}
        record = from_plain(
            cls, {name: data[name] for name in data if name not in texts_of} if texts_of else data, where
        )
        errors = value_of(tuple[Finding, ...], texts_of.get("objections", ()), f"{where}: objections", FileError)
        texts = value_of(tuple[str, ...], texts_of.get("warnings", ()), f"{where}: warnings", FileError)
        findings = [replace(finding, severity="error") for finding in errors]
        findings += [warning("", text) for text in texts if text not in {finding.seen for finding in errors}]
        record = replace(record, findings=(*record.findings, *findings))
        estimates = {name: getattr(record, name) for name in QUANTITIES} | record.combinations
        for name, estimate in estimates.items():
            if estimate is not None:
                estimate.check(f"{where}: {name}")
        for name in ("kp", "kd", "torque_limit", "walking_kp"):
            if (value := getattr(record, name)) is not None and value < 0:
                raise FileError(f"{where}: {name} is {value!r}; expected a number that is not negative, or null")
        ratio, moving, holding = record.friction_ratio, record.moving_friction, record.holding_friction
        if "dynamic_ratio" in data or not (ratio and moving and moving.value > 0 and holding):
            return record
        # Older files have Coulomb friction in the ratio even where more holds the joint at rest.
        return replace(record, friction_ratio=holding.scaled(ratio.value / moving.value), dynamic_ratio=ratio)


@dataclass(frozen=True)
class JointsFile:
    """Contents of the file."""

    joints: dict[str, JointRecord]
    """Joint name (`FL_shank`), or kind of joint (`shank`) -> record."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of every joint, with the joint's name in front."""
        return tuple(f"{name}: {text}" for name, record in self.joints.items() for text in record.warnings)

    def key(self, joint: str, kind: str | None = None) -> str | None:
        """Return the name of the record of `FL_shank`: its name, else its kind, `shank`; or None.

        kind: of the joint, if its name does not show it.
        """
        return next((name for name in (joint, kind or kind_of(joint)) if name in self.joints), None)

    def record(self, joint: str) -> JointRecord:
        """Return the record of `FL_shank`: under that name, else under its kind, `shank`; else raise `FileError`."""
        if (key := self.key(joint)) is None:
            raise FileError(f"no record for the joint or its kind: {unknown_name('joint', joint, self.joints)}")
        return self.joints[key]

    def nominal(self, joints: Sequence[str], quantity: str) -> tuple[float, ...]:
        """Return one quantity's value for each joint, for simulators: negative values become zero.

        quantity: one of `QUANTITIES`. Raises `FileError` for a joint without a record, and where the quantity is null,
        or the fit is not valid. An inertia must be positive; friction whose interval reaches below zero may have a
        negative estimate.
        """
        values = []
        for joint in joints:
            record = self.record(joint)
            if (objection := record.objection_to(quantity)) is not None:
                raise FileError(f"{quantity} of joint {joint!r} must not be used: {objection.text}")
            if (estimate := getattr(record, quantity)) is None:
                why = next((f": {text}" for text in record.warnings), "")
                raise FileError(f"{quantity} of joint {joint!r} is null in this file, it was not identified{why}")
            if quantity == "inertia" and estimate.value <= 0:
                raise FileError(f"inertia of joint {joint!r} is {estimate.value}; expected a positive number")
            values.append(estimate.value if quantity == "offset" else max(0.0, estimate.value))
        return tuple(values)

    def fed_forward(self, joint: str) -> tuple[float, float, float]:
        """Return the friction to feed forward: Coulomb friction, that without load [N m], and c of the load [1].

        Without a coefficient the first two are equal. Raises `FileError`, see `nominal`.
        """
        (whole,) = self.nominal([joint], "coulomb_friction")
        record = self.record(joint)
        unloaded, load = record.unloaded_friction, record.load_coefficient
        if unloaded is None or load is None or load.value <= 0:
            return whole, whole, 0.0
        return whole, max(0.0, unloaded.value), load.value

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON, the schema version first."""
        return {
            "schema_version": SCHEMA_VERSION,
            "joints": {name: record.to_dict() for name, record in self.joints.items()},
            "warnings": list(self.warnings),
        }

    def write(self, path: Path) -> None:
        """Write the file."""
        write_object(path, self.to_dict())


def read_joints(data: dict[str, Any], where: str) -> JointsFile:
    """Return a `joints.json` from plain data; raise `FileError` naming the invalid field."""
    if "friction" in data:
        raise FileError(f"{where}: this is a proposal of a training; expected the joints.json in the same folder")
    joints = take_version(data, SCHEMA_VERSION, where, what="joints.json of identify").get("joints")
    if not isinstance(joints, dict) or not joints:
        raise FileError(f"{where}: field 'joints' must be an object with at least one joint")
    return JointsFile({name: JointRecord.from_dict(entry, f"{where}: {name}") for name, entry in joints.items()})


@dataclass(frozen=True)
class FitSignals:
    """Signals of one joint on an even grid; arrays of shape (num_samples,).

    Torques are in N m, or in the unit of the torque column if that is another one; on a linear axis read N and m.
    """

    time: np.ndarray
    """From zero [s]."""
    position: np.ndarray
    """Measured position [rad]."""
    velocity: np.ndarray
    """Filtered velocity [rad/s]."""
    acceleration: np.ndarray
    """Filtered acceleration [rad/s²]."""
    torque: np.ndarray
    """Filtered torque [N m]."""
    fitted_torque: np.ndarray
    """Torque fitted with viscous and Coulomb friction [N m]."""
    law_torque: np.ndarray
    """Torque of the chosen law [N m]; the same where that is the regression's."""
    rigid_torque: np.ndarray
    """Part of it that is not friction: inertia, offset, gravity, payload [N m]."""
    used: np.ndarray
    """1 where the sample entered the regression, else 0."""
    target: np.ndarray | None = None
    """Commanded position [rad]."""
    simulated_position: np.ndarray | None = None
    """Position in the closed-loop simulation [rad]."""
    simulated_torque: np.ndarray | None = None
    """Torque in the closed-loop simulation [N m]."""


def write_fit(path: Path, joints: dict[str, FitSignals]) -> None:
    """Write `<signal>.<joint>` arrays; signals that are None are left out."""
    arrays = {
        # Time in double precision: single would round the steps of a long log.
        f"{item.name}.{joint}": values.astype(np.float32 if item.name != "time" else float)
        for joint, signals in joints.items()
        for item in fields(FitSignals)
        if (values := getattr(signals, item.name)) is not None
    }
    publish_npz(path, arrays, compressed=True)


def read_fit(path: Path, joint: str) -> FitSignals:
    """Read one joint's signals; raise `StictionError` for missing signals or different lengths."""
    arrays = read_npz_arrays(path)
    signals = {item.name: arrays[key] for item in fields(FitSignals) if (key := f"{item.name}.{joint}") in arrays}
    # The fields without a default.
    needed = {item.name for item in fields(FitSignals)[:9]}
    if needed - set(signals):
        raise FileError(f"{path.name}: no {sorted(needed - set(signals))[0]} of joint {joint!r}; run identify again")
    if any(values.ndim != 1 or values.dtype.kind != "f" for values in signals.values()):
        raise FileError(f"{path.name}: a signal of joint {joint!r} is not a vector of numbers; run identify again")
    if len(set(map(len, signals.values()))) != 1:
        raise FileError(f"{path.name}: the signals of joint {joint!r} differ in length; run identify again")
    return FitSignals(**{name: values.astype(float) for name, values in signals.items()})


def is_training(path: Path) -> bool:
    """Return whether a file proposes a training, and is not an identification; raise `FileError` for invalid JSON."""
    _check_withheld(path)
    return "friction" in read_object(path, "a joints.json or training.json of `stiction identify`")


def _check_withheld(path: Path) -> None:
    """Raise `FileError` where a training.json is missing because the fit in the same folder is not valid."""
    joints_file = path.parent / "joints.json"
    if path.exists() or not joints_file.is_file():
        return
    for name, record in read_joints(
        read_object(joints_file, "the joints.json of identify"), joints_file.name
    ).joints.items():
        for objection in record.objections:
            raise FileError(
                f"{path.name} is missing, since this identification proposes no training: {name}: {objection.text}"
            )


def write_training(path: Path, proposal: dict[str, Any]) -> None:
    """Write a proposal: `friction`, null if none is possible, `text`, and further explanations."""
    write_object(path, {"schema_version": TRAINING_VERSION, **proposal})


def read_training(path: Path) -> dict[str, Any]:
    """Return the whole proposal; raise `StictionError` for another file, or a proposal without friction.

    The message says so where the file is missing because the fit in the same folder is not valid.
    """
    _check_withheld(path)
    data = read_object(path, "the training.json of `stiction identify`")
    if {"joints", "warnings"} <= data.keys() and "friction" not in data:
        raise FileError(f"{path.name}: these are identified joints; expected the training.json that lies beside them")
    take_version(data, TRAINING_VERSION, path.name, what="training.json of identify")
    friction = data.get("friction", {})
    if friction is None:
        reason = " ".join(str(data.get("text", "it does not say why")).split())[:400]
        raise FileError(f"{path.name} proposes no joint friction to train with: {reason}")
    if not isinstance(friction, dict) or not {"method", "level"} <= friction.keys():
        raise FileError(f"{path.name}: 'friction' is {friction!r}; expected at least 'method' and 'level'")
    return data
