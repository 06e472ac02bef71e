"""When a robot has fallen, as fleet, referee of a virtual robot and controller in Webots judge it. NumPy."""

from __future__ import annotations

import numpy as np

TILT = 0.5
"""A robot has fallen where the base's up axis is more than 60° off vertical: its z component is under this."""

HEIGHT = 0.45
"""... or where the base is lower than this fraction of its standing height."""


def base_up(quaternion: np.ndarray) -> np.ndarray:
    """Return the z component of the base's up axis in the world, shape (...). `quaternion`: w, x, y, z, (..., 4)."""
    return 1.0 - 2.0 * (quaternion[..., 1] ** 2 + quaternion[..., 2] ** 2)


def tilted(quaternion: np.ndarray) -> np.ndarray:
    """Return whether each base leans too far, bool, shape (...). `quaternion`: w, x, y, z, (..., 4)."""
    return base_up(quaternion) < TILT


def too_low(height: np.ndarray, standing_height: float) -> np.ndarray:
    """Return whether each base is too near the ground under it, bool, shape (...). Heights above that ground [m]."""
    return height < HEIGHT * standing_height
