"""Simulation of one joint under its controller: I q'' + B q' + gravity = τ + d + f − offset, with exact stick and slip.

Between two events the joint is a linear system whose target is a straight line from sample to sample, so its motion is
known in closed form and the events are solved for (`stick_slip`). Gravity is not linear: it is a spring of its mean
slope, plus the remaining torque along the path of the previous pass, until the path no longer changes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.joints.friction import FrictionLaw
from stiction.joints.pd import PDGains, pd_torque
from stiction.joints.stick_slip import Mechanism, Phase, Regimes, StickSlip


@dataclass(frozen=True)
class Gravity:
    """Gravity of a link that turns about an axis fixed in space: sin · sin θ + cos · cos θ."""

    sin: float
    """Torque that holds the link at θ = π/2 [N m]; positive for a pendulum that hangs at θ = 0."""
    cos: float = 0.0
    """Torque that holds the link at θ = 0 [N m]."""

    def __post_init__(self) -> None:
        if not np.isfinite([self.sin, self.cos]).all():
            raise ConfigurationError(f"gravity {self.sin} sin + {self.cos} cos: expected finite numbers")

    def torque(self, angle: np.ndarray) -> np.ndarray:
        """Return the torque that holds the link at `angle` [rad], any shape [N m]."""
        return self.sin * np.sin(angle) + self.cos * np.cos(angle)

    def slope(self, angle: np.ndarray) -> np.ndarray:
        """Return the derivative of `torque` with respect to the angle, any shape [N m/rad]."""
        return self.sin * np.cos(angle) - self.cos * np.sin(angle)


SETTLED = 1e-8
"""Change of the path between two passes below which they end [rad]."""

MOST_PASSES = 40
"""Maximum number of passes; beyond it, gravity counts as too strong for the controller."""


@dataclass(frozen=True)
class Joint:
    """Joint parameters. For a linear axis read kg, N s/m and N."""

    inertia: float
    """I, rotor included [kg m²]."""
    viscous: float
    """B [N m s/rad]."""
    friction: FrictionLaw
    """Dry friction, and any viscous friction of its law."""
    offset: float = 0.0
    """Constant torque that the motor must supply: weight of a cable, bias of the current sensor [N m]."""
    gravity: Gravity | None = None
    """Weight of the link; None for a vertical axis or without a link."""

    def __post_init__(self) -> None:
        numbers = (self.inertia, self.viscous, self.offset)
        if not self.inertia > 0 or not np.isfinite(numbers).all():
            raise ConfigurationError(
                f"joint with inertia {self.inertia}, viscous friction {self.viscous}, offset {self.offset}: "
                "expected a positive inertia and finite numbers"
            )


@dataclass(frozen=True)
class Trajectory:
    """Simulated motion of a joint, sample by sample; arrays of shape (num_samples,)."""

    position: np.ndarray
    """θ [rad]."""
    velocity: np.ndarray
    """θ' [rad/s], exactly zero while it sticks."""
    torque: np.ndarray
    """τ delivered by the motor [N m]."""
    phases: tuple[Phase, ...] = ()
    """Phases of sticking and sliding, in the order of time."""

    def thinned(self, pieces: int) -> Trajectory:
        """Return every n-th sample, without phases."""
        return Trajectory(self.position[::pieces], self.velocity[::pieces], self.torque[::pieces])


def simulate(
    joint: Joint,
    gains: PDGains,
    step: float,
    target: np.ndarray,
    position: float = 0.0,
    velocity: float = 0.0,
    load: np.ndarray | None = None,
    guess: np.ndarray | None = None,
    settled: float = SETTLED,
) -> Trajectory:
    """Simulate a joint that follows `target`.

    step: time between samples [s]; target: a [rad], shape (num_samples,), a straight line from sample to sample;
    position, velocity: θ and θ' at the first sample; load: d, known torque on the joint from outside [N m], shape
    (num_samples,), straight between samples; guess: approximate path [rad], shape (num_samples,), the target by
    default: with gravity a good guess saves passes; settled: change of the path between two passes at which they end
    [rad]. Raises `StictionError` if an input is not finite or too short, and if gravity is too strong for the
    controller to hold.
    """
    target = np.asarray(target, float)
    for name, values in {"target": target, "load": load, "guess": guess}.items():
        if values is not None and (
            np.shape(values) != (len(target),) or len(target) < 2 or not np.isfinite(values).all() or not step > 0
        ):
            raise ConfigurationError(
                f"{name} of shape {np.shape(values)}, step {step} s: expected at least two finite samples, as many as "
                "of the target, and a positive step"
            )
    outside = np.zeros(len(target)) if load is None else np.asarray(load, float)

    regimes: Regimes = {}

    def run(push: np.ndarray, more_friction: np.ndarray, spring: float) -> Motion:
        mechanism = Mechanism(joint.inertia, joint.viscous, joint.friction, spring, push, more_friction)
        course = StickSlip(mechanism, gains, step, target, regimes)
        return course.run(position, velocity), tuple(course.phases)

    if joint.gravity is None and not joint.friction.depends_on_angle and not joint.friction.effort_coefficient:
        # Nothing depends on where the joint is, so that one pass is exact.
        motion, phases = run(outside - joint.offset, joint.friction.load_coefficient * np.abs(outside), 0.0)
    else:
        path = np.asarray(target if guess is None else guess, float)
        motion, phases = _settle(joint, gains, step, target, outside, path, run, settled)
    return Trajectory(motion[0], motion[1], pd_torque(gains, target, motion[0], motion[1]), phases)


Motion = tuple[np.ndarray, tuple[Phase, ...]]
"""θ and θ', shape (2, num_samples), and the phases."""


def _settle(
    joint: Joint,
    gains: PDGains,
    step: float,
    target: np.ndarray,
    outside: np.ndarray,
    path: np.ndarray,
    run: Callable[[np.ndarray, np.ndarray, float], Motion],
    settled: float,
) -> Motion:
    """Simulate with weight and friction along the path of the previous pass, until the path no longer changes.

    run: function of known torque apart from motor, friction and spring [N m], friction beyond the law's [N m], and
    spring.
    """
    gravity = joint.gravity or Gravity(0.0, 0.0)
    spring, change, velocity = mean_slope(gravity, path), np.inf, np.gradient(path, step)
    for _ in range(MOST_PASSES):
        weight = gravity.torque(path)
        more_friction = joint.friction.load_coefficient * np.abs(outside - weight) + joint.friction.at_angle(path)
        if joint.friction.effort_coefficient:
            more_friction += joint.friction.effort_coefficient * np.abs(pd_torque(gains, target, path, velocity))
        motion, phases = run(outside - joint.offset - (weight - spring * path), more_friction, spring)
        previous, change = change, float(np.abs(motion[0] - path).max())
        path, velocity = motion
        if change < settled:
            return motion, phases
        # Not `>`: a path of NaN ends here too.
        if not change < 1e6 * max(1.0, previous):
            break
    raise ConfigurationError(
        f"gravity of {gravity.sin:.4g} sin + {gravity.cos:.4g} cos, or friction that depends on the angle, under kp "
        f"{gains.strength * gains.kp:.4g}: the simulation does not settle (its path still changes by {change:.3g} "
        "rad); expected slopes well under kp"
    )


def mean_slope(gravity: Gravity, path: np.ndarray) -> float:
    """Return the mean slope of the weight along a path [N m/rad]; path: θ [rad], shape (num_samples,)."""
    return float(np.mean(gravity.slope(path)))
