"""What an Actuator Net must beat: the PD law with the gains of the log, less Coulomb and viscous friction.

τ = clip(kp (a - θ) - kd θ', ±τ_max) - f sat(θ'/w) - B θ', with f and B of each joint by least squares. A torque logged
on the motor's side has no friction in it, and finds f and B near zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

WIDTH = 0.05
"""Speed at which the friction of the baseline is whole [rad/s]. At rest friction takes any value up to f, which no law
of the speed alone can tell; a ramp is the least wrong."""


@dataclass(frozen=True)
class Baseline:
    """The analytic law of every joint, arrays of shape (J,)."""

    kp: np.ndarray
    """Proportional gains [N m/rad]."""
    kd: np.ndarray
    """Derivative gains [N m s/rad]."""
    torque_limit: np.ndarray
    """Largest torques [N m]."""
    coulomb: np.ndarray
    """f, fitted [N m]."""
    viscous: np.ndarray
    """B, fitted [N m s/rad]."""

    def torque(self, target: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Return the torque [N m], shape (T, J); arguments [rad, rad/s], (T, J)."""
        motor = self.kp * (target - position) - self.kd * velocity
        friction = self.coulomb * ramp(velocity) + self.viscous * velocity
        return np.clip(motor, -self.torque_limit, self.torque_limit) - friction


def ramp(velocity: np.ndarray) -> np.ndarray:
    """Return the direction of motion, sat(θ'/w), in [-1, 1], any shape."""
    return np.clip(velocity / WIDTH, -1.0, 1.0)


def fit_baseline(
    gains: tuple[np.ndarray, np.ndarray, np.ndarray],
    target: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    torque: np.ndarray,
) -> Baseline:
    """Fit f and B of each joint to the training runs, one after the other, signals of shape (T, J).

    gains: kp, kd and torque limit, each (J,). A joint that never moved has neither friction.
    """
    plain = Baseline(*gains, np.zeros_like(gains[0]), np.zeros_like(gains[0]))
    lost = plain.torque(target, position, velocity) - torque
    found = []
    for joint in range(lost.shape[1]):
        columns = np.stack([ramp(velocity[:, joint]), velocity[:, joint]], axis=-1)
        found.append(np.linalg.lstsq(columns, lost[:, joint], rcond=None)[0])
    coulomb, viscous = np.array(found).T
    return Baseline(*gains, coulomb, viscous)
