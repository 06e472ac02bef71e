"""Mistakes with servos: a wrong motor constant, supply, sign, unit, gear or pendulum, on motors driven by voltage."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from stiction.files.log import LogSetup
from stiction.identification.setup import IdentifySetup
from stiction_experiments.flags import RIGHT
from stiction_experiments.flags.cases import (
    DEGREES,
    EMPS_VOLT,
    Case,
    Given,
    all_right,
    cases,
    clipped,
    emps,
    flags,
    scale,
    stamps,
    times,
    torque_of,
    unchecked,
    without_gravity,
)
from stiction_experiments.flags.servo import HANGS, SERVO

MASS, LENGTH = 0.5, 0.2
"""Mass and length of the pendulum [kg, m]."""

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


swinging = partial(servo, MASS)
"""The servo with its pendulum, and no word of it."""


def weighed() -> Given:
    """Return the servo with its pendulum and its constants, which say the same."""
    return swinging().flags(pendulum_mass=MASS, pendulum_length=LENGTH)


def weighed_alone() -> Given:
    """Return the servo with its pendulum, of whose motor nothing is known."""
    return weighed().flags(kt=None, resistance=None)


def holding(what: str, declared: str) -> Callable[[Given], Given]:
    """Return the mistake of a column that holds one thing and is declared as another."""
    supply = SERVO.supply if declared == "duty" else None
    log = replace(SERVO.log(what), setup=LogSetup())

    def mistaken(entry: Given) -> Given:
        changed = replace(entry, log=log).flags(torque_column=declared, duty_voltage=supply)
        return changed if declared != "current" else changed.flags(resistance=None)

    return mistaken


def drive_cases(folder: Path) -> list[Case]:
    """Return mistakes with servos, simulated, and with the measured EMPS drive. folder: of the measured records."""
    # The drive's column is a current command, with its constant as kt.
    amperes = flags(torque_scale=None, torque_column="current", kt=EMPS_VOLT)
    measured = {"EMPS by current": lambda: amperes(emps(folder))}
    records: dict[str, Callable[[], Any]] = {"servo": servo, "pendulum": weighed, "pendulum alone": weighed_alone}
    add = partial(cases, records | measured)
    kt, ohm, supply = SERVO.kt, SERVO.resistance, SERVO.supply
    as_torque = {"torque_column": None, "duty_voltage": None, "kt": None, "resistance": None, "torque_limit": None}
    twice, half = flags(pendulum_mass=2 * MASS), flags(pendulum_length=LENGTH / 2)

    def no_gains(entry: Given) -> Given:
        return unchecked(entry).flags(kt=2 * EMPS_VOLT)

    weight = "the motor's constants are not known, and the weight alone tells the scale"
    return [
        *add(RIGHT, "servo; pendulum; pendulum alone; EMPS by current", all_right),
        *add("kt twice as large", "servo", flags(kt=2 * kt)),
        *add("kt half as large", "servo", flags(kt=kt / 2), ONE_SCALE, "--kt"),
        *add("kt of the motor, without its gear", "servo", flags(kt=kt / GEAR), ONE_SCALE, "--kt"),
        *add("kt of the motor, without its gear", "pendulum", flags(kt=kt / GEAR)),
        *add("kt twice as large", "EMPS by current", flags(kt=2 * EMPS_VOLT)),
        *add("kt a fifth too large", "EMPS by current", flags(kt=1.2 * EMPS_VOLT)),
        *add("kt twice as large, no gains", "EMPS by current", no_gains, ONE_SCALE, "--kt"),
        *add("R twice as large", "servo", flags(resistance=2 * ohm), ONE_SCALE, "--resistance"),
        *add("R half as large", "servo", flags(resistance=ohm / 2), ONE_SCALE, "--resistance"),
        *add("R half as large", "pendulum", flags(resistance=ohm / 2)),
        *add("supply of 24 V for 12", "servo", flags(duty_voltage=2 * supply), ONE_SCALE, "--duty-voltage"),
        *add("supply of 7.4 V for 12", "servo", flags(duty_voltage=7.4), ONE_SCALE, "--duty-voltage"),
        *add("supply of 24 V for 12", "pendulum; pendulum alone", flags(duty_voltage=2 * supply)),
        *add("sign of the duty", "servo; pendulum", scale(-1.0)),
        *add("duty in percent", "servo", times(100.0, "torque")),
        *add("share taken for percent", "servo", scale(0.01)),
        *add("duty taken for torque", "servo", flags(**as_torque), "without any unit", "--torque-scale"),
        *add("amperes taken for volts", "servo", holding("current", "voltage")),
        *add("volts taken for amperes", "servo", holding("voltage", "current"), ONE_SCALE, "--torque-column"),
        *add("volts taken for torque, kt/R as scale", "servo", flags(**as_torque, torque_scale=kt / ohm * supply)),
        *add("ke half as large", "servo", flags(ke=kt / 2)),
        *add("ke twice as large", "servo", flags(ke=2 * kt)),
        *add("degrees", "servo; pendulum", times(DEGREES, "position")),
        *add("angle of the motor, not of the joint", "servo; pendulum", times(GEAR, "position")),
        *add("gear ratio divided out twice", "servo; pendulum", times(1 / GEAR, "position")),
        *add("pendulum's mass twice as large", "pendulum", twice),
        *add("pendulum's mass a third too large", "pendulum", flags(pendulum_mass=4 / 3 * MASS)),
        *add("pendulum's mass twice as large", "pendulum alone", twice, weight, "--pendulum-mass"),
        *add("pendulum's length half", "pendulum alone", half, weight, "--pendulum-length"),
        *add("pendulum said to hang half a radian off", "pendulum; pendulum alone", flags(pendulum_angle=HANGS + 0.5)),
        *cases({"pendulum": swinging}, "pendulum not said, bare motor", "pendulum", without_gravity),
        *add("pendulum said where there is none", "servo", flags(pendulum_mass=MASS, pendulum_length=LENGTH)),
        *add("duty cut off at half", "servo", clipped(0.5)),
        *add("duty of another joint", "servo", torque_of(swinging)),
        *add("half the rate", "servo", stamps(2.0)),
        *add("twice the rate", "pendulum", stamps(0.5)),
    ]
