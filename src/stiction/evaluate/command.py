"""The velocity command of a whole episode: forward, sideways, turn, or stand. No simulator."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.formats.velocity import AXES

if TYPE_CHECKING:
    from stiction.formats.contract import Contract

STAND = "stand"
"""The command to stand still."""

FASTEST = 20.0
"""Largest speed that may be commanded [m/s, rad/s], beyond any legged robot's."""

SETTLE = 2.0
"""What is not measured at the start of a walk [s]: the robot gets up to speed."""


@dataclass(frozen=True)
class Command:
    """A constant velocity command."""

    label: str
    """As it stands in results: `vx=0.5`."""
    velocity: tuple[float, float, float]
    """Forward, sideways [m/s], turn [rad/s]."""

    @property
    def is_linear(self) -> bool:
        """Whether a horizontal velocity is commanded."""
        return any(self.velocity[:2])

    @property
    def is_turn(self) -> bool:
        """Whether a turn and nothing else is commanded."""
        return not self.is_linear and self.velocity[2] != 0.0

    @property
    def direction(self) -> np.ndarray | None:
        """Unit vector over (vx, vy, wz) along which speed is measured, shape (3,); None for `stand`."""
        vector = np.array(self.velocity)
        vector[2] *= self.is_turn
        norm = np.linalg.norm(vector)
        return vector / norm if norm else None

    @property
    def speed(self) -> float:
        """Commanded speed along `direction` [m/s], or [rad/s] for a turn."""
        return float(np.hypot(*self.velocity[:2])) if self.is_linear else abs(self.velocity[2])


def parse_command(text: str) -> Command:
    """Return the command that `text` names; raise `StictionError` for an axis or a number that is none."""
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


def untrained(commands: Iterable[Command], contract: Contract) -> str:
    """Return which of the commands a policy was not trained for, and what it was; nothing where it was for all."""
    # Not above: who only reads commands, such as a study's options, loads no runtime.
    from stiction.deploy.plausibility import command_range

    low, high = command_range(contract)
    beyond = [one.label for one in commands if not ((low <= one.velocity) & (one.velocity <= high)).all()]
    spans = ", ".join(f"{axis} {a:g} to {b:g}" for axis, a, b in zip(AXES, low, high, strict=True))
    return f"command {', '.join(beyond)}: the policy was trained for {spans}" if beyond else ""
