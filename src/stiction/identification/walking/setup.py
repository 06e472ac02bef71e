"""Choices and declarations about a walking log."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite
from typing import Literal

from stiction.core.errors import ConfigurationError, unknown_name

CONTACTS = ("auto", "logged", "torque", "height")
"""Sources of foot contact."""


@dataclass(frozen=True)
class RobotLogSetup:
    """Declarations about a log that is not in our own form."""

    joint_map: tuple[str, ...] = ()
    """RECORDED=JOINT pairs where the log's names of joints are not the robot's."""
    imu_position: tuple[float, float, float] | None = None
    """Position of the IMU in the base's frame [m]: its accelerometer feels the base's turns there."""

    def __post_init__(self) -> None:
        """Reject an impossible position."""
        if not all(map(isfinite, self.imu_position or ())) or max(map(abs, self.imu_position or (0,))) > 10:
            raise ConfigurationError(f"IMU position {self.imu_position}: expected three numbers in metres")


@dataclass(frozen=True)
class WalkSetup:
    """Choices and declarations."""

    mass_known: bool = False
    """Masses of the robot, payload included, are known, as the user declares: without, nothing is stated about load."""
    payload: float = 0.0
    """Mass that the trunk carries beyond its own [kg], spread over the trunk."""
    centre_of_mass: tuple[float, float, float] | None = None
    """Centre of mass of the trunk with what it carries, in the base frame [m]; by default the bare trunk's."""
    mass_error: float = 0.02
    """95 % bound of the relative error of the whole robot's mass [1], if it is declared known: a scale's and a
    payload's errors."""
    centre_error: float = 0.01
    """95 % bound of the error of the trunk's centre of mass along each axis [m]: what balancing on an edge finds."""
    link_mass_error: float = 0.05
    """95 % bound of the relative error of the links' masses [1]. Its effect on an estimate widens the interval;
    data sheets and drawings are seldom better."""
    torque_zero_error: float = 0.01
    """95 % bound of the motor's torque at no current over its limit [1]: zero of the current sensor, and gravity turned
    by a wrong encoder zero. It matters to joints that move one way only in swing."""
    timing_error: float = 1.0
    """95 % bound of how early or late the torque is in the log, against the angle, over the log's period [1]."""
    strength_error: float = 0.2
    """95 % bound of what a motor gives over what it is asked for, less 1, where no torque was logged [1]: the range in
    which training varies it."""
    specific_force_error: float = 0.1
    """95 % bound of the constant error of the specific force along each axis [m/s²]: accelerometer bias, tilt of its
    mounting."""
    neglected_acceleration: float = 2.5
    """95 % bound of the neglected acceleration where gravity stands in for the specific force, for want of an
    accelerometer [m/s²]: as much as the base
    of a walking robot accelerates, in step with its legs. The feet on the ground do not help: the base's acceleration
    from their joints and the gyroscope is no better than none."""
    smoothing: float = 0.04
    """Length of the smoothing window [s], a Hann window: at 200 Hz it leaves a twentieth of the encoder's noise in the
    acceleration, and a swing of 0.15 s still has rows clear of its ends."""
    swing_margin: float = 0.015
    """Time left out after lift-off and before touch-down [s]: feet unload and load over some milliseconds."""
    stop_margin: float = 0.015
    """Time left out around samples at which a joint hardly moves [s]: friction may take any value there, and in
    simulators it fades within a few steps of a stop."""
    slow: float = 0.1
    """Speed below which a joint hardly moves [rad/s]: over ten times the noise of a differentiated 15-bit encoder."""
    limit_margin: float = 0.03
    """Angle left out next to the joint's limits [rad], where the stop pushes back."""
    clearance: float = 0.015
    """Height of a foot above the lowest one from which it is in swing, where the log has no contacts [m]. It takes
    ground that is nearly flat."""

    contact: Literal["auto", "logged", "torque", "height"] = "auto"
    """Source of foot contact: as logged (contact or force), by the motors' torque, which needs no flat ground, or by
    height, as of `clearance`; auto: as logged where it was, else by height."""

    def __post_init__(self) -> None:
        """Reject invalid values."""
        if self.contact not in CONTACTS:
            raise ConfigurationError(unknown_name("contact", self.contact, CONTACTS))
        for item in fields(WalkSetup):
            value = getattr(self, item.name)
            if item.name in ("mass_known", "payload", "centre_of_mass", "contact"):
                continue
            if not (isfinite(value) and value >= 0):
                raise ConfigurationError(f"{item.name} {value}: expected a number that is not negative")
        if not (isfinite(self.payload) and all(map(isfinite, self.centre_of_mass or ()))):
            raise ConfigurationError("payload and centre of mass: expected finite numbers")
