"""Friction that depends on the angle: by hand where a hand can do it, else against small steps of another method."""

from __future__ import annotations

import numpy as np
import pytest

from small_steps import STEP, small_steps
from stiction.joints.friction import PositionDependent
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Gravity, Joint, simulate

TIME = STEP * np.arange(500)
LAW = PositionDependent(0.2, 0.3, 0.5, 0.1)
"""0.2 N m at 0.1 rad; 0.2 + 0.12 + 0.08 = 0.4 N m at 0.5 rad; 0.2 − 0.06 + 0.02 = 0.16 N m at −0.1 rad."""


def test_what_the_angle_adds_by_hand() -> None:
    """On top of 0.2 N m: nothing in the middle, 0.2 at 0.5 rad, −0.04 at −0.1 rad; slope 0.3 + 2 · 0.5 (θ − 0.1)."""
    angles = np.array([0.1, 0.5, -0.1])
    np.testing.assert_allclose(LAW.at_angle(angles), [0.0, 0.2, -0.04], atol=1e-12)
    np.testing.assert_allclose(LAW.slope_at_angle(angles), [0.3, 0.7, 0.1])
    assert [piece.level for piece in LAW.pieces(1)] == [piece.level for piece in LAW.pieces(-1)] == [0.2]


def test_friction_is_never_less_than_nothing() -> None:
    """0.1 N m with a slope of 1 N m/rad would be negative under −0.1 rad: there it is zero, and so is its slope."""
    law = PositionDependent(0.1, 1.0, 0.0)
    angles = np.array([-1.0, -0.1001, -0.0999, 0.0, 1.0])
    np.testing.assert_allclose(0.1 + law.at_angle(angles), [0.0, 0.0, 0.0001, 0.1, 1.1], atol=1e-12)
    np.testing.assert_allclose(law.slope_at_angle(angles), [0.0, 0.0, 1.0, 1.0, 1.0])
    wide = np.linspace(-10, 10, 2001)
    assert (0.2 + PositionDependent(0.2, 0.7, -0.3).at_angle(wide)).min() == 0.0


@pytest.mark.parametrize(("start", "friction"), [(0.5, 0.4), (0.1, 0.2), (-0.1, 0.16)])
@pytest.mark.parametrize("direction", [1, -1])
def test_break_away_at_an_angle(start: float, friction: float, direction: int) -> None:
    """At kp 10 and a target that leaves at 1 rad/s, the joint lets go after friction / 10 seconds, either way."""
    made = simulate(Joint(0.01, 0.1, LAW), PDGains(10.0, 0.0), STEP, start + direction * TIME[:40], position=start)
    held = round(friction / 10 / STEP)
    np.testing.assert_array_equal(made.velocity[:held], 0.0)
    assert abs(made.velocity[held]) < 1e-12 and direction * made.velocity[held + 1] > 1e-4


def test_coasting_stops_where_the_energy_is_used_up() -> None:
    """From 2 rad/s with I = 0.01, 0.02 J: 0.1 θ + 0.5 · 0.2 θ² = 0.02 gives θ = (√0.018 − 0.1) / 0.2 = 0.1708 rad."""
    made = simulate(
        Joint(0.01, 0.0, PositionDependent(0.1, 0.2, 0.0)), PDGains(1e-9, 0.0), STEP, np.zeros(500), velocity=2.0
    )
    assert made.position[-1] == pytest.approx((np.sqrt(0.018) - 0.1) / 0.2, rel=1e-4)
    assert made.velocity[-1] == 0.0


def test_friction_that_ends_lets_the_joint_coast() -> None:
    """Where friction would fall under zero it is gone: the joint goes on at constant speed and is not driven.

    0.1 N m falling by 1 N m/rad is used up at 0.1 rad, after 0.5 · 0.1 · 0.1 = 0.005 J of 0.02 J: √3 rad/s are left.
    """
    law = PositionDependent(0.1, -1.0, 0.0)
    made = simulate(Joint(0.01, 0.0, law), PDGains(1e-9, 0.0), STEP, np.zeros(300), velocity=2.0)
    assert made.position[-1] > 0.5
    np.testing.assert_allclose(made.velocity[made.position > 0.11], np.sqrt(3.0), rtol=2e-4)


@pytest.mark.parametrize(
    "joint",
    [
        Joint(0.0145, 0.0704, LAW, -0.05),
        Joint(0.0145, 0.0704, PositionDependent(0.3, -0.4, 0.2, -0.2), 0.02),
        Joint(0.0145, 0.0704, PositionDependent(0.1, 0.6, 0.0)),
        Joint(0.02, 0.07, LAW, 0.02, Gravity(2.5, -0.8)),
    ],
    ids=["rising", "falling", "ends", "gravity"],
)
@pytest.mark.parametrize("limit", [45.0, 2.5])
def test_it_agrees_with_small_steps(joint: Joint, limit: float) -> None:
    """Steps of 1e-5 s of another method, over stick, slip, and the motor's limit."""
    law = joint.friction
    assert isinstance(law, PositionDependent)

    def size(direction: float, speed: float, load: float, angle: float) -> float:
        away = angle - law.middle
        return max(law.level + law.slope * away + law.curvature * away * away, 0.0)

    target = 0.4 * np.sin(4 * np.pi * TIME) + 0.2 * np.sin(22 * TIME)
    gains = PDGains(20.0, 0.5, limit)
    made = simulate(joint, gains, STEP, target)
    position, velocity = small_steps(joint, gains, target, size)
    assert np.abs(made.position - position).max() < 2e-3 * np.abs(position).max()
    assert np.abs(made.velocity - velocity).max() < 6e-3 * np.abs(velocity).max()
