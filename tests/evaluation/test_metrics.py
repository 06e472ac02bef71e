"""Every column of results.csv, against numbers worked out by hand."""

import numpy as np
import pytest

from stiction.evaluation.metrics import measure
from stiction.files.velocity import parse_command
from stiction.files.walk import Recording

GROUPS = np.array([0, 1, 1, 0])


def recording(steps: int = 100, robots: int = 2, period: float = 0.1, **fields: np.ndarray) -> Recording:
    """Return robots that stand upright on all feet, with some fields replaced."""
    values = {
        "velocity": np.zeros((steps, robots, 3)),
        "position": np.zeros((steps, robots, 2)),
        "contact": np.ones((steps, robots, 4), dtype=bool),
        "power": np.zeros((steps, robots)),
        "square_acceleration": np.zeros((steps, robots)),
        "upright": np.ones((steps, robots), dtype=bool),
    }
    return Recording(period, **(values | fields))


def walking(speed: float, steps: int = 100, robots: int = 2) -> Recording:
    """Return robots that walk forward at a constant speed."""
    velocity = np.zeros((steps, robots, 3))
    velocity[..., 0] = speed
    position = np.zeros((steps, robots, 2))
    position[..., 0] = (np.arange(steps) * 0.1 * speed)[:, None]
    return recording(velocity=velocity, position=position)


def test_a_robot_at_four_fifths_of_the_speed() -> None:
    """0.4 of 0.5 m/s is a ratio of 0.8, an error of 0.1 m/s and 99 * 0.04 m."""
    metrics = measure(walking(0.4), parse_command("vx=0.5"), GROUPS, weight=98.1)
    assert metrics.speed_ratio == pytest.approx(0.8)
    assert metrics.tracking_error == pytest.approx(0.1)
    assert metrics.distance == pytest.approx(3.96)
    assert metrics.fall_rate == 0.0


def test_speed_after_a_fall_is_zero() -> None:
    """One of two robots falls half-way: its mean speed is half, though it slides on."""
    walk = walking(0.5)
    walk.upright[50:, 1] = False
    metrics = measure(walk, parse_command("vx=0.5"), GROUPS, 98.1)
    assert metrics.speed_ratio == pytest.approx(0.75)
    assert metrics.fall_rate == 0.5
    assert metrics.tracking_error == pytest.approx(0.125)
    assert metrics.distance == pytest.approx((99 + 49) / 2 * 0.05)


def test_sway_within_a_second_is_no_error_but_a_lasting_one_is() -> None:
    """Error is taken over windows of 1 s: ten steps here."""
    walk = walking(0.5)
    walk.velocity[..., 1] = 0.2 * (-1.0) ** np.arange(100)[:, None]
    assert measure(walk, parse_command("vx=0.5"), GROUPS, 98.1).tracking_error == pytest.approx(0.0, abs=1e-12)
    walk.velocity[..., 1] = 0.2 * np.repeat([1.0, -1.0], 50)[:, None]
    assert measure(walk, parse_command("vx=0.5"), GROUPS, 98.1).tracking_error == pytest.approx(0.2)


def test_a_pure_turn_is_measured_in_radians() -> None:
    """0.4 of 0.5 rad/s; the base's own drift is not a tracking error of a turn."""
    velocity = np.zeros((100, 2, 3))
    velocity[..., 2], velocity[..., 0] = -0.4, 0.05
    metrics = measure(recording(velocity=velocity), parse_command("wz=-0.5"), GROUPS, 98.1)
    assert metrics.speed_ratio == pytest.approx(0.8)
    assert metrics.tracking_error == pytest.approx(0.1)


def test_standing_has_no_ratio_and_no_gait() -> None:
    """Without a commanded velocity the ratio and the gait shares are None."""
    metrics = measure(walking(0.2), parse_command("stand"), GROUPS, 98.1)
    assert (metrics.speed_ratio, metrics.tripod_share, metrics.flight_share) == (None, None, None)
    assert metrics.tracking_error == pytest.approx(0.2)


def test_cost_of_transport_by_hand() -> None:
    """50 W for 10 s over 10 kg * 9.81 m/s² * 4.95 m; None for a robot that stays."""
    walk = walking(0.5)
    walk.power[:] = 50.0
    metrics = measure(walk, parse_command("vx=0.5"), GROUPS, weight=98.1)
    assert metrics.cost_of_transport == pytest.approx(500.0 / (10.0 * 9.81 * 4.95))
    assert measure(recording(), parse_command("vx=0.5"), GROUPS, 98.1).cost_of_transport is None


def test_jitter_is_a_root_mean_square_over_robots_that_stand() -> None:
    """Mean squares 9 and 16 give sqrt(12.5); a fallen robot is left out."""
    acceleration = np.tile([9.0, 16.0], (100, 1))
    assert measure(
        recording(square_acceleration=acceleration), parse_command("vx=0.5"), GROUPS, 98.1
    ).joint_jitter == pytest.approx(np.sqrt(12.5))
    upright = np.ones((100, 2), dtype=bool)
    upright[:, 1] = False
    fallen = recording(square_acceleration=acceleration, upright=upright)
    assert measure(fallen, parse_command("vx=0.5"), GROUPS, 98.1).joint_jitter == pytest.approx(3.0)


def test_gait_shares_are_of_moving_steps_and_literal_sets() -> None:
    """Eight moving steps: three on group 0, two on group 1, one in flight, one on three feet, one on all."""
    contact = np.zeros((10, 1, 4), dtype=bool)
    contact[0:3, 0] = [1, 0, 0, 1]
    contact[3:5, 0] = [0, 1, 1, 0]
    contact[6, 0] = [1, 1, 0, 1]
    contact[7, 0] = [1, 1, 1, 1]
    velocity = np.zeros((10, 1, 3))
    velocity[:8, :, 0] = 0.3
    contact[8:, 0] = [1, 0, 0, 1]  # standing still on one group is no step
    metrics = measure(recording(10, 1, contact=contact, velocity=velocity), parse_command("vx=0.5"), GROUPS, 98.1)
    assert metrics.group_share == pytest.approx((3 / 8, 2 / 8))
    assert metrics.tripod_share == pytest.approx(5 / 8)
    assert metrics.flight_share == pytest.approx(1 / 8)
    assert metrics.moving_share == pytest.approx(8 / 10)
