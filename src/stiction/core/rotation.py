"""Rotations in NumPy, and gravity. Quaternions are of unit length, in the order w, x, y, z; angles are in rad.

A function with a name in the singular takes one quaternion, shape (4,), and vectors of shape (3,); its plural takes N
of them, batch first: a control loop at 1 kHz and a fleet of thousands must both be fast. Functions without a plural
take any leading shape. Results depend on the order of the operations, to the last bit.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np

Entry = TypeVar("Entry", float, np.ndarray)

GRAVITY = 9.81
"""Acceleration of gravity [m/s²], in every engine and wherever a weight is known."""

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
"""Orientation of an upright base that looks along x."""


def about(axis: int, angle: float | np.ndarray) -> np.ndarray:
    """Return the quaternions of rotations by angles, shape (...), about x, y or z (0, 1, 2); shape (..., 4)."""
    quaternion = np.zeros((*np.shape(angle), 4))
    quaternion[..., 0], quaternion[..., 1 + axis] = np.cos(angle / 2), np.sin(angle / 2)
    return quaternion


def about_vector(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the quaternion of a rotation by an angle about a unit vector of shape (3,); shape (4,)."""
    return np.concatenate(([np.cos(angle / 2)], np.sin(angle / 2) * axis))


def matrices_about(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return the matrices of rotations by N angles about a unit vector of shape (3,), shape (N, 3, 3); Rodrigues."""
    cross = cross_matrix(axis)
    return np.eye(3) + np.sin(angle)[:, None, None] * cross + (1 - np.cos(angle))[:, None, None] * (cross @ cross)


def matrix(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation matrix of a frame, shape (3, 3): its columns are the frame's axes in the world."""
    # Python's numbers, see `roll_pitch`.
    w, x, y, z = quaternion.tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def into_frame(quaternion: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return vectors of the world, shape (3,) or (..., 3), in one frame."""
    # A row times R is the transpose of R, the inverse turn, times a column: of one vector and of many.
    return vector @ matrix(quaternion)


def into_frames(quaternion: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return N vectors of the world, shape (N, 3), each in its frame, (N, 4)."""
    w, axis = quaternion[:, :1], quaternion[:, 1:]
    # The conjugate's turn without a matrix: v + 2 a × (a × v − w v), with a the vector part.
    return vector + 2.0 * crosses(axis, crosses(axis, vector) - w * vector)


def up_axis(w: Entry, x: Entry, y: Entry, z: Entry) -> tuple[Entry, Entry, Entry]:
    """Return the world's upward direction in a frame, from its quaternion's entries: numbers or arrays."""
    return 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


def up_in_frames(quaternion: np.ndarray) -> np.ndarray:
    """Return the world's upward direction in frames, shape (..., 4), as shape (..., 3)."""
    return np.stack(up_axis(*np.moveaxis(np.asarray(quaternion, dtype=np.float64), -1, 0)), axis=-1)


def uprightness(quaternion: np.ndarray) -> np.ndarray:
    """Return the cosine of the angle between a frame's z axis and the world's, shape (...)."""
    return 1.0 - 2.0 * (quaternion[..., 1] ** 2 + quaternion[..., 2] ** 2)


def roll_pitch(quaternion: np.ndarray) -> np.ndarray:
    """Return roll, atan2(2(wx + yz), 1 - 2(x² + y²)), and pitch, asin(2(wy - zx)), shape (..., 2)."""
    entries = np.asarray(quaternion, dtype=np.float64)
    # Python's numbers for one frame: the same to the last bit, and several times as fast as arrays without axes.
    w, x, y, z = entries.tolist() if entries.ndim == 1 else np.moveaxis(entries, -1, 0)
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    # Rounding may carry the sine beyond 1; np.clip is slower on a few numbers.
    pitch = np.arcsin(np.minimum(np.maximum(2.0 * (w * y - z * x), -1.0), 1.0))
    angles = np.empty((*entries.shape[:-1], 2))
    angles[..., 0], angles[..., 1] = roll, pitch
    return angles


def yaw(quaternion: np.ndarray) -> float:
    """Return the heading of a frame: the angle from the world's x axis to the frame's, seen from above."""
    forward = matrix(quaternion)[:, 0]
    return math.atan2(forward[1], forward[0])


def yaws(quaternion: np.ndarray) -> np.ndarray:
    """Return the headings of N frames, shape (N,)."""
    w, x, y, z = quaternion.T
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def tilted_once(quaternion: np.ndarray, a: float, b: float) -> np.ndarray:
    """Return one quaternion, shape (4,), times the small rotation 1 + a i + b j; equal to `tilted` to the bit."""
    w, x, y, z = quaternion.tolist()
    product = (w - x * a - y * b, w * a + x - z * b, w * b + y + z * a, z + x * b - y * a)
    # Summed in this order, as NumPy sums four numbers; `math.hypot` rounds otherwise.
    p, q, r, s = product
    return np.array(product) / math.sqrt(p * p + q * q + r * r + s * s)


def tilted(quaternion: np.ndarray, tilt: np.ndarray) -> np.ndarray:
    """Return N quaternions times the small rotations 1 + a i + b j, shape (N, 3): rolls of 2a, pitches of 2b."""
    w, x, y, z = quaternion.T
    unit, a, b = tilt.T
    product = np.stack(
        [w * unit - x * a - y * b, w * a + x * unit - z * b, w * b + y * unit + z * a, z * unit + x * b - y * a], -1
    )
    return product / np.linalg.norm(product, axis=-1, keepdims=True)


def angle_between(first: np.ndarray, second: np.ndarray) -> float:
    """Return the angle of the rotation from one orientation to another."""
    # Since ‖R1 − R2‖ = √8 |sin(θ/2)|, small angles keep their digits; the arc cosine of a scalar product near 1 loses
    # half of them.
    distance = float(np.linalg.norm(matrix(first) - matrix(second)))
    return 2.0 * math.asin(min(distance / 8**0.5, 1.0))


def small_turns(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the small rotations from N orientations to N more, angle times axis in the first frame, shape (N, 3)."""
    inverse = first * (1.0, -1.0, -1.0, -1.0)
    # The vector part of the product of both: half the angle along the axis.
    half = inverse[:, :1] * second[:, 1:] + second[:, :1] * inverse[:, 1:] + np.cross(inverse[:, 1:], second[:, 1:])
    return 2 * half


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross product of two vectors, shape (3,), as `np.cross`, which is slow on single vectors."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def crosses(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross products of N pairs of vectors, shape (N, 3): equal to `np.cross` to the bit, and faster."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx), -1)


def cross_matrix(vector: np.ndarray) -> np.ndarray:
    """Return the matrix, shape (3, 3), that maps u to the cross product vector x u."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def continuous(quaternion: np.ndarray) -> np.ndarray:
    """Return T quaternions in time, shape (T, 4), without jumps of sign, which interpolation would take for
    rotations.
    """
    # Neighbours as they came: a row is flipped where the number of changes of sign up to it is odd.
    turned = np.sum(quaternion[1:] * quaternion[:-1], axis=1) < 0
    return quaternion * np.concatenate([[1.0], np.where(np.cumsum(turned) % 2, -1.0, 1.0)])[:, None]


def quaternion_of(rotation: np.ndarray) -> tuple[float, float, float, float]:
    """Return the quaternion w, x, y, z of a rotation matrix, shape (3, 3); w is not negative.

    The largest of the four squares that follow from the diagonal is used (Shepperd), to avoid division by a small
    number.
    """
    m = rotation
    squares = np.array([1 + m[0, 0] + m[1, 1] + m[2, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2]])
    squares = np.append(squares, [1 - m[0, 0] + m[1, 1] - m[2, 2], 1 - m[0, 0] - m[1, 1] + m[2, 2]])
    products = np.array(
        [
            [squares[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], squares[1], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], squares[2], m[1, 2] + m[2, 1]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], squares[3]],
        ]
    )
    row = products[int(np.argmax(squares))]
    row = row / np.linalg.norm(row)
    w, x, y, z = (float(value) for value in (row if row[0] >= 0 else -row))
    return w, x, y, z


def product(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the quaternion of a rotation by `second` and then by `first`, shape (4,) each."""
    w, x, y, z = first
    a, b, c, d = second
    return np.array(
        [
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        ]
    )
