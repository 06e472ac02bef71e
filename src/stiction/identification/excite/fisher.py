"""Fisher information of the closed loop's outputs: what a log will tell about a joint before it is made.

For white noise of known size the information about the parameters p is

    F = Σ_t (∂θ/∂p)(∂θ/∂p)ᵀ / σ_θ² + Σ_t (∂τ/∂p)(∂τ/∂p)ᵀ / σ_τ²

and no unbiased estimator has a covariance below F⁻¹ (Cramér and Rao). The derivatives are central differences of the
event-exact simulation, in which gains and target are known exactly. Noise that the controller feeds back into the
joint, jitter and friction that is not Coulomb's come on top: they are not predicted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.core.linear import invert
from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Gravity, Joint, Trajectory, simulate

NAMES: tuple[str, ...] = ("inertia", "viscous_friction", "coulomb_friction", "offset", "gravity_sin", "gravity_cos")
"""Parameters, in the order of every array here; gravity only where it pulls."""

COMBINATIONS = ("inertia/k", "(viscous_friction+k*kd)/k", *(f"{name}/k" for name in NAMES[2:]))
"""Combinations that positions alone tell, k being the unknown motor strength: the motion stays the same when all
torques and k are multiplied by one number, and kd brakes like viscous friction."""

JUDGED = 3
"""Number of the parameters, from the first, that judge an excitation: inertia, viscous and Coulomb friction. The
offset is zero for a good drive, so its relative deviation means nothing."""

DIFFERENCE = 1e-3
"""Step of the differences in units of each parameter's scale: what it neglects is of the order of its square."""


@dataclass(frozen=True)
class Information:
    """Fisher information of a log about P parameters."""

    names: tuple[str, ...]
    """Names of the parameters, or of their identifiable combinations."""
    values: np.ndarray
    """Values of the parameters, shape (P,)."""
    covariance: np.ndarray
    """Cramér–Rao bound F⁻¹, shape (P, P); infinite where the log tells nothing."""

    @property
    def std(self) -> np.ndarray:
        """Smallest standard deviation of each parameter, shape (P,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def relative(self) -> np.ndarray:
        """Standard deviations over values of inertia, viscous and Coulomb friction, shape (3,)."""
        return self.std[:JUDGED] / np.abs(self.values[:JUDGED])

    @property
    def worst(self) -> float:
        """Largest relative standard deviation among inertia, viscous and Coulomb friction: the design's criterion."""
        return float(self.relative.max())

    @property
    def d_criterion(self) -> float:
        """Log det of the bound, for the relative deviations of the judged three; smaller is better."""
        judged = self.covariance[:JUDGED, :JUDGED] / np.outer(self.values[:JUDGED], self.values[:JUDGED])
        return float(np.linalg.slogdet(judged)[1]) if np.isfinite(self.covariance).all() else float("inf")

    def correlation(self, first: int, second: int) -> float:
        """Return the correlation of two estimates; ±1 means that the log cannot tell them apart."""
        return float(self.covariance[first, second] / (self.std[first] * self.std[second]))


def run(
    values: np.ndarray, gains: PDGains, step: float, target: np.ndarray, near: Trajectory | None = None
) -> Trajectory:
    """Simulate a joint from rest at the first target; near: a run of a similar joint.

    values: inertia, viscous friction, Coulomb friction, offset and, where it weighs, the two of gravity. Against
    gravity the joint starts where the controller holds it, `near` the pose of the first target.
    """
    inertia, viscous, coulomb, offset, *weight = values.tolist()
    gravity = Gravity(*weight) if weight else None
    joint, start = Joint(inertia, viscous, Coulomb(coulomb), offset, gravity), float(target[0])
    if gravity is not None and near is not None:
        return simulate(joint, gains, step, target, float(near.position[0]), guess=near.position)
    if gravity is not None:
        start -= float(gravity.torque(target[0])) / gains.kp
    return simulate(joint, gains, step, target, start)


def sensitivities(
    values: np.ndarray, gains: PDGains, step: float, target: np.ndarray, fast: bool = False
) -> np.ndarray:
    """Return ∂θ/∂p and ∂τ/∂p at every sample, shape (P, 2, num_samples).

    values: see `run`; target: a [rad], shape (num_samples,); fast: one-sided differences, for half of the work.
    """
    base = run(values, gains, step, target)
    # B and the offset may be zero, and no scale; kd brakes as B does, and the offset is a torque like the friction.
    scales = np.array([values[0], values[1] + gains.kd, *[values[2]] * (len(values) - 2)])
    slopes = np.empty((len(values), 2, len(target)))
    for index, change in enumerate(np.diag(DIFFERENCE * scales)):
        up = run(values + change, gains, step, target, base)
        down = base if fast else run(values - change, gains, step, target, base)
        width = (1 if fast else 2) * change[index]
        slopes[index] = (up.position - down.position) / width, (up.torque - down.torque) / width
    return slopes


def information(
    values: np.ndarray,
    gains: PDGains,
    step: float,
    target: np.ndarray,
    noise: tuple[float, float | None],
    fast: bool = False,
) -> Information:
    """Return what a log of `target` tells about the parameters; arguments as in `sensitivities`.

    noise: standard deviations of the logged angle [rad] and torque [N m]. Where that is None, for no torque is logged,
    it is about the combinations that positions show, with the motor strength 1.
    """
    slopes, (position, torque) = sensitivities(values, gains, step, target, fast), noise
    matrix = slopes[:, 0] @ slopes[:, 0].T / position**2
    shown, names = np.array(values, float), NAMES
    if torque is None:
        shown[1] += gains.kd
        names = COMBINATIONS
    else:
        matrix += slopes[:, 1] @ slopes[:, 1].T / torque**2
    covariance, told = invert(matrix)
    return Information(names[: len(values)], shown, covariance if told.all() else np.diag(np.full(len(values), np.inf)))
