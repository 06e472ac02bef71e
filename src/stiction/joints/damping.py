"""Viscous friction B and derivative gain k·kd: one number to the joint's motion, as long as the PD law is all there is.

The paper's section V: with τ = k (kp (a − θ) − kd θ'), I θ'' + B θ' = τ + f is

    I θ'' + (B + k kd) θ' + k kp (θ − a) = f,

in which B and kd appear in their sum alone. A *swap* moves damping from one to the other and keeps the sum. It changes
nothing where the equation holds, dry friction included, for f depends on θ' and not on its causes. It changes the
motion where kd θ' is not what acts on the joint: a torque limit cuts it, a sampled controller holds it, a filter makes
it late, friction that grows with the drive torque feels it, a net has learned it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stiction.formats.errors import StictionError
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Joint, Trajectory


def total_damping(joint: Joint, gains: PDGains) -> float:
    """Return B + k kd [N m s/rad]."""
    return joint.viscous + gains.strength * gains.kd


def swapped(joint: Joint, gains: PDGains, moved: float) -> tuple[Joint, PDGains]:
    """Return joint and gains with `moved` [N m s/rad] of damping taken from k kd and given to B; negative: back.

    Raises `StictionError` where B or kd would become negative.
    """
    viscous, derivative = joint.viscous + moved, gains.kd - moved / gains.strength
    if viscous < 0.0 or derivative < 0.0:
        raise StictionError(
            f"{moved:.4g} N m s/rad moved from k kd to B leaves kd {derivative:.4g} and B {viscous:.4g}: expected at "
            f"least {-joint.viscous:.4g} and at most {gains.strength * gains.kd:.4g}"
        )
    return replace(joint, viscous=viscous), replace(gains, kd=derivative)


@dataclass(frozen=True)
class Difference:
    """How far two motions of a joint are apart, at the sample where they are furthest."""

    position: float
    """[rad]."""
    velocity: float
    """[rad/s]."""
    torque: float
    """Of the motor [N m]; a swap always changes it, by `moved` times the speed."""


def largest_difference(first: Trajectory, second: Trajectory) -> Difference:
    """Return how far two trajectories of the same samples are apart."""
    pairs = ((getattr(first, name), getattr(second, name)) for name in ("position", "velocity", "torque"))
    return Difference(*(float(np.abs(one - other).max()) for one, other in pairs))


@dataclass(frozen=True)
class LinearNet:
    """The smallest Actuator Net: torque = stiffness · (a − θ) − damping · θ'."""

    stiffness: float
    """[N m/rad]."""
    damping: float
    """[N m s/rad]."""

    def as_gains(self) -> PDGains:
        """Return the controller that it is, without limit."""
        return PDGains(self.stiffness, self.damping)


def fit_net(error: np.ndarray, velocity: np.ndarray, torque: np.ndarray) -> LinearNet:
    """Fit a net by least squares; a − θ [rad], θ' [rad/s] and logged torque [N m], shape (num_samples,) each."""
    weights, *_ = np.linalg.lstsq(np.column_stack([error, -velocity]), torque, rcond=None)
    return LinearNet(float(weights[0]), float(weights[1]))


def output_torque(joint: Joint, made: Trajectory) -> np.ndarray:
    """Return what leaves the joint, motor torque less its own B θ' and dry friction [N m], shape (num_samples,).

    At rest friction takes all of the motor's torque. Raises `StictionError` for a law other than plain Coulomb
    friction in both directions, whose value the velocity's sign does not tell.
    """
    pieces = [joint.friction.pieces(way) for way in (1, -1)]
    if any(len(chain) != 1 or chain[0].slope for chain in pieces) or joint.friction.depends_on_angle:
        raise StictionError(f"{type(joint.friction).__name__} friction: expected Coulomb friction")
    level = np.where(made.velocity > 0, pieces[0][0].level, pieces[1][0].level)
    sliding = made.torque - joint.viscous * made.velocity - np.sign(made.velocity) * level
    return np.where(made.velocity == 0.0, 0.0, sliding)
