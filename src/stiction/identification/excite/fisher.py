"""What a log will tell about a joint before it is made: Fisher information of the closed loop's outputs.

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

NAMES = ("inertia", "viscous_friction", "coulomb_friction", "offset", "gravity_sin", "gravity_cos")
"""Parameters, in the order of every array here; gravity only where it pulls."""

COMBINATIONS = (
    *("inertia/k", "(viscous_friction+k*kd)/k", "coulomb_friction/k"),
    *("offset/k", "gravity_sin/k", "gravity_cos/k"),
)
"""What positions alone tell, k being the unknown motor strength: the motion stays the same when all torques and
k are multiplied by one number, and kd brakes like viscous friction."""

JUDGED = 3
"""How many of the parameters, from the first, an excitation is judged by: inertia, viscous and Coulomb friction. The
offset is zero for a good drive, so its relative deviation means nothing."""

DIFFERENCE = 1e-3
"""Step of the differences in units of each parameter's scale: what it neglects is of the order of its square."""


@dataclass(frozen=True)
class LogNoise:
    """White noise of what will be logged."""

    position: float = 1e-4
    """Standard deviation of the angle [rad]."""
    torque: float | None = 0.05
    """Standard deviation of the torque [N m]; None where no torque is logged."""
    resolution: float = 0.0
    """Step of the encoder, r [rad]; rounding to it adds r²/12 to the variance."""

    @property
    def position_std(self) -> float:
        """Standard deviation of the logged angle, rounding included [rad]."""
        return float(np.hypot(self.position, self.resolution / 12**0.5))


@dataclass(frozen=True)
class Information:
    """Fisher information of a log about the parameters."""

    names: tuple[str, ...]
    """Names of the parameters, or of their identifiable combinations."""
    values: np.ndarray
    """Their values, shape (num_parameters,)."""
    covariance: np.ndarray
    """The Cramér–Rao bound F⁻¹, shape (num_parameters, num_parameters); infinite where the log tells nothing."""

    @property
    def std(self) -> np.ndarray:
        """Smallest standard deviation of each parameter, shape (num_parameters,)."""
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
        """The bound's log det, for the relative deviations of the judged three; smaller is better."""
        scale = np.outer(self.values[:JUDGED], self.values[:JUDGED])
        if not np.isfinite(self.covariance).all():
            return float("inf")
        return float(np.linalg.slogdet(self.covariance[:JUDGED, :JUDGED] / scale)[1])

    def correlation(self, one: int, other: int) -> float:
        """Return the correlation of two estimates; ±1 means that the log cannot tell them apart."""
        return float(self.covariance[one, other] / (self.std[one] * self.std[other]))


def joint_of(values: np.ndarray) -> Joint:
    """Return the joint of inertia, viscous friction, Coulomb friction, offset and, where given, the two of gravity."""
    inertia, viscous, coulomb, offset, *gravity = (float(value) for value in values)
    return Joint(inertia, viscous, Coulomb(coulomb), offset, Gravity(*gravity) if gravity else None)


def run(
    values: np.ndarray, gains: PDGains, step: float, target: np.ndarray, near: Trajectory | None = None
) -> Trajectory:
    """Simulate the joint of `values` from rest at the first target; `near` is a run of a joint that is much the same.

    Against gravity the joint starts where the controller holds it, `near` the pose of the first target.
    """
    joint = joint_of(values)
    if joint.gravity is None:
        return simulate(joint, gains, step, target, float(target[0]))
    if near is not None:
        return simulate(joint, gains, step, target, float(near.position[0]), guess=near.position)
    weight = float(joint.gravity.torque(target[0]))
    return simulate(joint, gains, step, target, float(target[0]) - weight / gains.kp)


def sensitivities(
    values: np.ndarray, gains: PDGains, step: float, target: np.ndarray, fast: bool = False
) -> np.ndarray:
    """Return ∂θ/∂p and ∂τ/∂p at every sample, shape (num_parameters, 2, num_samples).

    values: see `joint_of`; target: a [rad], shape (num_samples,); fast: one-sided differences, for half of the work.
    """
    base = run(values, gains, step, target)
    # B and the offset may be zero, and no scale; kd brakes as B does, and the offset is a torque like the friction.
    scales = np.array([values[0], values[1] + gains.kd, *[values[2]] * (len(values) - 2)])
    found = np.empty((len(values), 2, len(target)))
    for index, scale in enumerate(scales):
        change = np.zeros(len(values))
        change[index] = DIFFERENCE * scale
        up = run(values + change, gains, step, target, base)
        down = base if fast else run(values - change, gains, step, target, base)
        width = (1 if fast else 2) * DIFFERENCE * scale
        found[index] = (up.position - down.position) / width, (up.torque - down.torque) / width
    return found


def information(
    values: np.ndarray, gains: PDGains, step: float, target: np.ndarray, noise: LogNoise, fast: bool = False
) -> Information:
    """Return what a log of `target` tells about the parameters; arguments as in `sensitivities`.

    Without torque in the log it is about the combinations that positions show, with the motor strength 1.
    """
    slopes = sensitivities(values, gains, step, target, fast)
    matrix = slopes[:, 0] @ slopes[:, 0].T / noise.position_std**2
    if noise.torque is not None:
        matrix += slopes[:, 1] @ slopes[:, 1].T / noise.torque**2
    shown, names = np.array(values, float), NAMES
    if noise.torque is None:
        shown[1] += gains.kd
        names = COMBINATIONS
    covariance, told = invert(matrix)
    return Information(names[: len(values)], shown, covariance if told.all() else np.diag(np.full(len(values), np.inf)))
