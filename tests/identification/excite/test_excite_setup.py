"""What is refused before anything is computed, and where defaults come from."""

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


def test_friction_is_a_share_of_the_torque_limit_where_nobody_knows_better() -> None:
    """One per cent is what ordinary legs have."""
    assert ExciteSetup(torque_limit=50.0).filled().coulomb == pytest.approx(0.5)
    assert ExciteSetup(torque_limit=50.0, coulomb=0.1).filled().coulomb == 0.1
    filled = ExciteSetup().filled(find_robot("go2").joints[2])  # whose file has no friction
    assert (filled.coulomb, filled.viscous) == (pytest.approx(0.4543), 0.07)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"position_limits": (0.6, -0.6)}, "--position-limits 0.6 -0.6"),
        ({"start": 2.0}, "--start 2.0"),
        ({"kp": float("nan")}, "--kp nan"),
        ({"kd": -0.1}, "--kd -0.1"),
        ({"speed_limit": -1.0}, "--speed-limit -1.0"),
        ({"speed_limit": float("inf")}, "--speed-limit inf"),
        ({"rate": 10.0}, "--rate 10"),
        ({"coulomb": 25.0}, "the motor could not move the joint"),
        ({"coulomb": 15.0, "gravity_sin": 6.0}, "the motor could not move the joint"),
        ({"noise_torque": 0.0}, "--noise-torque 0.0"),
        ({"noise_position": 0.0}, "no sensor is perfect"),
        ({"resolution": -1.0}, "--resolution -1.0"),
        ({"spread": 0.5}, "--spread 0.5"),
        ({"duration": 1.0}, "at least 50 Hz and 4 s"),
        ({"duration": 1e9}, "at most 1000000 samples"),
        ({"wanted": 0.0}, "--wanted 0.0"),
        ({"seed": -1}, "--seed -1"),
    ],
)
def test_what_no_joint_controller_or_log_has_is_refused(wrong: dict, said: str) -> None:
    """One line that names the flag and what came."""
    with pytest.raises(StictionError) as caught:
        replace(ExciteSetup(), **wrong).filled()
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_torque_noise_does_not_matter_where_no_torque_is_logged() -> None:
    """A user without a current sensor need not invent one."""
    assert ExciteSetup(position_only=True, noise_torque=0.0).filled().position_only
