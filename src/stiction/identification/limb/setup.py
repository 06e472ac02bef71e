"""What is chosen and declared about a log in which all joints of a limb move."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from typing import Annotated

from stiction.core.effects import needs
from stiction.core.errors import ConfigurationError
from stiction.core.flags import SETTING
from stiction.files.joint_map import parse_joint_map
from stiction.identification.setup import PAYLOAD, PENDULUM, IdentifySetup

SINGLE = (*PAYLOAD, *PENDULUM, "hanging_angle", "gravity")
"""Fields of `IdentifySetup` that speak of one joint alone: with a robot's model, its links say all of that."""


@dataclass(frozen=True)
class LimbSetup:
    """Choices and declarations."""

    model_error: float = field(default=0.1, metadata=needs("--robot"))
    """Standard deviation of each link's errors in the model: of mass and inertia as shares, of the centre of mass as a
    share of the link's radius of gyration [1]. Estimates and intervals admit it. A drawing or a maker's file, with its
    cables, screws and gear boxes, is seldom better than a tenth."""
    timing_error: Annotated[float, SETTING] = field(default=0.5, metadata=needs("--robot"))
    """Standard deviation of how early or late all torques are in the log against the angles, over its step [1]: a
    controller that holds its torque between updates is half a step off."""
    up: tuple[float, float, float] | None = field(default=None, metadata=needs("--robot"))
    """Direction up in the base's frame; by default as the robot's file has it."""
    joint_map: tuple[str, ...] = field(default=(), metadata=needs("--robot"))
    """LOG=MODEL pairs for joints that are called otherwise in the log, such as joint_1=shoulder_pan."""

    def check_with(self, declared: IdentifySetup) -> None:
        """Raise `ConfigurationError` for what has no meaning, and for declarations of a single joint's log."""
        for name in ("model_error", "timing_error"):
            value = getattr(self, name)
            if not (isfinite(value) and 0 < value <= 1):
                raise ConfigurationError(f"{name.replace('_', ' ')} {value}: expected more than 0 and at most 1")
        parse_joint_map(self.joint_map)
        given = [name for name in SINGLE if getattr(declared, name) is not None] + list(declared.unknowns)
        if given:
            raise ConfigurationError(
                f"{given[0].replace('_', ' ')} is for a single joint; with --robot the model says what the links "
                "weigh and carry: leave it out, or put the load into the model"
            )
        if declared.axis == "linear" or declared.test_condition == "bare_motor":
            what = "a linear axis" if declared.axis == "linear" else "a bare motor"
            raise ConfigurationError(f"{what} is no part of a limb: identify it without --robot")
