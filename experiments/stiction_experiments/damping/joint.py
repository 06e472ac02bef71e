"""Swaps between B and kd at equal B + k kd in one joint: where the paper's section V holds and where it fails.

The target is a policy's: a sine of a stride, held for a control step. Every case compares the joint of a robot's
specification with itself after damping was moved from the derivative gain to viscous friction.

The net is linear in error and velocity: the smallest that shows on which side of the net the damping is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.core.provenance import seed_streams
from stiction.core.records import column
from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Joint, Trajectory, simulate
from stiction.robots.catalog import find_robot
from stiction.robots.model import Joint as RobotJoint
from stiction_experiments.damping.sampled import (
    Sampling,
    fit_net,
    growth,
    largest_difference,
    output_torque,
    simulate_sampled,
    swapped,
    total_damping,
)

FRICTION, EFFORT, LIMIT = "dry friction", "friction by effort", "torque limit"
SHARP, LATE, FILTERED = "sampled", "sampled, late velocity", "sampled, filtered velocity"
"""Cases of `SwapRow`."""

LEVELS = {
    FRICTION: "friction over torque limit [-]",
    EFFORT: "friction over drive torque [-]",
    LIMIT: "limit over largest torque asked for [-]",
    SHARP: "control period [s]",
    LATE: "control period [s]",
    FILTERED: "control period [s]",
}
"""Case -> what its level is."""

VISCOUS_SHARE = 0.2
"""Most that the paper's randomisation adds to B, as a share of it [-]."""

MORE_VISCOUS, HALF, ALL = f"B × {1 + VISCOUS_SHARE:g}", "half of k·kd to B", "all of k·kd to B"
"""Swaps of `SwapRow`."""

NOISE = 1e-12
"""Difference up to which two motions count as the same, rounding apart [rad]."""


def angle_text(value: float) -> str:
    """Return an angle [rad] as text: one digit where it is rounding, else two."""
    return "0" if value == 0.0 else f"{value:.0e}" if value < NOISE else f"{value:.2g}"


@dataclass(frozen=True)
class SwapRow:
    """One joint with and without a swap at equal B + k kd, in one case."""

    robot: str
    case: str
    """One of `LEVELS`."""
    level: float
    """How much of it; see `LEVELS`."""
    swap: str
    """How much was moved: `MORE_VISCOUS`, `HALF` or `ALL`."""
    moved: float
    """Damping moved from k kd to B [N m s/rad]."""
    amplitude: float
    """Largest angle of the motion without the swap [rad]."""
    position_difference: float
    """Largest difference of the angle [rad]."""
    velocity_difference: float
    """Largest difference of the velocity [rad/s]."""
    torque_difference: float
    """Largest difference of the motor's torque [N m]."""
    growth: float | None
    """Factor by which the sampled loop without limit and friction grows a period, before the swap: unstable above 1."""
    growth_swapped: float | None


@dataclass(frozen=True)
class NetRow:
    """A linear Actuator Net in a simulation with some viscous friction, against the joint that it was logged on."""

    robot: str = field(metadata=column("logged joint"))
    friction_level: float = field(metadata=column("friction", "of τ_max", ".2%"))
    """Dry friction of the logged joint over its torque limit [-]."""
    log: str = field(metadata=column("torque"))
    """Torque in the training log: `motor_side` (without B and friction) or `output_side` (with them)."""
    simulated: str = field(metadata=column("B of the simulation"))
    """B in the simulation: `own`, the logged joint's; `swapped`, half of k kd more; `dropped`, none."""
    damping: float = field(metadata=column("w2", "N m s/rad", ".4f"))
    """Torque per velocity that the net learned [N m s/rad]."""
    total: float = field(metadata=column("w2 + B", "N m s/rad", ".4f"))
    """Sum of `damping` and the simulation's B [N m s/rad]."""
    true_total: float = field(metadata=column("true B + k·kd", "N m s/rad", ".4f"))
    """B + k kd of the logged joint [N m s/rad]."""
    position_difference: float = field(metadata=column("difference", "rad", angle_text))
    """Largest difference of the angle from the logged joint's [rad]."""


@dataclass(frozen=True)
class DrawRow:
    """Joints with drawn damping, in one situation."""

    robot: str = field(metadata=column("joint"))
    situation: str = field(metadata=column("situation"))
    """`free`, `torque limit` or `sampled`."""
    drawn: str = field(metadata=column("drawn", was="way"))
    damping_std: float = field(metadata=column("std of B + k·kd", "N m s/rad", ".4f"))
    """Standard deviation of B + k kd over the draws [N m s/rad]."""
    spread: float = field(metadata=column("spread", "rad", ".6f"))
    """Standard deviation of the angle over the draws, root mean square over time [rad]."""
    pair_difference: float | None = field(metadata=column("pairs", "rad", angle_text))
    """Largest difference of the angle between a draw and the one of B and kd with the same sum [rad];
    None where the sums differ."""


@dataclass(frozen=True)
class RobotRow:
    """A whole robot in the training's simulator with and without half of kd moved to B in every joint."""

    policy: str = field(metadata=column("driven by"))
    """Name of the bundle that drove it, or `in the air` for a hanging robot that swings its legs."""
    friction_level: float = field(metadata=column("friction", "of τ_max", ".0%"))
    """Dry friction over torque limit in every joint [-]."""
    command: str = field(metadata=column("command or robot"))
    """Commanded velocity; in the air the robot."""
    limits: str = field(metadata=column("limits"))
    """The motors' torque limits: `own`, or `lifted`, too high to be reached."""
    saturated_share: float = field(metadata=column("motors at limit", "% of steps", ".2%"))
    """Share of joints and physics steps at the torque limit, without the swap, the first 2 s of a walk left out [-]."""
    speed: float | None = field(metadata=column("speed", "m/s", ".3f"))
    """Mean speed along the command [m/s], None in the air."""
    speed_swapped: float | None = field(metadata=column("swapped", "m/s", ".3f"))
    """The same with the swap [m/s]."""
    free_robots: int = field(metadata=column("under", "robots"))
    """Robots that reached no torque limit within the first second, with and without the swap."""
    free_difference: float | None = field(metadata=column("difference", "rad", angle_text))
    """Largest difference of a joint's angle in that second among these [rad]; None without any."""
    limited_robots: int = field(metadata=column("at limit", "robots"))
    """Robots that did reach one."""
    limited_difference: float | None = field(metadata=column("difference", "rad", angle_text))
    """Largest difference among these [rad]; None without any."""
    twin_difference: float = field(metadata=column("twins", "rad", angle_text))
    """The same of all robots, to twins without a swap whose joints start slightly apart [rad]."""


@dataclass(frozen=True)
class DampingCfg:
    """Settings of the study of one joint."""

    robots: tuple[str, ...] = ("go1", "saturn_lite")
    """Robots whose joint is taken."""
    joint: str | None = None
    """Kind of joint; None: that of the outermost joint, which the paper measured."""
    frequency: float = 2.0
    """Frequency of the stride [Hz]."""
    amplitude: float = 0.3
    """Amplitude of the target [rad]."""
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
    """Cut-off frequency of the filtered velocity [Hz]."""
    draws: int = 100
    """Joints drawn to compare randomisations."""
    spread: float = 0.2
    """Half-width of the drawn multipliers, 0.8 to 1.2 in the paper's Table II [-]."""
    seed: int = 0
    """Seed of the draws."""

    def __post_init__(self) -> None:
        """Refuse times that no motion fits into."""
        if not (0 < self.step <= self.hold <= self.seconds / 10 and self.draws >= 2 and 0 <= self.spread < 1):
            raise ConfigurationError(
                f"steps of {self.step} s, targets held {self.hold} s, {self.seconds} s in all, {self.draws} draws of "
                f"±{self.spread}: expected growing times, at least ten targets, two draws and a spread under 1"
            )

    def target(self, step: float) -> np.ndarray:
        """Return the target at every `step` seconds [rad], shape (num_samples,)."""
        time = np.arange(round(self.seconds / step)) * step
        # Without the small number a target would change a sample late where the quotient comes out just under a whole
        # number.
        held = np.floor(time / self.hold + 1e-9) * self.hold
        return self.amplitude * np.sin(2 * np.pi * self.frequency * held)


def joint_of_robot(robot: str, cfg: DampingCfg) -> RobotJoint:
    """Return the joint that is studied; raise `StictionError` where there is no such robot or kind of joint."""
    spec = find_robot(robot)
    return spec.joints[-1] if cfg.joint is None else spec.kind(cfg.joint)


def joint_of(spec: RobotJoint, level: float | None = None) -> tuple[Joint, PDGains]:
    """Return a kind of joint and its controller without torque limit; level: friction over torque limit, as measured
    by default.
    """
    friction = spec.frictionloss if level is None else level * spec.torque_limit
    return Joint(spec.armature, spec.damping, Coulomb(friction)), PDGains(spec.kp, spec.kd)


def swaps(joint: Joint, gains: PDGains) -> dict[str, float]:
    """Return the swaps in words -> damping moved from k kd to B [N m s/rad]."""
    share = gains.strength * gains.kd
    return {MORE_VISCOUS: VISCOUS_SHARE * joint.viscous, HALF: 0.5 * share, ALL: share}


def swap_rows(robot: str, cfg: DampingCfg) -> Iterator[SwapRow]:
    """Yield a row for every case, level and swap of a robot's joint.

    Raises `StictionError` where there is no such robot.
    """
    spec: RobotJoint = joint_of_robot(robot, cfg)
    for case, level, motion, sampling in _cases(spec, cfg):
        joint, gains = joint_of(spec, level if case == FRICTION else None)
        before = motion(joint, gains)
        amplitude = float(np.abs(before.position).max())
        for name, moved in swaps(joint, gains).items():
            other = swapped(joint, gains, moved)
            apart = largest_difference(before, motion(*other))
            differences = apart.position, apart.velocity, apart.torque
            factors = (None, None) if sampling is None else (growth(joint, gains, sampling), growth(*other, sampling))
            yield SwapRow(robot, case, level, name, moved, amplitude, *differences, *factors)


Motion = Callable[[Joint, PDGains], Trajectory]
"""Simulates a joint and its controller."""

Case = tuple[str, float, Motion, Sampling | None]
"""Case and level of `SwapRow`; the sampling of a controller that is sampled."""


def _cases(spec: RobotJoint, cfg: DampingCfg) -> Iterator[Case]:
    """Yield every case; an unstable sampled controller is kept finite by the joint's own torque limit."""
    asked = _largest_torque(spec, cfg)
    for level in cfg.friction_levels:
        yield FRICTION, level, partial(_exact, cfg, np.inf), None
    for share in cfg.limits:
        yield LIMIT, share, partial(_exact, cfg, share * asked), None
    for effort in cfg.efforts:
        yield EFFORT, effort, partial(_sampled, cfg, np.inf, Sampling(cfg.step), effort=effort), None
    for period in cfg.periods:
        samplings = (Sampling(period), Sampling(period, late=1), Sampling(period, cutoff=cfg.cutoff))
        for case, sampling in zip((SHARP, LATE, FILTERED), samplings, strict=True):
            yield case, period, partial(_sampled, cfg, spec.torque_limit, sampling), sampling


def _largest_torque(spec: RobotJoint, cfg: DampingCfg) -> float:
    """Return the largest torque that the motion asks for without a limit [N m]."""
    return float(np.abs(simulate(*joint_of(spec), cfg.step, cfg.target(cfg.step)).torque).max())


def _exact(cfg: DampingCfg, limit: float, joint: Joint, gains: PDGains) -> Trajectory:
    """Simulate a PD law in continuous time with a torque limit [N m]."""
    return simulate(joint, replace(gains, torque_limit=limit), cfg.step, cfg.target(cfg.step))


def _sampled(
    cfg: DampingCfg, limit: float, sampling: Sampling, joint: Joint, gains: PDGains, effort: float = 0.0
) -> Trajectory:
    """Simulate a sampled controller with a torque limit [N m]; effort: friction over drive torque [1]."""
    limited = replace(gains, torque_limit=limit)
    return simulate_sampled(joint, limited, sampling, cfg.target(sampling.period), effort)


LIMITED = 0.6
"""Torque limit of the limited situation, over the largest torque that the unlimited motion asks for [-]."""

SAMPLED = 0.005
"""Control period of the sampled situation [s]; the motor's own limit holds there."""


def net_rows(robot: str, cfg: DampingCfg) -> Iterator[NetRow]:
    """Yield nets learned on both sides, without friction and with the joint's own, in simulations with three B.

    An output-side log has B and dry friction in it, so beside its net the simulation has no dry friction; a motor-side
    net keeps the joint's.
    """
    spec = joint_of_robot(robot, cfg)
    target = cfg.target(cfg.step)
    for level in (0.0, spec.frictionloss / spec.torque_limit):
        joint, gains = joint_of(spec, level)
        logged = simulate(joint, gains, cfg.step, target)
        sides = {"motor_side": logged.torque, "output_side": output_torque(joint, logged)}
        other = swapped(joint, gains, 0.5 * gains.strength * gains.kd)[0]
        viscous = {"own": joint.viscous, "swapped": other.viscous, "dropped": 0.0}
        for side, torque in sides.items():
            net = fit_net(target - logged.position, logged.velocity, torque)
            friction = joint.friction if side == "motor_side" else Coulomb(0.0)
            for name, value in viscous.items():
                simulated = Joint(joint.inertia, value, friction)
                again = simulate(simulated, net.as_gains(), cfg.step, target)
                difference = float(np.abs(again.position - logged.position).max())
                dampings = net.damping, net.damping + value, total_damping(joint, gains)
                yield NetRow(robot, level, side, name, *dampings, difference)


def draw_rows(robot: str, cfg: DampingCfg) -> Iterator[DrawRow]:
    """Yield the spread of the motion for three randomisations: B and kd; kd alone, the same sums; B alone."""
    spec = joint_of_robot(robot, cfg)
    joint, gains = joint_of(spec)
    stream = seed_streams(cfg.seed, ["damping"])["damping"]
    factors = stream.uniform(1.0 - cfg.spread, 1.0 + cfg.spread, (cfg.draws, 2))
    both = [(replace(joint, viscous=b * joint.viscous), replace(gains, kd=d * gains.kd)) for b, d in factors]
    # What B drew goes to kd: the sums are equal draw by draw, and each has its pair.
    alone = [(joint, replace(gains, kd=(total_damping(*pair) - joint.viscous) / gains.strength)) for pair in both]
    viscous = [(replace(joint, viscous=b * joint.viscous), gains) for b, _ in factors]
    drawn = {"B and kd": both, "kd alone, same sums": alone, "B alone": viscous}
    situations: dict[str, Motion] = {
        "free": partial(_exact, cfg, np.inf),
        "torque limit": partial(_exact, cfg, LIMITED * _largest_torque(spec, cfg)),
        "sampled": partial(_sampled, cfg, spec.torque_limit, Sampling(SAMPLED)),
    }
    for situation, motion in situations.items():
        first = np.array([motion(*pair).position for pair in both])
        for name, pairs in drawn.items():
            angles = first if pairs is both else np.array([motion(*pair).position for pair in pairs])
            sums = [total_damping(*pair) for pair in pairs]
            same = np.allclose(sums, [total_damping(*pair) for pair in both])
            spread, pairs_apart = float(np.sqrt(angles.var(axis=0).mean())), float(np.abs(angles - first).max())
            yield DrawRow(robot, situation, name, float(np.std(sums)), spread, pairs_apart if same else None)
