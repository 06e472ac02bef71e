"""Mistakes with servos: a wrong motor constant, supply, sign, unit, gear or pendulum, on motors driven by voltage."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

from stiction.files.log import LogSetup
from stiction.identification.setup import IdentifySetup
from stiction_experiments.flags import RIGHT
from stiction_experiments.flags.cases import (
    DEGREES,
    EMPS_VOLT,
    Case,
    Given,
    all_right,
    case,
    clipped,
    emps,
    flags,
    other_sign,
    scale,
    stamps,
    torque_of,
    unchecked,
    without_gravity,
)
from stiction_experiments.flags.servo import HANGS, SERVO

MASS, LENGTH = 0.5, 0.2
"""Of the pendulum [kg, m]."""

GEAR = 5.0
"""Ratio that is forgotten, or taken twice."""

ONE_SCALE = "all torques in the log grow by one factor, which only a known weight would show"
"""Why a motor's constants cannot be seen."""


@cache
def servo(mass: float = 0.0) -> Given:
    """Return a servo by its duty, bare or with a pendulum that nobody told of, and its constants."""
    log = replace(SERVO.log("duty", mass=mass), setup=LogSetup())
    setup = IdentifySetup(
        torque_limit=SERVO.kt * SERVO.supply / SERVO.resistance,
        torque_source="motor_side",
        test_condition="loaded" if mass else "bare_motor",
        duty_voltage=SERVO.supply,
        kt=SERVO.kt,
        resistance=SERVO.resistance,
    )
    return Given(log, setup, SERVO.coulomb)


def swinging() -> Given:
    """Return the servo with its pendulum, and no word of it."""
    return servo(MASS)


def weighed() -> Given:
    """Return the servo with its pendulum and its constants, which say the same."""
    return swinging().flags(pendulum_mass=MASS, pendulum_length=LENGTH)


def weighed_alone() -> Given:
    """Return the servo with its pendulum, of whose motor nothing is known."""
    return weighed().flags(kt=None, resistance=None)


def in_amperes(folder: Path) -> Given:
    """Return the EMPS drive, whose column is a current command, with its constant as kt."""
    return emps(folder).flags(torque_scale=None, torque_column="current", kt=EMPS_VOLT)


def positions(factor: float) -> Callable[[Given], Given]:
    """Return the mistake of angles that are so many times the joint's: those of the motor, say."""

    def mistaken(given: Given) -> Given:
        assert given.signals.position is not None
        return given.changed(position=factor * given.signals.position)

    return mistaken


def column(factor: float) -> Callable[[Given], Given]:
    """Return the mistake of a column in another unit: percent, counts."""

    def mistaken(given: Given) -> Given:
        assert given.signals.torque is not None
        return given.changed(torque=factor * given.signals.torque)

    return mistaken


def holding(what: str, declared: str) -> Callable[[Given], Given]:
    """Return the mistake of a column that holds one thing and is declared as another."""
    supply = SERVO.supply if declared == "duty" else None
    log = replace(SERVO.log(what), setup=LogSetup())

    def mistaken(given: Given) -> Given:
        changed = replace(given, log=log).flags(torque_column=declared, duty_voltage=supply)
        return changed if declared != "current" else changed.flags(resistance=None)

    return mistaken


def drive_cases(folder: Path) -> list[Case]:
    """Return mistakes with servos, simulated, and with the measured EMPS drive. folder: of the measured records."""
    drive = partial(in_amperes, folder)
    names: dict[str, Callable[[], Given]] = {
        "servo": servo,
        "pendulum": weighed,
        "pendulum alone": weighed_alone,
        "EMPS by current": drive,
    }
    right = [case(RIGHT, name, record, all_right) for name, record in names.items()]
    return [*right, *_motor_cases(drive), *_angle_cases()]


def _motor_cases(drive: Callable[[], Given]) -> list[Case]:
    """Return mistakes about a motor's constants and its column. drive: the measured record, in amperes."""
    kt, ohm, supply = SERVO.kt, SERVO.resistance, SERVO.supply
    as_torque = {"torque_column": None, "duty_voltage": None, "kt": None, "resistance": None, "torque_limit": None}
    return [
        case("kt twice as large", "servo", servo, flags(kt=2 * kt)),
        case("kt half as large", "servo", servo, flags(kt=kt / 2), ONE_SCALE, "--kt"),
        case("kt of the motor, without its gear", "servo", servo, flags(kt=kt / GEAR), ONE_SCALE, "--kt"),
        case("kt of the motor, without its gear", "pendulum", weighed, flags(kt=kt / GEAR)),
        case("kt twice as large", "EMPS by current", drive, flags(kt=2 * EMPS_VOLT)),
        case("kt a fifth too large", "EMPS by current", drive, flags(kt=1.2 * EMPS_VOLT)),
        case(
            "kt twice as large, no gains",
            "EMPS by current",
            drive,
            lambda given: unchecked(given).flags(kt=2 * EMPS_VOLT),
            ONE_SCALE,
            "--kt",
        ),
        case("R twice as large", "servo", servo, flags(resistance=2 * ohm), ONE_SCALE, "--resistance"),
        case("R half as large", "servo", servo, flags(resistance=ohm / 2), ONE_SCALE, "--resistance"),
        case("R half as large", "pendulum", weighed, flags(resistance=ohm / 2)),
        case("supply of 24 V for 12", "servo", servo, flags(duty_voltage=2 * supply), ONE_SCALE, "--duty-voltage"),
        case("supply of 7.4 V for 12", "servo", servo, flags(duty_voltage=7.4), ONE_SCALE, "--duty-voltage"),
        case("supply of 24 V for 12", "pendulum", weighed, flags(duty_voltage=2 * supply)),
        case("supply of 24 V for 12", "pendulum alone", weighed_alone, flags(duty_voltage=2 * supply)),
        case("sign of the duty", "servo", servo, other_sign),
        case("sign of the duty", "pendulum", weighed, other_sign),
        case("duty in percent", "servo", servo, column(100.0)),
        case("share taken for percent", "servo", servo, scale(0.01)),
        case("duty taken for torque", "servo", servo, flags(**as_torque), "without any unit", "--torque-scale"),
        case("amperes taken for volts", "servo", servo, holding("current", "voltage")),
        case("volts taken for amperes", "servo", servo, holding("voltage", "current"), ONE_SCALE, "--torque-column"),
        case(
            "volts taken for torque, kt/R as scale", "servo", servo, flags(**as_torque, torque_scale=kt / ohm * supply)
        ),
        case("ke half as large", "servo", servo, flags(ke=kt / 2)),
        case("ke twice as large", "servo", servo, flags(ke=2 * kt)),
    ]


def _angle_cases() -> list[Case]:
    """Return mistakes about a servo's angles, its weight and its time."""
    weight = "the motor's constants are not known, and the weight alone tells the scale"
    return [
        case("degrees", "servo", servo, positions(DEGREES)),
        case("degrees", "pendulum", weighed, positions(DEGREES)),
        case("angle of the motor, not of the joint", "servo", servo, positions(GEAR)),
        case("angle of the motor, not of the joint", "pendulum", weighed, positions(GEAR)),
        case("gear ratio divided out twice", "servo", servo, positions(1 / GEAR)),
        case("gear ratio divided out twice", "pendulum", weighed, positions(1 / GEAR)),
        case("pendulum's mass twice as large", "pendulum", weighed, flags(pendulum_mass=2 * MASS)),
        case("pendulum's mass a third too large", "pendulum", weighed, flags(pendulum_mass=4 / 3 * MASS)),
        case(
            "pendulum's mass twice as large",
            "pendulum alone",
            weighed_alone,
            flags(pendulum_mass=2 * MASS),
            weight,
            "--pendulum-mass",
        ),
        case(
            "pendulum's length half",
            "pendulum alone",
            weighed_alone,
            flags(pendulum_length=LENGTH / 2),
            weight,
            "--pendulum-length",
        ),
        case("pendulum said to hang half a radian off", "pendulum", weighed, flags(pendulum_angle=HANGS + 0.5)),
        case(
            "pendulum said to hang half a radian off",
            "pendulum alone",
            weighed_alone,
            flags(pendulum_angle=HANGS + 0.5),
        ),
        case("pendulum not said, bare motor", "pendulum", swinging, without_gravity),
        case("pendulum said where there is none", "servo", servo, flags(pendulum_mass=MASS, pendulum_length=LENGTH)),
        case("duty cut off at half", "servo", servo, clipped(0.5)),
        case("duty of another joint", "servo", servo, torque_of(swinging)),
        case("half the rate", "servo", servo, stamps(2.0)),
        case("twice the rate", "pendulum", weighed, stamps(0.5)),
    ]
