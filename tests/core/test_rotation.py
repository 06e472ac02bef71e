"""Rotations by hand, and those of many against those of one."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.core.rotation import (
    about,
    about_vector,
    angle_between,
    into_frame,
    into_frames,
    matrices_about,
    matrix,
    roll_pitch,
    small_turns,
    tilted,
    up_in_frames,
    uprightness,
    yaw,
)


def test_a_quarter_turn_about_z() -> None:
    """X of the frame is y of the world; what points along y in the world points along x in the frame."""
    turn = about(2, np.pi / 2)
    np.testing.assert_allclose(turn, [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    np.testing.assert_allclose(matrix(turn) @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(into_frame(turn, np.array([0.0, 1.0, 0.0])), [1.0, 0.0, 0.0], atol=1e-15)


def test_the_angle_between_orientations_knows_no_sign_of_a_quaternion() -> None:
    """A quaternion and its negative are one orientation; half a turn is the largest angle."""
    one, other = about(0, 0.3), about(0, 1.0)
    for sign in (1.0, -1.0):
        assert abs(angle_between(one, sign * other) - 0.7) < 1e-12
    assert abs(angle_between(about(1, 0.0), about(1, np.pi)) - np.pi) < 1e-12


def test_the_heading_is_the_yaw() -> None:
    """Equals the yaw of a rotation of 30° about z, then 10° about y."""
    turn, pitch = np.radians(30), np.radians(10)
    cy, sy, cp, sp = np.cos(turn / 2), np.sin(turn / 2), np.cos(pitch / 2), np.sin(pitch / 2)
    assert yaw(np.array([cy * cp, -sy * sp, cy * sp, sy * cp])) == pytest.approx(turn)


def test_up_in_a_tilted_base() -> None:
    """Rolled a quarter turn to the right side down... the world's up is then along the base's y."""
    half = np.sqrt(0.5)
    quaternion = np.array([[1.0, 0, 0, 0], [half, half, 0, 0], [half, 0, half, 0]])
    np.testing.assert_allclose(up_in_frames(quaternion), [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-12)


@pytest.mark.parametrize("angle", [-1.2, 0.0, 0.7])
def test_roll_and_pitch_of_turns_about_one_axis(angle: float) -> None:
    """A wrong sign or order would make the robot lean into its fall."""
    half = angle / 2
    about_x = roll_pitch(np.array([np.cos(half), np.sin(half), 0, 0]))
    about_y = roll_pitch(np.array([np.cos(half), 0, np.sin(half), 0]))
    about_z = roll_pitch(np.array([np.cos(half), 0, 0, np.sin(half)]))
    np.testing.assert_allclose([about_x, about_y, about_z], [[angle, 0], [0, angle], [0, 0]], atol=1e-12)


def test_base_velocity_is_in_the_base_frame() -> None:
    """A base turned left by 90° that moves along the world's y moves along its own x."""
    quaternion = np.array([[np.sqrt(0.5), 0, 0, np.sqrt(0.5)]])
    np.testing.assert_allclose(into_frames(quaternion, np.array([[0.0, 2.0, 0.0]])), [[2.0, 0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(uprightness(np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0]])), [1.0, -1.0])


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_turns_about_an_axis_are_the_same_however_they_are_written(axis: int) -> None:
    """An engine builds its frames from one, the ground of a course from another."""
    angle = np.array([-2.0, 0.3, 1.5])
    np.testing.assert_array_equal(about(axis, angle), [about_vector(np.eye(3)[axis], one) for one in angle])
    turned = [matrix(quaternion) for quaternion in about(axis, angle)]
    np.testing.assert_allclose(matrices_about(np.eye(3)[axis], angle), turned, atol=1e-15)


def test_a_small_turn_is_the_tilt_that_made_it() -> None:
    """Rolled by 0.002 and pitched by -0.004 rad from any orientation; a quaternion stays of unit length."""
    start = np.array([about(2, 1.0), about(0, -0.5)])
    end = tilted(start, np.tile([1.0, 0.001, -0.002], (2, 1)))
    np.testing.assert_allclose(small_turns(start, end), np.tile([0.002, -0.004, 0.0], (2, 1)), atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(end, axis=1), 1.0, atol=1e-15)
