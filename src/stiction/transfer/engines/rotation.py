"""Rotations of single vectors. Quaternions are w, x, y, z."""

from __future__ import annotations

import math

import numpy as np

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
"""Orientation of a base that is not turned: it looks along x."""


def matrix(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation matrix of a unit quaternion, shape (3, 3): its columns are the frame's axes in the world."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def into_frame(quaternion: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return a vector of the world, shape (3,), as the frame of a unit quaternion sees it."""
    return vector @ matrix(quaternion)


def yaw(quaternion: np.ndarray) -> float:
    """Return the heading of a frame: the angle from the world's x to its own x, seen from above [rad]."""
    forward = matrix(quaternion)[:, 0]
    return math.atan2(forward[1], forward[0])


def cross_matrix(vector: np.ndarray) -> np.ndarray:
    """Return the matrix, (3, 3), that takes u to the cross product vector x u."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def cross(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the cross product of two vectors, shape (3,); NumPy's own takes any shape, and 30 times as long."""
    a, b, c = one
    x, y, z = other
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def about(axis: int, angle: float) -> np.ndarray:
    """Return the quaternion of a turn by an angle [rad] about x, y or z (0, 1, 2), shape (4,)."""
    quaternion = np.zeros(4)
    quaternion[0], quaternion[1 + axis] = np.cos(angle / 2), np.sin(angle / 2)
    return quaternion


def angle_between(first: np.ndarray, second: np.ndarray) -> float:
    """Return the angle of the turn from one orientation to another [rad]; quaternions of shape (4,)."""
    away = float(np.linalg.norm(matrix(first) - matrix(second)))
    return 2.0 * math.asin(min(away / 8**0.5, 1.0))
