"""Torque of a motor, with numbers worked out by hand."""

import numpy as np
import pytest

from stiction.virtual.hardware import (
    LOSS_AT_LIMIT,
    LOWEST_VOLTAGE,
    Drive,
    Motors,
    drawn_power,
    within_limits,
)

LIMIT = np.array([45.0])


def one(value: float) -> np.ndarray:
    """Return one joint."""
    return np.array([value])


@pytest.mark.parametrize(
    ("torque", "speed", "torque_limit"),
    [
        (60.0, 0.0, 45.0),
        (-60.0, 5.0, -45.0),
        (60.0, 10.0, 45.0),
        (60.0, 15.0, 22.5),
        (10.0, 15.0, 10.0),
        (60.0, 20.0, 0.0),
        (60.0, 25.0, 0.0),
        (-60.0, 25.0, -45.0),
        (-60.0, -15.0, -22.5),
    ],
)
def test_torque_falls_with_speed_when_driving_and_not_when_braking(
    torque: float, speed: float, torque_limit: float
) -> None:
    """Knee at 10 of 20 rad/s: half of the torque is left at 15, nothing from 20 on."""
    assert within_limits(one(torque), one(speed), LIMIT, one(20.0), 0.5)[0] == pytest.approx(torque_limit)


def test_a_flat_battery_shifts_the_curve_down() -> None:
    """At half the voltage the motor is at its end at 10 rad/s, where a full battery still gives everything."""
    motors = Motors(one(1.0), one(1.0), one(1.0), one(20.0), 0.5, charge=0.5, resistance=0.0)
    full = Motors(one(1.0), one(1.0), one(1.0), one(20.0), 0.5, charge=1.0, resistance=0.0)
    assert Drive(motors, LIMIT, 1e-3).torque(one(60.0), one(7.5))[0][0] == pytest.approx(22.5)
    assert Drive(full, LIMIT, 1e-3).torque(one(60.0), one(7.5))[0][0] == pytest.approx(45.0)


def test_power_is_work_and_heat_and_never_charges_the_battery() -> None:
    """45 N m at 2 rad/s: 90 W of work and all of the heat; a braking motor gives back no more than others take."""
    assert drawn_power(LIMIT, one(2.0), LIMIT) == pytest.approx(90.0 + LOSS_AT_LIMIT)
    assert drawn_power(LIMIT / 3, one(0.0), LIMIT) == pytest.approx(LOSS_AT_LIMIT / 9)
    assert drawn_power(-LIMIT, one(50.0), LIMIT) == 0.0
    assert drawn_power(np.array([10.0, -10.0]), np.array([3.0, 2.0]), np.array([1e9, 1e9])) == pytest.approx(10.0)


def test_the_battery_sags_under_load_recovers_and_ends_at_its_floor() -> None:
    """V = charge − R P once the capacitors have followed; 1 kW on 1e-4 per watt are a tenth of the voltage."""
    motors = Motors(one(1.0), one(1.0), one(1.0), one(np.inf), 0.5, charge=0.9, resistance=1e-4)
    drive = Drive(motors, LIMIT, 1e-3)
    assert drive.voltage == 0.9
    drive.torque(one(45.0), one(200 / 45))
    assert drive.voltage == pytest.approx(0.9 - 0.1 * 1e-4 * (200 + LOSS_AT_LIMIT))
    for _ in range(200):
        drive.torque(one(45.0), one(200 / 45))
    assert drive.voltage == pytest.approx(0.9 - 1e-4 * (200 + LOSS_AT_LIMIT))
    for _ in range(200):
        drive.torque(one(0.0), one(0.0))
    assert drive.voltage == pytest.approx(0.9)
    for _ in range(200):
        drive.torque(one(45.0), one(1e5))
    assert drive.voltage == pytest.approx(LOWEST_VOLTAGE)
