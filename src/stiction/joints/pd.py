"""Joint controller: τ = k_motor (kp (a − θ) − kd θ'), within the torque limit of the motor.

The paper prints the position term with the opposite sign, (θ − a), with which the joint would run away.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from stiction.core.errors import ConfigurationError

TorqueSource = Literal["motor_side", "output_side"]
TORQUE_SOURCES: tuple[TorqueSource, ...] = get_args(TorqueSource)
"""Place of a torque measurement: by current or command, or behind the gear and the joint's friction."""


@dataclass(frozen=True)
class PDGains:
    """Gains of one joint's controller. For a linear axis read N for N m and m for rad."""

    kp: float
    """Proportional gain [N m/rad]."""
    kd: float
    """Derivative gain [N m s/rad]."""
    torque_limit: float = float("inf")
    """Torque limit of the motor, in either direction [N m]."""
    strength: float = 1.0
    """Motor strength, k_motor: delivered over requested torque [1]."""

    def __post_init__(self) -> None:
        # NaN passes every comparison below, so it is asked for by itself.
        values = (self.kp, self.kd, self.torque_limit, self.strength)
        if any(np.isnan(values)) or self.kp <= 0 or self.kd < 0 or self.torque_limit <= 0 or self.strength <= 0:
            raise ConfigurationError(
                f"gains kp {self.kp}, kd {self.kd}, torque limit {self.torque_limit}, strength {self.strength}: "
                "kp, torque limit and strength must be positive and kd must not be negative"
            )


COMPENSATION_WIDTH = 0.05
"""Distance to the target above which the full friction is compensated [rad]; in proportion below, against chatter."""


def fed_forward(target: Any, position: Any, friction: Any, width: float = COMPENSATION_WIDTH) -> Any:
    """Return the torque added against friction, f sat((a − θ)/width) [N m]; shapes broadcast.

    target: a [rad]; position: θ as measured [rad]; friction: f [N m].
    """
    return friction * np.clip((target - position) / width, -1.0, 1.0)


def pd_torque(gains: PDGains, target: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return the delivered torque [N m], any shape.

    target: a [rad]; position: θ [rad]; velocity: θ' [rad/s]; shapes broadcast.
    """
    # The limit is of what the motor delivers, so the strength comes before it.
    torque = gains.strength * (gains.kp * (target - position) - gains.kd * velocity)
    return np.clip(torque, -gains.torque_limit, gains.torque_limit)


def controller_torque(
    target: np.ndarray, position: np.ndarray, velocity: np.ndarray, kp: np.ndarray, kd: np.ndarray, limit: np.ndarray
) -> np.ndarray:
    """Return the torques that the controllers of J joints request, nominal and within limits [N m], shape (T, J).

    target, position, velocity: shape (T, J), units as of `pd_torque`; kp, kd, limit: of each joint, shape (J,).
    """
    return np.clip(kp * (target - position) - kd * velocity, -limit, limit)
