"""Rejections before any computation, and the sources of defaults."""

from __future__ import annotations

from dataclasses import replace

import pytest

from stiction.core.errors import StictionError
from stiction.identification.excite.setup import ExciteSetup
from stiction.robots.catalog import find_robot


def test_a_robot_fills_in_what_the_user_left_out() -> None:
    """The user's own numbers win; friction of the shank is the paper's."""
    filled = ExciteSetup(kp=30.0).filled(find_robot("saturn_lite").joints[2])
    assert (filled.kp, filled.kd, filled.torque_limit, filled.coulomb) == (30.0, 2.5, 45.0, 0.442)
    assert filled.position_limits == (-2.6, -0.4) and filled.start == pytest.approx(-1.5)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"position_limits": (0.6, -0.6)}, "--position-limits 0.6 -0.6"),
        ({"kp": float("nan")}, "--kp nan"),
        ({"speed_limit": -1.0}, "--speed-limit -1.0"),
        ({"coulomb": 25.0}, "the motor could not move the joint"),
        ({"noise_position": 0.0}, "no sensor is perfect"),
        ({"spread": 0.5}, "--spread 0.5"),
        ({"duration": 1.0}, "at least 50 Hz and 4 s"),
    ],
)
def test_what_no_joint_controller_or_log_has_is_refused(wrong: dict, message: str) -> None:
    """Rejects a flag in one line, with its name and value."""
    with pytest.raises(StictionError) as caught:
        replace(ExciteSetup(), **wrong).filled()
    assert message in str(caught.value) and "\n" not in str(caught.value)
