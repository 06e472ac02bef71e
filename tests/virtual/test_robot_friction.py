"""Friction that differs between joints, and its wear; the numbers are worked out by hand."""

from dataclasses import fields, replace

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.engines.engine import Motion
from stiction.robots.catalog import find_robot
from stiction.virtual.hidden import FrictionShape
from stiction.virtual.robot import SEALS_OUT, Wear

SHAPE = FrictionShape(
    share=np.array([0.8, 1.2]),
    static_ratio=np.array([1.5, 1.0]),
    stribeck_velocity=np.array([0.1, 0.1]),
    load_share=np.array([0.5, 1.5]),
)
NONE = np.zeros(2)
NOTHING = Motion(**{part.name: NONE for part in fields(Motion)})


def test_each_joint_has_its_own_share_curve_and_load_coefficient() -> None:
    """It is f r at rest, f (1 + (r − 1)/e) at v_s, f far above it; 100 N at c = 0.02 are 2 N m times its share."""
    friction = SHAPE.at(np.array([0.5, 0.25]), 0.0, 0.001)
    for speed, bound in ((0.0, [0.6, 0.3]), (-0.1, [0.4 * (1 + 0.5 / np.e), 0.3]), (2.0, [0.4, 0.3])):
        np.testing.assert_allclose(friction.bound(replace(NOTHING, joint_velocity=np.full(2, speed)), NONE), bound)
    loaded = replace(NOTHING, joint_force=np.full(2, 60.0), joint_torque=np.full(2, 40.0))
    np.testing.assert_allclose(SHAPE.at(NONE, 0.02, 0.001).bound(loaded, NONE), [1.0, 3.0])


def test_perfect_joints_have_coulombs_law_at_the_level() -> None:
    """The same at rest and in motion, in every joint, or the cells without friction of its own would have some."""
    friction = FrictionShape.perfect(2).at(np.array([0.5, 0.25]), 0.0, 0.001)
    for speed in (0.0, 0.1, 3.0):
        moving = replace(NOTHING, joint_velocity=np.full(2, speed))
        np.testing.assert_array_equal(friction.bound(moving, NONE), [0.5, 0.25])


def test_wear_grows_by_equal_ratios_from_the_seals_out_to_three() -> None:
    """A third of the way from 0.3 to 3 in 60 s is a factor of 10^(1/3); before and after it stands still."""
    wear = Wear()
    assert [wear.factor(time) for time in (-5.0, 0.0, 20.0, 60.0, 90.0)] == pytest.approx(
        [SEALS_OUT, SEALS_OUT, 0.3 * 10 ** (1 / 3), 3.0, 3.0]
    )


def test_one_joint_a_kind_or_all_joints_wear() -> None:
    """A name that the robot does not have must not wear nothing without a word."""
    names = find_robot("go1").joint_names
    assert Wear().worn(names).all()
    assert [name for name, worn in zip(names, Wear(("FL_calf_joint",)).worn(names), strict=True) if worn] == [
        "FL_calf_joint"
    ]
    assert sum(Wear(("calf", "FL_hip_joint")).worn(names)) == 5
    with pytest.raises(StictionError, match="unknown joint 'knee'; known: FL_calf_joint"):
        Wear(("knee",)).worn(names)
    with pytest.raises(StictionError, match="three positive numbers"):
        Wear(start=0.0)
