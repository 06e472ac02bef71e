"""Settings of the walks in every physics. Neither torch nor mujoco: the command line reads it."""

from __future__ import annotations

from dataclasses import dataclass

from stiction.core.errors import ConfigurationError
from stiction.evaluation.course import SETTLE
from stiction.joints.friction import MAX_LEVEL


@dataclass(frozen=True)
class WalkCfg:
    """Settings of the walks."""

    friction_levels: tuple[float, ...] = (0.0, 0.05, 0.1, 0.15, 0.2)
    """Dry friction in every joint, as fractions of its torque limit [-]."""
    speed: float = 0.5
    """Commanded speed, forward and backward [m/s]."""
    episodes: int = 16
    """Walks per level and direction."""
    seconds: float = 8.0
    """Length of a walk [s]; its first 2 s are not measured."""
    seed: int = 0
    """Seed of initial states and sensor noise."""

    def __post_init__(self) -> None:
        """Refuse what cannot be walked."""
        if not self.friction_levels or not all(0 <= level <= MAX_LEVEL for level in self.friction_levels):
            raise ConfigurationError(
                f"friction levels {self.friction_levels}: expected at least one, in [0, {MAX_LEVEL}]"
            )
        if self.episodes < 2 or not self.seconds >= SETTLE + 1.0 or not 0.05 <= self.speed <= 2.0:
            raise ConfigurationError(
                f"{self.episodes} walks of {self.seconds} s at {self.speed} m/s: expected at least 2, of at least "
                f"{SETTLE + 1.0:g} s, at 0.05 to 2 m/s"
            )
