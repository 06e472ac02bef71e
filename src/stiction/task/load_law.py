"""Conversion of an identified load coefficient for training: three laws use that name, each for another load.

A joint's log gives c of |gravity torque|, a walk c of |motor torque|; `effort`, c |motor torque|, takes either
unchanged. `load`, c (|F| + |T|), takes c times |torque about the axis| / (|F| + |T|), which depends on the robot's
pose: where that ratio is constant over poses (`stance_loads`) it is a number, else a range, which is not used for
training.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.files.joints import LOAD_REGRESSORS, Estimate, JointRecord, JointsFile
from stiction.joints.friction import find_law, has_coefficient
from stiction.robots.model import Robot
from stiction.robots.statics import POSES, HingeLoad, stance_loads
from stiction.task.friction import FrictionCfg

UNCHANGED_LAW = "effort"
"""Law of training that takes an identified load coefficient unchanged."""

LARGEST_SPREAD = 0.25
"""Maximum half range of a ratio of loads over its mean, 5th to 95th of a hundred poses, to use one number."""

ENDS = (0.05, 0.95)
"""Quantiles of the poses that bound a ratio."""

SAME_NUMBER = 0.05
"""Relative difference below which a typed coefficient is that of the file."""

_stance_loads = cache(stance_loads)


@dataclass(frozen=True)
class Conversion:
    """Load coefficient of a record in another law."""

    coefficient: Estimate
    """c' [1]; the interval is that of c over the range of the ratio."""
    spread: float
    """Half of that range over its mean [1]; 0 for equal regressors."""
    how: str

    @property
    def stable(self) -> bool:
        """True if one number represents it."""
        return self.spread <= LARGEST_SPREAD


def converted(coefficient: Estimate, regressor: str, law: str, load: HingeLoad | None) -> Conversion | None:
    """Return c' of `law` that gives the friction of c times its regressor; None if unknown."""
    if law == UNCHANGED_LAW:
        same = "both multiply the motor's torque"
        rest = "at rest the motor's torque is the load about its axis; what accelerates the links is not in it"
        return Conversion(coefficient, 0.0, same if regressor == "motor_torque" else rest)
    if law != "load" or load is None or not load.size.all():
        return None
    # A ratio of sums, so that both laws have the same mean friction over the poses.
    ratio = float(load.axis_torque.sum() / load.size.sum())
    if not ratio > 0:
        return None
    low, high = (float(end) for end in np.quantile(load.axis_torque / load.size, ENDS))
    ends = (coefficient.interval95[0] * low, coefficient.interval95[1] * high)
    value = coefficient.value * ratio
    # Nothing keeps a ratio of sums between quantiles of ratios, and an interval must hold its value.
    estimate = Estimate(value, coefficient.std * ratio, (min(value, *ends), max(value, *ends)))
    spread = (high - low) / 2 / ratio
    return Conversion(
        estimate,
        spread,
        f"|torque about the axis| is {ratio:.3g} of |F| + |T| in the mean of {len(load.size)} poses, {low:.3g} to "
        f"{high:.3g}, within {spread:.0%} ({POSES})",
    )


def take_coefficients(file: JointsFile, robot: Robot, law: str) -> tuple[list[float], list[str]]:
    """Return c' [1] of a law for every joint, and its derivation in words. Raises `ConfigurationError` for a joint
    without one.
    """
    values: list[float] = []
    sources: dict[str, str] = {}
    for number, name in enumerate(robot.joint_names):
        key = file.key(name)
        conversion = None if key is None else _record_coefficient(key, file.joints[key], number, robot, law)
        if key is None or conversion is None:
            raise ConfigurationError(
                f"joint {name!r} has no load_coefficient that gives one of the law {law}; say --friction-level"
            )
        if (objection := file.joints[key].objection_to("load_coefficient")) is not None:
            raise ConfigurationError(f"the fit of {key!r} is not valid, and with it its load: {objection.text}")
        if not conversion.stable:
            low, high = conversion.coefficient.interval95
            raise ConfigurationError(
                f"{_coefficient_text(key, file.joints[key])}, is not one coefficient of the law {law} on {robot.name}"
                f", but {low:.3g} to {high:.3g}: {conversion.how}; at most {LARGEST_SPREAD:.0%} is allowed; use "
                f"--friction-law {UNCHANGED_LAW}, which takes it unchanged, or a --friction-level of that range"
            )
        values.append(max(0.0, conversion.coefficient.value))
        low, high = conversion.coefficient.interval95
        sources.setdefault(
            key,
            f"{_coefficient_text(key, file.joints[key])}, is taken as {conversion.coefficient.value:.4g} ({low:.3g} to "
            f"{high:.3g}) of the law {law} on {robot.name}: {conversion.how}"
            f"{_omitted_text(file.joints[key], number, robot)}",
        )
    return values, [*sources.values()]


def load_warnings(file: JointsFile, robot: Robot, friction: FrictionCfg) -> tuple[str, ...]:
    """Yield warnings on identified load coefficients that a --friction-level replaces.

    Raises `ConfigurationError` where the level is one of them and the law has another regressor.
    """
    lines: dict[str, None] = {}
    numbers: dict[str, int] = {}
    for number, name in enumerate(robot.joint_names):
        if (key := file.key(name)) is not None:
            numbers.setdefault(key, number)
    for key, number in numbers.items():
        record = file.joints[key]
        coefficient, regressor = record.load_coefficient, record.load_regressor
        if coefficient is None or regressor is None:
            continue
        what, law = _coefficient_text(key, record), friction.law
        if not has_coefficient(law):
            text = f"is not used: the law {law} does not depend on load; --friction-law {UNCHANGED_LAW} has that law"
            lines[f"{what}, {text}"] = None
        elif law == UNCHANGED_LAW:
            text = f"--friction-level {coefficient.value:.4g} trains with it, or none with each joint's own"
            lines[f"{what}, is of the law {law}: {text}"] = None
        else:
            other = _record_coefficient(key, record, number, robot, law)
            low, high = other.coefficient.interval95 if other else (0.0, 0.0)
            elsewhere = f"on {robot.name} it would be {low:.3g} to {high:.3g} of that law; " if other else ""
            instead = f"{elsewhere}--friction-law {UNCHANGED_LAW} has the law that was identified"
            meaning = find_law(law).meaning
            if friction.level is not None and abs(friction.level - coefficient.value) < SAME_NUMBER * coefficient.value:
                raise ConfigurationError(
                    f"--friction-law {law} --friction-level {friction.level:g} looks like {what}: {law} means "
                    f"{meaning}, which is another law; {instead}, or give a coefficient of that law"
                )
            lines[f"{what}, is not used: {law} means {meaning}; {instead}"] = None
    return tuple(lines)


def _record_coefficient(key: str, record: JointRecord, number: int, robot: Robot, law: str) -> Conversion | None:
    """Return the coefficient of a law from the record of one joint, or None."""
    if record.load_coefficient is None or record.load_regressor is None:
        return None
    loads: Mapping[int, HingeLoad] = _stance_loads(robot) if law == "load" else {}
    return converted(record.load_coefficient, record.load_regressor, law, loads.get(number))


def _coefficient_text(key: str, record: JointRecord) -> str:
    """Return the name of a record's coefficient and its regressor, in words."""
    assert record.load_coefficient is not None and record.load_regressor is not None
    return (
        f"the load_coefficient of {key!r}, {record.load_coefficient.value:.4g} of "
        f"{LOAD_REGRESSORS[record.load_regressor]}"
    )


def _omitted_text(record: JointRecord, number: int, robot: Robot) -> str:
    """Return what a law with a coefficient omits of the identified one, and how its load compares with the robot's."""
    assert record.load_coefficient is not None
    load = _stance_loads(robot).get(number)
    if load is None:
        return ""
    carried, remark = float(load.axis_torque.mean()), ""
    measured = [gravity.value for gravity in (record.gravity_sin, record.gravity_cos) if gravity is not None]
    if measured and (most := float(np.linalg.norm(measured))) < carried:
        remark += f"; measured up to {most:.3g} N m of load, and the robot's stance has {carried:.3g} in the mean"
    if record.unloaded_friction is None:
        return remark
    coulomb = max(0.0, record.unloaded_friction.value)
    whole = coulomb + record.load_coefficient.value * carried
    if not whole > 0:
        return remark
    share = whole / float(robot.joint_values("torque_limit")[number])
    return remark + (
        f"; friction without load, {coulomb:.3g} N m, is {coulomb / whole:.0%} of the friction there and in no law "
        f"with a coefficient: all of it is {share:.3g} of the torque limit, in the mean, under --friction-law coulomb"
    )
