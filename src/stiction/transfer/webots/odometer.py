"""What a walk in Webots came to, from the robot's GPS: speed along the command, in the robot's own frame."""

from __future__ import annotations

import numpy as np

from stiction.deploy.observation import Sensors
from stiction.transfer.command import SETTLE, Command
from stiction.transfer.engines.rotation import yaw


class Odometer:
    """Velocity reached, over control periods: of the place in the heading's frame, and the yaw rate."""

    def __init__(self, period: float) -> None:
        """`period`: between two calls of `add` [s]."""
        self._period = period
        self._velocity: list[tuple[float, float, float]] = []
        self._last: np.ndarray | None = None

    def add(self, place: np.ndarray, sensors: Sensors) -> None:
        """Note where the robot is, (3,) [m]."""
        if self._last is not None:
            along, across = (place - self._last)[:2] / self._period
            facing = yaw(sensors.quaternion)
            cosine, sine = np.cos(facing), np.sin(facing)
            turn = float(sensors.angular_velocity[2])
            self._velocity.append((cosine * along + sine * across, cosine * across - sine * along, turn))
        self._last = place

    def speed(self, command: Command) -> float | None:
        """Return the mean speed along the command [m/s], or [rad/s]; None where none is commanded or measured."""
        first = round(SETTLE / self._period)
        if command.direction is None or len(self._velocity) <= first:
            return None
        return float((np.array(self._velocity[first:]) @ command.direction).mean())
