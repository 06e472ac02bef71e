"""Motion and phases of a walk, by hand; logs that cannot be used."""

from dataclasses import replace

import numpy as np
import pytest

import walks
from stiction.core.errors import StictionError
from stiction.files.walk import WalkLog
from stiction.identification.walking.setup import WalkSetup
from stiction.identification.walking.walk import (
    Walk,
    commanded_torque,
    forward_difference,
    grow,
    hann_weights,
    second_difference,
    smooth,
)
from stiction.robots.catalog import find_robot


@pytest.fixture(scope="module")
def log() -> WalkLog:
    """One second of a walk."""
    return walks.walk(np.zeros((1, 18)), [walks.FORWARD], seconds=1.0)[0]


def test_differences_by_hand() -> None:
    """θ = t² at steps of 0.5: forward rates 0.5 and 1.5, acceleration 2."""
    angle = np.array([0.0, 0.25, 1.0])
    np.testing.assert_allclose(forward_difference(angle, 0.5), [0.5, 1.5, 1.5])
    np.testing.assert_allclose(second_difference(angle, 0.5), [0.0, 2.0, 0.0])


def test_the_controllers_torque_by_hand(log: WalkLog) -> None:
    """Mean of the law at both ends under the first target: (100·0.1 + 100·0.2 - 2.5·4) / 2 = 10, and the limit."""
    short = replace(
        log,
        **{name: getattr(log, name)[:2] for name in ("time", "angular_velocity", "quaternion", "specific_force")},
        **{name: getattr(log, name)[:2] for name in ("joint_torque", "foot_contact", "velocity_command")},
        joint_target=np.full((2, 18), 0.2),
        joint_position=np.repeat([[0.1], [0.0]], 18, axis=1),
        joint_velocity=np.repeat([[0.0], [4.0]], 18, axis=1),
    )
    np.testing.assert_allclose(commanded_torque(short)[0], 10.0)
    far = replace(short, joint_target=np.full((2, 18), 9.0))
    np.testing.assert_allclose(commanded_torque(far)[0], walks.LIMITS)


def test_what_is_missing_is_known_to_be_missing(log: WalkLog) -> None:
    """The controller's torque and gravity stand in, and later stages say so."""
    walk = Walk(replace(log, joint_torque=None, specific_force=None), walks.SPEC)
    assert not walk.measured_torque
    assert not walk.measured_acceleration
    np.testing.assert_allclose(np.linalg.norm(walk.base.pull, axis=1), 9.81)


def test_the_wrong_robot_and_the_wrong_side_of_the_gear_are_refused(log: WalkLog) -> None:
    """Rejects the masses of another robot, and torque of the wrong side of the gear."""
    with pytest.raises(StictionError, match="--robot"):
        Walk(log, find_robot("go1"))
    with pytest.raises(StictionError, match="output_side"):
        Walk(replace(log, header=replace(log.header, torque_source="output_side")), walks.SPEC)


def test_windows_and_masks_by_hand() -> None:
    """A Hann window of four steps is (1, 2, 1)/4; growing by one takes the neighbours and the ends."""
    np.testing.assert_allclose(hann_weights(0.02, 0.005), [0.25, 0.5, 0.25])
    np.testing.assert_allclose(smooth(np.array([0.0, 4.0, 0.0]), hann_weights(0.02, 0.005)), [1.0, 2.0, 1.0])
    mask = np.array([False] * 3 + [True] + [False] * 4)
    assert grow(mask, 1).tolist() == [True, False, True, True, True, False, False, True]
    assert grow(mask, 0).tolist() == mask.tolist()


def test_swing_is_found_without_contacts() -> None:
    """Feet well above the lowest one are in the air; the heights agree with the contacts."""
    log = walks.walk(np.zeros((1, 18)), [walks.FORWARD], seconds=4.0)[0]
    down = Walk(replace(log, foot_contact=None), walks.SPEC).down
    assert log.foot_contact is not None
    high = ~down
    assert 0.25 < high.mean() < 0.55
    assert log.foot_contact[high].mean() < 0.03


@pytest.mark.parametrize(
    "change",
    [{"slow": -1.0}, {"smoothing": float("nan")}, {"payload": float("inf")}, {"centre_of_mass": (0, 0, np.nan)}],
)
def test_settings_without_meaning_are_refused(change: dict) -> None:
    """One line, before any work."""
    with pytest.raises(StictionError, match="expected"):
        WalkSetup(**change)
