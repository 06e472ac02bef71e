"""What an Actuator Net must beat: the PD law with the gains of the log, less Coulomb and viscous friction.

τ = clip(kp (a - θ) - kd θ', ±τ_max) - λ kd Δθ' - f sat(θ'/w) - B θ', with f, B and λ of each joint by least squares. A
torque logged on the motor's side has no friction in it, and finds f and B near zero.

Δθ' is the change of the velocity over the period that follows, and λ the share of the period after which kd θ' acts: a
logged torque is a mean over that period. λ is 0 for a controller that holds its torque, one half for one that runs much
faster than the log, and 1 in MuJoCo, which takes kd implicitly. Without the term a law that a simulator follows to the
last digit errs by 2 to 3 % of the limit on the simulator's own walks, and a net that has learned to foresee Δθ' would
look better than the truth.
"""

from __future__ import annotations

from collections.abc import Sequence
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
    later: np.ndarray
    """λ, fitted, share of a period by which kd θ' acts later than the sample, in [0, 1] [-]."""

    def torque(self, target: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Return the torque [N m] of one run, shape (T, J); arguments [rad, rad/s], (T, J).

        The change of the velocity after the last sample is not known, and taken as none.
        """
        motor, change = self._at_the_sample(target, position, velocity)
        return motor + self.later * change - self.coulomb * ramp(velocity) - self.viscous * velocity

    def _at_the_sample(
        self, target: np.ndarray, position: np.ndarray, velocity: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the PD law of the sample, and -kd Δθ' where that law is within its limit, (T, J) each [N m]."""
        asked = self.kp * (target - position) - self.kd * velocity
        ahead = np.diff(velocity, axis=0, append=velocity[-1:])
        free = np.abs(asked) < self.torque_limit
        return np.clip(asked, -self.torque_limit, self.torque_limit), -self.kd * ahead * free


def ramp(velocity: np.ndarray) -> np.ndarray:
    """Return the direction of motion, sat(θ'/w), in [-1, 1], any shape."""
    return np.clip(velocity / WIDTH, -1.0, 1.0)


def fit_baseline(
    gains: tuple[np.ndarray, np.ndarray, np.ndarray],
    runs: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]],
) -> Baseline:
    """Fit f, B and λ of each joint to the training runs: target, position, velocity, torque of each, (T, J).

    gains: kp, kd and torque limit, each (J,). A joint that never moved has neither friction, one without kd no λ.
    """
    none = np.zeros_like(gains[0])
    plain = Baseline(*gains, none, none, none)
    lost, columns = [], []
    for target, position, velocity, torque in runs:
        motor, change = plain._at_the_sample(target, position, velocity)
        lost.append(motor - torque)
        columns.append(np.stack([ramp(velocity), velocity, -change], axis=-1))
    missing, known = np.concatenate(lost), np.concatenate(columns)
    return Baseline(*gains, *np.array([_fit_joint(known[:, j], missing[:, j]) for j in range(missing.shape[1])]).T)


def _fit_joint(columns: np.ndarray, lost: np.ndarray) -> np.ndarray:
    """Return f, B and λ by least squares with λ in [0, 1]; columns: of f, B and λ, (T, 3), lost: (T,) [N m]."""
    free = np.linalg.lstsq(columns, lost, rcond=None)[0]
    later = float(np.clip(free[2], 0.0, 1.0))
    if later == free[2]:
        return free
    # The squares are convex, so that with one bound the least of them is on it.
    rest = np.linalg.lstsq(columns[:, :2], lost - later * columns[:, 2], rcond=None)[0]
    return np.append(rest, later)
