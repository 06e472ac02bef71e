"""Friction that differs between joints, and its wear; the numbers are worked out by hand."""

from dataclasses import fields, replace

import numpy as np
import pytest

from stiction.engines.engine import Motion
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


def test_wear_grows_by_equal_ratios_from_the_seals_out_to_three() -> None:
    """A third of the way from 0.3 to 3 in 60 s is a factor of 10^(1/3); before and after it stands still."""
    wear = Wear()
    assert [wear.factor(time) for time in (-5.0, 0.0, 20.0, 60.0, 90.0)] == pytest.approx(
        [SEALS_OUT, SEALS_OUT, 0.3 * 10 ** (1 / 3), 3.0, 3.0]
    )
