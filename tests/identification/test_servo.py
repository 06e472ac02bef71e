"""Servos as they are, simulated: friction within its interval, the motor's brake told from viscous friction or not."""

from __future__ import annotations

from dataclasses import replace

import pytest

from estimates import holds
from stiction.files.joints import BRAKE, JointRecord
from stiction.identification.pipeline import identify_joint
from stiction.identification.setup import IdentifySetup
from stiction_experiments.flags.servo import HANGS, SERVO

WHOLE = SERVO.viscous + SERVO.brake
"""B + kt ke/R = 0.12 + 0.5625 N m s/rad."""

MOTOR = {"duty_voltage": 12.0, "kt": 1.5, "resistance": 4.0}


def warns_of(record: JointRecord, words: str) -> bool:
    """Return True if a warning contains these words."""
    return any(words in text for text in record.warnings)


@pytest.mark.parametrize("column", ["duty", "voltage"])
def test_a_motor_by_voltage_in_si(column: str) -> None:
    """With kt, R and the supply all is known: the brake of 0.5625 is off, its tenth is in the interval of B."""
    flags = MOTOR if column == "duty" else {"kt": 1.5, "resistance": 4.0, "torque_column": "voltage"}
    record = identify_joint(SERVO.log(column), setup=IdentifySetup(**flags, torque_limit=4.5)).record
    assert record.objections == ()
    assert (
        holds(record.inertia, 0.012) and holds(record.coulomb_friction, 0.15) and holds(record.viscous_friction, 0.12)
    )
    assert record.viscous_friction is not None and record.viscous_friction.std > 0.05 * SERVO.brake / 2
    assert record.combinations[BRAKE].value == pytest.approx(WHOLE, rel=0.01)
    assert record.friction_ratio is not None and record.friction_ratio.value == pytest.approx(0.15 / 4.5, rel=0.03)
    assert record.diagnostics["drive"]["brake"] == pytest.approx(0.5625)
    assert warns_of(record, "brakes itself by kt·ke/R = 0.562, 82% of B + kt·ke/R (ke = kt)")


def test_too_much_taken_off_is_an_objection() -> None:
    """A kt of 2 in place of 1.5 without friction in the grease: the brake is more than there is."""
    flags = MOTOR | {"ke": 2.0}
    record = identify_joint(replace(SERVO, viscous=0.0).log(), setup=IdentifySetup(**flags)).record  # type: ignore[arg-type]
    assert "check --kt, --set ke, --resistance" in record.objections[0].remedy


@pytest.mark.parametrize(("flag", "missing"), [("kt", "--kt"), ("resistance", "--resistance")])
def test_without_kt_or_r_newton_metres_are_null(flag: str, missing: str) -> None:
    """Over k = kt/R = 0.375 N m/V; B/k apart from the brake where ke is known, both together where not."""
    flags = {name: value for name, value in MOTOR.items() if name != flag}
    record = identify_joint(SERVO.log(), setup=IdentifySetup(**flags)).record
    assert record.inertia is record.viscous_friction is record.coulomb_friction is record.friction_ratio is None
    assert record.combinations["f/k"].value == pytest.approx(0.15 / 0.375, rel=0.02)
    assert record.combinations[f"({BRAKE})/k"].value == pytest.approx(WHOLE / 0.375, rel=0.01)
    assert ("B/k" in record.combinations) == (flag == "resistance")
    assert warns_of(record, f"without {missing} the torque column is not in N m")


@pytest.mark.parametrize("resistance", [4.0, None])
def test_a_pendulum_tells_the_scale(resistance: float | None) -> None:
    """0.5 kg at 0.2 m: kt/R = 0.375 N m/V, and where it hangs; with R also kt and ke, without it B stays in the sum."""
    setup = IdentifySetup(duty_voltage=12.0, resistance=resistance, pendulum_mass=0.5, pendulum_length=0.2)
    record = identify_joint(SERVO.log(mass=0.5), setup=setup).record
    assert record.motor_strength is not None and record.motor_strength.value == pytest.approx(0.375, rel=0.01)
    assert record.objections == () and record.gravity_sin is None
    assert holds(record.inertia, 0.012) and holds(record.coulomb_friction, 0.15)
    assert record.combinations[BRAKE].value == pytest.approx(WHOLE, rel=0.01)
    assert warns_of(record, "it hangs at 0.30")
    if resistance is None:
        assert record.viscous_friction is None and warns_of(record, "the same at every supply voltage")
    else:
        assert holds(record.viscous_friction, 0.12) and warns_of(record, "R times kt/R by the known weight")


def test_a_pendulum_at_three_masses_is_one_fit() -> None:
    """0.2, 0.5 and 0.9 kg, each in its own sidecar: friction and kt/R of all three runs together."""
    masses = (0.2, 0.5, 0.9)
    first, *others = (
        SERVO.log(mass=mass, seed=seed, pendulum_mass=mass, pendulum_length=0.2) for seed, mass in enumerate(masses)
    )
    record = identify_joint(first, setup=IdentifySetup(duty_voltage=15.0, resistance=5.0), more=others).record
    # 15 V declared of 12: kt/R is found as 0.375 * 12 / 15, and B + kt ke/R is what it is.
    assert record.motor_strength is not None and record.motor_strength.value == pytest.approx(0.3, rel=0.01)
    assert holds(record.inertia, 0.012) and holds(record.coulomb_friction, 0.15)
    assert record.combinations[BRAKE].value == pytest.approx(WHOLE, rel=0.01)


def test_a_weight_that_contradicts_kt_and_r_is_an_objection() -> None:
    """A declared weight of 1 kg for 0.5 kg contradicts kt and R and is an objection; a right one is none."""
    wrong = IdentifySetup(**MOTOR, pendulum_mass=1.0, pendulum_length=0.2, pendulum_angle=HANGS)
    record = identify_joint(SERVO.log(mass=0.5), setup=wrong).record
    assert record.objections[0].reason == "pendulum_weight" and "2 times" in record.objections[0].seen
    right = replace(wrong, pendulum_mass=0.5)
    assert identify_joint(SERVO.log(mass=0.5), setup=right).record.objections == ()


def test_runs_with_and_without_the_current_tell_the_brake() -> None:
    """A gear that loses a sixth: ke is 1.8, kt 1.5. Alone the log of the duty finds B wrong, with the current not."""
    servo = replace(SERVO, ke=1.8)
    duty = servo.log("duty", noise=0.5, **MOTOR)
    current = servo.log("current", seed=1, noise=0.5, kt=1.5, torque_column="current")
    alone, both = (identify_joint(duty, more=more).record for more in ((), (current,)))
    assert not holds(alone.viscous_friction, 0.12) and holds(both.viscous_friction, 0.12)
    assert both.diagnostics["drive"]["source"] == "runs" and warns_of(both, "by the runs whose current was logged")
    assert both.combinations[BRAKE].value == pytest.approx(0.12 + servo.brake, rel=0.01)
