"""The speed that the controller prints, worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.deploy.observation import Sensors
from stiction.exchange.webots.controller import Odometer
from stiction.files.velocity import parse_command


def test_speed_is_measured_along_the_command_in_the_robots_own_frame() -> None:
    """Speed is measured along the command in the robot's frame, as in `stiction evaluate`.

    Facing along y, 1 cm forward and 4 mm to the left (along -x) in each 20 ms: 0.5 and 0.2 m/s, and 0.3 rad/s.
    """
    odometer = Odometer(0.02)
    for k in range(151):
        place = np.array([-0.004 * k, 0.01 * k if k > 99 else 0.0, 0.3])
        left = np.array([0.5**0.5, 0.0, 0.0, 0.5**0.5])
        sensors = Sensors(left, np.array([0.0, 0.0, 0.3]), *np.zeros((2, 18)))
        assert odometer.speed(parse_command("vx=1")) is None or k > 100
        odometer.add(place, sensors)
    # The first 100 periods, 2 s, do not count; the jump along y is in the last of them.
    assert odometer.speed(parse_command("vx=1")) == pytest.approx(0.5)
    assert odometer.speed(parse_command("vx=-1")) == pytest.approx(-0.5)
    assert odometer.speed(parse_command("vx=0.3,vy=0.4")) == pytest.approx(0.6 * 0.5 + 0.8 * 0.2)
    assert odometer.speed(parse_command("wz=1")) == pytest.approx(0.3)
    assert odometer.speed(parse_command("stand")) is None
