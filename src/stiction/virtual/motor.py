"""From commanded to delivered motor torque: gains, limit, speed, voltage, torque constant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LOWEST_VOLTAGE = 0.5
"""Lowest battery voltage over its nominal one [1]; the sag ends there."""

SMOOTHING = 0.01
"""Time constant of the capacitors between battery and motors [s]."""

LOSS_AT_LIMIT = 800.0
"""Electrical power that a motor turns into heat at its torque limit [W]; it grows with the torque's square."""


@dataclass(frozen=True)
class Motors:
    """J motors and their battery. Arrays have shape (J,)."""

    armature: np.ndarray
    """Rotor inertia over the nominal one [1]."""
    damping: np.ndarray
    """Viscous friction over the nominal one [1]."""
    strength: np.ndarray
    """Delivered over commanded torque, k: the true torque constant over the data sheet's, with which motors report [1].
    """
    no_load_speed: np.ndarray
    """Speed at which no torque is left, at the battery's nominal voltage [rad/s]."""
    knee: float
    """Share of that speed up to which all of the torque is available [1]."""
    charge: float
    """Voltage of the battery without load over its nominal one, constant over a run [1]."""
    resistance: float
    """Drop of that ratio per watt drawn [1/W]."""

    @classmethod
    def perfect(cls, num_joints: int) -> Motors:
        """Return motors as in training: limited in torque alone."""
        one = np.ones(num_joints)
        return cls(one, one, one, np.full(num_joints, np.inf), 0.5, 1.0, 0.0)


def commanded_torque(
    kp: np.ndarray, kd: np.ndarray, target: np.ndarray, forward: np.ndarray, angle: np.ndarray, velocity: np.ndarray
) -> np.ndarray:
    """Return τ = τ_ff + kp (a − θ) − kd θ' [N m], of measured angle and velocity; shape (J,)."""
    return forward + kp * (target - angle) - kd * velocity


def within_limits(
    torque: np.ndarray, speed: np.ndarray, limit: np.ndarray, no_load_speed: np.ndarray, knee: float
) -> np.ndarray:
    """Return the torque that a motor reaches at a speed [N m], shape (J,).

    Driving, the largest torque is the limit up to `knee` of the no-load speed, and falls linearly to zero from there;
    braking, it is the limit. torque: commanded [N m]; speed: φ' [rad/s]; no_load_speed: at the present voltage [rad/s].
    """
    # In units of what is left above the knee: 1 at the knee, 0 at the no-load speed.
    share = np.minimum(np.maximum((1.0 - np.abs(speed) / no_load_speed) / (1.0 - knee), 0.0), 1.0)
    most = np.where(torque * speed > 0, share, 1.0) * limit
    return np.minimum(np.maximum(torque, -most), most)


def drawn_power(torque: np.ndarray, speed: np.ndarray, limit: np.ndarray) -> float:
    """Return the power drawn from the battery [W]: work and heat of all motors, at least zero."""
    heat = LOSS_AT_LIMIT * np.square(torque / limit)
    return max(0.0, float((torque * speed + heat).sum()))


class Drive:
    """The motors of one robot on one battery."""

    def __init__(self, motors: Motors, limit: np.ndarray, timestep: float) -> None:
        """limit: torque limits by the data sheet [N m], shape (J,); timestep: of the physics [s]."""
        self._motors, self._limit, self._timestep = motors, limit, timestep
        self.reset()

    def reset(self) -> None:
        """Begin with an unloaded battery."""
        self.voltage = self._motors.charge
        """Of the battery, over its nominal one [1]."""

    def torque(self, commanded: np.ndarray, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return delivered and reported torques of one step [N m], shape (J,); the battery sags accordingly.

        commanded: by the controller [N m]; speed: φ', of the rotors [rad/s].
        """
        motors = self._motors
        reported = within_limits(commanded, speed, self._limit, motors.no_load_speed * self.voltage, motors.knee)
        given = motors.strength * reported
        sagged = motors.charge - motors.resistance * drawn_power(given, speed, self._limit)
        # No more than the whole way, for steps longer than the time constant.
        self.voltage += min(1.0, self._timestep / SMOOTHING) * (max(sagged, LOWEST_VOLTAGE) - self.voltage)
        return given, reported
