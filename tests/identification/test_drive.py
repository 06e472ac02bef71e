"""Torque columns that hold a current, a voltage or a duty: the conversion by hand, and rejections."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.core.errors import ConfigurationError, LogError
from stiction.identification.runs import make_run
from stiction.identification.setup import Drive, IdentifySetup
from stiction_experiments.flags.servo import SERVO

COLUMN, SPEED = np.array([0.5, -0.5, 0.0]), np.array([1.0, 0.0, -2.0])


@pytest.mark.parametrize(
    ("drive", "torque"),
    [
        (Drive(), [0.5, -0.5, 0.0]),
        (Drive("current", kt=2.0), [1.0, -1.0, 0.0]),
        (Drive("current"), [0.5, -0.5, 0.0]),
        (Drive("duty", 10.0, kt=2.0, resistance=4.0), [1.5, -2.5, 2.0]),
        (Drive("duty", 10.0, kt=2.0, resistance=4.0, ke=3.0), [1.0, -2.5, 3.0]),
        (Drive("voltage", kt=2.0, resistance=4.0), [-0.75, -0.25, 2.0]),
        (Drive("duty", 10.0, kt=2.0), [3.0, -5.0, 4.0]),
        (Drive("duty", 10.0), [5.0, -5.0, 0.0]),
    ],
)
def test_torque_by_hand(drive: Drive, torque: list[float]) -> None:
    """Kt (10 V times the duty less ke θ') / 4 ohm; volts across the resistance where kt/R is not known."""
    assert drive.torque("log", COLUMN, 1.0, SPEED) == pytest.approx(torque)


def test_what_is_in_the_viscous_friction_and_what_lacks() -> None:
    """Kt ke/R = 2 * 3 / 4 was taken off, or is still in; without kt or R the scale is not known."""
    assert Drive("duty", 10.0, 2.0, 4.0, 3.0).brake == 1.5 and not Drive("duty", 10.0, 2.0).brakes_unseen
    assert Drive("voltage", None, None, 4.0).brakes_unseen and Drive("voltage", None, None, 4.0).brake == 0.0
    assert Drive("duty", 10.0).lacking == ("--kt", "--resistance") and Drive("duty", 10.0, 2.0).lacking == (
        "--resistance",
    )
    assert Drive("current").lacking == ("--kt",) and Drive().lacking == Drive("current", kt=1.0).lacking == ()


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        ({"torque_column": "duty"}, "--duty-voltage"),
        ({"kt": 1.5}, "kt 1.5 has no effect on a torque column that holds torque"),
        ({"torque_column": "voltage", "duty_voltage": 12.0}, "duty voltage 12 has no effect"),
        ({"duty_voltage": 12.0, "kt": -1.0}, "kt -1.0: expected a positive number"),
        ({"duty_voltage": float("nan")}, "duty voltage nan"),
        ({"pendulum_mass": 0.5}, "pendulum_mass without pendulum_length"),
        ({"pendulum_mass": 0.5, "pendulum_length": 0.2, "gravity": True}, "leave gravity out"),
        ({"pendulum_mass": 0.5, "pendulum_length": 0.2, "axis": "linear"}, "linear axis"),
    ],
)
def test_flags_that_cannot_be(flags: dict[str, object], message: str) -> None:
    """Rejects a number without effect and an incomplete set, by name."""
    with pytest.raises(ConfigurationError, match=message):
        IdentifySetup(**flags).check()  # type: ignore[arg-type]


def test_a_duty_is_a_share() -> None:
    """Percent and counts are refused with the scale that mends them; so is a share that is taken for percent."""
    duty = SERVO.log(noise=0.0)
    percent = SERVO.log(noise=0.0, torque_scale=0.01)
    hundred = SERVO.log(column="voltage", noise=0.0)
    setup = IdentifySetup(duty_voltage=12.0, kt=1.5, resistance=4.0)
    with pytest.raises(LogError, match=r"the duty reaches 9\.\d+; expected a share from -1 to 1: in percent"):
        make_run(hundred, None, setup)
    with pytest.raises(LogError, match=r"the duty column reaches 0\.\d+, .* looks like a share already"):
        make_run(percent, None, setup)
    assert np.abs(make_run(duty, None, setup).torque).max() < 4.5
