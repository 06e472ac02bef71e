"""Friction that differs between joints, with speed, load and age; the numbers are worked out by hand."""

import numpy as np
import pytest

from stiction.formats.errors import StictionError
from stiction.robots.catalog import find_robot
from stiction.transfer.robot.friction import DryFriction, FrictionShape
from stiction.transfer.robot.wear import SEALS_OUT, Wear

SHAPE = FrictionShape(
    share=np.array([0.8, 1.2]),
    static_ratio=np.array([1.5, 1.0]),
    stribeck_velocity=np.array([0.1, 0.1]),
    load_share=np.array([0.5, 1.5]),
)
NONE = np.zeros(2)


def test_each_joint_has_its_own_share_and_its_own_stribeck_curve() -> None:
    """It is f r at rest, f (1 + (r − 1)/e) at v_s, f far above it."""
    friction = DryFriction(SHAPE, np.array([0.5, 0.25]), 0.0, 0.001)
    np.testing.assert_allclose(friction.bound(NONE, NONE), [0.6, 0.3])
    np.testing.assert_allclose(friction.bound(np.array([-0.1, 0.1]), NONE), [0.4 * (1 + 0.5 / np.e), 0.3])
    np.testing.assert_allclose(friction.bound(np.array([2.0, -2.0]), NONE), [0.4, 0.3])


def test_load_adds_friction_and_half_of_a_change_is_there_after_5_ms() -> None:
    """As in the law `load` of the training, whatever the physics step."""
    for timestep, steps in ((0.005, 1), (0.001, 5)):
        friction = DryFriction(SHAPE, NONE, 0.02, timestep)
        np.testing.assert_allclose(friction.bound(NONE, np.array([100.0, 100.0])), [1.0, 3.0])
        for _ in range(steps):
            bound = friction.bound(NONE, np.array([300.0, 100.0]))
        np.testing.assert_allclose(bound, [2.0, 3.0])


def test_a_robot_that_is_put_down_anew_has_no_old_load() -> None:
    """Or the first steps of an episode would depend on the one before."""
    friction = DryFriction(SHAPE, NONE, 0.02, 0.001)
    friction.bound(NONE, np.array([1e3, 1e3]))
    friction.reset()
    np.testing.assert_allclose(friction.bound(NONE, np.array([100.0, 0.0])), [1.0, 0.0])


def test_wear_acts_on_what_a_bench_measures_and_not_on_the_load_term() -> None:
    """The paper's seals were measured without load."""
    friction = DryFriction(SHAPE, np.array([0.5, 0.5]), 0.02, 0.001)
    bound = friction.bound(np.array([5.0, 5.0]), np.array([10.0, 10.0]), np.array([3.0, 1.0]))
    np.testing.assert_allclose(bound, [3 * 0.4 + 0.1, 0.6 + 0.3])


def test_wear_grows_by_equal_ratios_from_the_seals_out_to_three() -> None:
    """A third of the way from 0.3 to 3 in 60 s is a factor of 10^(1/3); before and after it stands still."""
    wear = Wear()
    assert [wear.factor(time) for time in (-5.0, 0.0, 20.0, 60.0, 90.0)] == pytest.approx(
        [SEALS_OUT, SEALS_OUT, 0.3 * 10 ** (1 / 3), 3.0, 3.0]
    )
    assert wear.factor(wear.time_at(1.0)) == pytest.approx(1.0)
    assert wear.time_at(1.0) == pytest.approx(60 * np.log10(1 / 0.3))
    assert (wear.time_at(0.1), wear.time_at(10.0)) == (0.0, 60.0)


def test_one_joint_a_kind_or_all_joints_wear() -> None:
    """A name that the robot does not have must not wear nothing without a word."""
    names = find_robot("go1").joint_names
    assert Wear().worn(names).all()
    assert [name for name, worn in zip(names, Wear(("FL_shank",)).worn(names), strict=True) if worn] == ["FL_shank"]
    assert sum(Wear(("shank", "FL_hip")).worn(names)) == 5
    with pytest.raises(StictionError, match="wear of 'knee': expected some of FL_hip"):
        Wear(("knee",)).worn(names)
    with pytest.raises(StictionError, match="three positive numbers"):
        Wear(start=0.0)
