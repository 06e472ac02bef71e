"""Velocity commands: their axes, units and names, and the parser of `vx=0.5`, `vx=0.3,wz=0.2`, `stand`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stiction.core.errors import ConfigurationError


class Axis(NamedTuple):
    """Entry of a velocity command, in the base's frame."""

    letters: str
    """Name as typed and in results: `vx=0.5`."""
    name: str
    unit: str


VELOCITY = (Axis("vx", "forward", "m/s"), Axis("vy", "sideways", "m/s"), Axis("wz", "turn", "rad/s"))
"""Axes in the order of every vector of a command."""

AXES = tuple(axis.letters for axis in VELOCITY)
"""Axes as typed: forward and sideways velocity [m/s], turn rate [rad/s]."""

COMMANDS = tuple(axis.name for axis in VELOCITY)

STAND = "stand"

FASTEST = 20.0
"""Maximum commanded speed [m/s, rad/s], beyond any legged robot's."""


@dataclass(frozen=True)
class Command:
    """Constant velocity command."""

    label: str
    """Label in results: `vx=0.5`."""
    velocity: tuple[float, float, float]
    """Forward, sideways [m/s], turn [rad/s]."""

    @property
    def is_linear(self) -> bool:
        """True if a horizontal velocity is commanded."""
        return any(self.velocity[:2])

    @property
    def is_turn(self) -> bool:
        """True if only a turn is commanded."""
        return not self.is_linear and self.velocity[2] != 0.0

    @property
    def direction(self) -> np.ndarray | None:
        """Unit vector over (vx, vy, wz) along which speed is measured, shape (3,); None for `stand`."""
        vector = np.array(self.velocity)
        vector[2] *= self.is_turn
        norm = np.linalg.norm(vector)
        return vector / norm if norm else None

    def axis_ratios(self, velocity: Sequence[float]) -> list[float]:
        """Return reached over commanded velocity of every commanded axis [-]; empty for `stand`.

        velocity: mean of vx, vy [m/s] and wz [rad/s], shape (3,).
        """
        return [reached / commanded for reached, commanded in zip(velocity, self.velocity, strict=True) if commanded]

    @property
    def speed(self) -> float:
        """Commanded speed along `direction` [m/s], or [rad/s] for a turn."""
        return float(np.hypot(*self.velocity[:2])) if self.is_linear else abs(self.velocity[2])


def parse_command(text: str) -> Command:
    """Return the command of a text; raise `StictionError` for an invalid axis or number."""
    if text.strip() == STAND:
        return Command(STAND, (0.0, 0.0, 0.0))
    values: dict[str, float] = {}
    for part in text.split(","):
        axis, _, number = part.strip().partition("=")
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        if axis not in AXES or axis in values or not math.isfinite(value):
            raise ConfigurationError(
                f"command {text!r} is not understood; expected such as vx=0.5 or vx=0.3,wz=0.2 or {STAND}"
            )
        if abs(value) > FASTEST:
            raise ConfigurationError(f"command {text!r}: expected at most {FASTEST:g} m/s or rad/s along each axis")
        values[axis] = value
    if not any(values.values()):
        return Command(STAND, (0.0, 0.0, 0.0))
    label = ",".join(f"{axis}={values[axis]:g}" for axis in AXES if values.get(axis))
    return Command(label, (values.get("vx", 0.0), values.get("vy", 0.0), values.get("wz", 0.0)))
