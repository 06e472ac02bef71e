"""Address of a robot: `virtual`, `unitree-go:eth0`, `unitree-hg:eth0`, `ros2:/NAMESPACE`.

No transport is loaded here: `--help` must be quick.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.core.flags import FLAG

WANTS = {
    "virtual": "",
    "unitree-go": "the network interface with the robot's cable, such as unitree-go:eth0",
    "unitree-hg": "the network interface with the robot's cable, such as unitree-hg:eth0",
    "ros2": "the namespace of the robot's topics, such as ros2:/dog, or ros2:/ where they have none",
}
"""Transport -> place that has to be named with it; empty: none."""


@dataclass(frozen=True)
class Address:
    """Transport, and the robot's place on it."""

    transport: str
    place: str
    """Network interface or namespace; empty for the virtual robot."""


def parse_address(text: str) -> Address:
    """Return the address in a text.

    Raises `ConfigurationError` for an unknown transport, and for a missing place: the robot's network is never
    guessed.
    """
    transport, _, place = text.partition(":")
    if transport not in WANTS:
        raise ConfigurationError(unknown_name("robot transport", transport, WANTS))
    wanted = WANTS[transport]
    if wanted and not place:
        raise ConfigurationError(f"robot: got {text!r} without a place, expected {wanted}")
    if place and not wanted:
        raise ConfigurationError(f"robot {text!r}: {transport} is on this machine; expected {transport}")
    return Address(transport, place)


@dataclass(frozen=True)
class HeldCfg:
    """Gains for joints of the robot that the policy does not move."""

    kp: Annotated[float | None, FLAG] = None
    """Proportional gain [N m/rad]; needed where there are such joints."""
    kd: Annotated[float | None, FLAG] = None
    """Derivative gain [N m s/rad]; needed where there are such joints; it damps them after a stop."""

    def __post_init__(self) -> None:
        for value in (self.kp, self.kd):
            if value is not None and not 0 <= value <= 1000:
                raise ConfigurationError(f"a gain of {value} for held joints: expected 0 to 1000")
