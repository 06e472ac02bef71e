"""Settings of the climbs. Neither torch nor mujoco: the command line reads it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from stiction.core.errors import ConfigurationError, check_once
from stiction.core.flags import FIXED
from stiction.joints.friction import MAX_LEVEL
from stiction.robots.terrain import STEEPEST
from stiction.task.config import NoiseCfg


@dataclass(frozen=True)
class ClimbCfg:
    """Settings of the climbs."""

    step_heights: tuple[float, ...] = (0.02, 0.04, 0.06, 0.08, 0.10, 0.12, 0.14)
    """Heights of a step [m]."""
    friction_levels: tuple[float, ...] = (0.0, 0.2)
    """Dry friction in every joint, as fractions of its torque limit [-]."""
    trials: int = 100
    """Trials per height and level."""
    speed: float = 0.4
    """Commanded speed [m/s]."""
    seed: int = 0
    """Seed of starts and sensor noise."""
    noise: Annotated[NoiseCfg, FIXED] = field(default_factory=NoiseCfg)
    """Sensor noise, as in training."""

    def __post_init__(self) -> None:
        """Refuse what nobody can climb."""
        if not self.step_heights or not all(0 < height <= STEEPEST["stairs"] for height in self.step_heights):
            raise ConfigurationError(
                f"step heights {self.step_heights}: expected at least one, in (0, {STEEPEST['stairs']}] m"
            )
        if not self.friction_levels or not all(0 <= level <= MAX_LEVEL for level in self.friction_levels):
            raise ConfigurationError(
                f"friction levels {self.friction_levels}: expected at least one, in [0, {MAX_LEVEL}]"
            )
        for name in ("step_heights", "friction_levels"):
            check_once(name.replace("_", " "), getattr(self, name))
        if self.trials < 1 or not 0.05 <= self.speed <= 2.0:
            raise ConfigurationError(
                f"{self.trials} trials at {self.speed} m/s: expected at least one, at 0.05 to 2 m/s"
            )
