"""The weight of the link behind a joint, as the torque that the motor must supply to hold it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.formats.errors import StictionError


@dataclass(frozen=True)
class Gravity:
    """A link that turns about an axis fixed in space: sin · sin θ + cos · cos θ."""

    sin: float
    """Torque that holds the link at θ = π/2 [N m]; positive for a pendulum that hangs at θ = 0."""
    cos: float = 0.0
    """Torque that holds the link at θ = 0 [N m]."""

    def __post_init__(self) -> None:
        """Refuse a weight that is not finite."""
        if not np.isfinite([self.sin, self.cos]).all():
            raise StictionError(f"gravity {self.sin} sin + {self.cos} cos: expected finite numbers")

    def torque(self, angle: np.ndarray) -> np.ndarray:
        """Return the torque that holds the link at `angle` [rad], any shape [N m]."""
        return self.sin * np.sin(angle) + self.cos * np.cos(angle)

    def slope(self, angle: np.ndarray) -> np.ndarray:
        """Return the derivative of `torque` with respect to the angle, any shape [N m/rad]."""
        return self.sin * np.cos(angle) - self.cos * np.sin(angle)
