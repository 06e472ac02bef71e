"""Rotations of single vectors, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.transfer.engines.rotation import about, angle_between, cross_matrix, into_frame, matrix, yaw


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


def test_a_cross_product_is_a_matrix() -> None:
    """X cross y is z."""
    assert (cross_matrix(np.array([1.0, 0.0, 0.0])) @ [0.0, 1.0, 0.0]).tolist() == [0.0, 0.0, 1.0]


def test_the_heading_is_the_yaw() -> None:
    """If this failed, a pilot would correct a heading that the robot does not have: 30° about z, then 10° about y."""
    turn, pitch = np.radians(30), np.radians(10)
    cy, sy, cp, sp = np.cos(turn / 2), np.sin(turn / 2), np.cos(pitch / 2), np.sin(pitch / 2)
    assert yaw(np.array([cy * cp, -sy * sp, cy * sp, sy * cp])) == pytest.approx(turn)
