"""Swaps between B and kd at equal B + k kd: what one joint does, where the paper's section V holds and where it fails.

The motion is a policy's: a sine of a stride, held for a control step. Every case compares the joint of a robot's
specification with itself after damping was moved from the derivative gain to viscous friction.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from stiction.formats.damping import EFFORT, FILTERED, FRICTION, LATE, LIMIT, SHARP, SwapRow
from stiction.formats.errors import StictionError
from stiction.joints.damping import largest_difference, swapped
from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains
from stiction.joints.sampled import Sampling, growth, simulate_sampled
from stiction.joints.simulate import Joint, Trajectory, simulate
from stiction.robots.catalog import find_robot
from stiction.robots.spec import JOINT_KINDS, JointSpec


@dataclass(frozen=True)
class DampingCfg:
    """What the study of one joint goes through."""

    robots: tuple[str, ...] = ("go1", "saturn_lite")
    """Robots whose joint is taken."""
    joint: str = "shank"
    """Kind of joint; the paper measured the shank's."""
    frequency: float = 2.0
    """Of the stride [Hz]."""
    amplitude: float = 0.3
    """Of the target [rad]."""
    hold: float = 0.02
    """Time for which a target stands, a policy's control period [s]."""
    seconds: float = 2.0
    """Length of a motion [s]."""
    step: float = 0.00025
    """Time between samples of the exact simulation [s]."""
    friction_levels: tuple[float, ...] = (0.0, 0.01, 0.05, 0.1, 0.2)
    """Dry friction over torque limit [-]."""
    efforts: tuple[float, ...] = (0.0, 0.05, 0.1, 0.2, 0.4)
    """Friction over drive torque, c of the law c |τ| [1]."""
    limits: tuple[float, ...] = (1.0, 0.9, 0.8, 0.6, 0.4, 0.2)
    """Torque limits, over the largest torque that the unlimited motion asks for [-]."""
    periods: tuple[float, ...] = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02)
    """Control periods [s]."""
    cutoff: float = 50.0
    """Of the filtered velocity [Hz]."""
    draws: int = 100
    """Joints drawn to compare ways of randomising."""
    spread: float = 0.2
    """Half-width of the drawn multipliers, 0.8 to 1.2 in the paper's Table II [-]."""
    seed: int = 0
    """Seed of the draws."""

    def __post_init__(self) -> None:
        """Refuse a joint that robots do not have, and times that no motion fits into."""
        if self.joint not in JOINT_KINDS:
            raise StictionError(f"joint {self.joint!r}: expected one of {', '.join(JOINT_KINDS)}")
        if not (0 < self.step <= self.hold <= self.seconds / 10 and self.draws >= 2 and 0 <= self.spread < 1):
            raise StictionError(
                f"steps of {self.step} s, targets held {self.hold} s, {self.seconds} s in all, {self.draws} draws of "
                f"±{self.spread}: expected growing times, at least ten targets, two draws and a spread under 1"
            )

    def target(self, step: float) -> np.ndarray:
        """Return the target at every `step` seconds [rad], shape (num_samples,)."""
        time = np.arange(round(self.seconds / step)) * step
        held = np.floor(time / self.hold + 1e-9) * self.hold
        return self.amplitude * np.sin(2 * np.pi * self.frequency * held)


def joint_of(spec: JointSpec, level: float | None = None) -> tuple[Joint, PDGains]:
    """Return a kind of joint and its controller without torque limit; level: friction over torque limit, as measured
    by default.
    """
    dry = spec.frictionloss if level is None else level * spec.torque_limit
    return Joint(spec.armature, spec.damping, Coulomb(dry)), PDGains(spec.stiffness, spec.derivative)


def swaps(joint: Joint, gains: PDGains) -> dict[str, float]:
    """Return the swaps in words -> damping moved from k kd to B [N m s/rad]."""
    share = gains.strength * gains.kd
    return {"B × 1.2": 0.2 * joint.viscous, "half of k·kd to B": 0.5 * share, "all of k·kd to B": share}


def swap_rows(robot: str, cfg: DampingCfg) -> Iterator[SwapRow]:
    """Yield a row for every case, level and swap of a robot's joint.

    Raises `StictionError` where there is no such robot.
    """
    spec: JointSpec = getattr(find_robot(robot), cfg.joint)
    for case, level, motion, sampling in (*_exact(spec, cfg), *_sampled(spec, cfg)):
        joint, gains = joint_of(spec, level if case == FRICTION else None)
        before = motion(joint, gains)
        for name, moved in swaps(joint, gains).items():
            other = swapped(joint, gains, moved)
            difference = largest_difference(before, motion(*other))
            factors = (None, None) if sampling is None else (growth(joint, gains, sampling), growth(*other, sampling))
            yield SwapRow(
                robot,
                case,
                level,
                name,
                moved,
                float(np.abs(before.position).max()),
                difference.position,
                difference.velocity,
                difference.torque,
                *factors,
            )


def _exact(spec: JointSpec, cfg: DampingCfg) -> Iterator[tuple]:
    """Yield case, level, motion of (joint, gains) and no sampling, for a PD law in continuous time."""
    target = cfg.target(cfg.step)
    asked = float(np.abs(simulate(*joint_of(spec), cfg.step, target).torque).max())

    def limited(share: float):
        return lambda joint, gains: simulate(joint, replace(gains, torque_limit=share * asked), cfg.step, target)

    def felt(effort: float):
        return lambda joint, gains: simulate_sampled(joint, gains, Sampling(cfg.step), target, effort)

    for level in cfg.friction_levels:
        yield FRICTION, level, lambda joint, gains: simulate(joint, gains, cfg.step, target), None
    for share in cfg.limits:
        yield LIMIT, share, limited(share), None
    for effort in cfg.efforts:
        yield EFFORT, effort, felt(effort), None


def _sampled(spec: JointSpec, cfg: DampingCfg) -> Iterator[tuple]:
    """Yield the same for a sampled controller; an unstable one is kept finite by the joint's own torque limit."""

    def run(sampling: Sampling):
        def motion(joint: Joint, gains: PDGains) -> Trajectory:
            limited = replace(gains, torque_limit=spec.torque_limit)
            return simulate_sampled(joint, limited, sampling, cfg.target(sampling.period))

        return motion

    for period in cfg.periods:
        for case, sampling in (
            (SHARP, Sampling(period)),
            (LATE, Sampling(period, late=1)),
            (FILTERED, Sampling(period, cutoff=cfg.cutoff)),
        ):
            yield case, period, run(sampling), sampling
