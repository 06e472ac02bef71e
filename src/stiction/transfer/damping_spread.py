"""What follows from B and kd being one number: for an Actuator Net, which holds only one of them, and for randomising.

The net here is linear, in error and velocity, fitted by least squares: the smallest that can show on which side of the
net the damping is. A network with hidden layers learns more (limits, friction), and the same of this.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from stiction.formats.damping import DrawRow, NetRow
from stiction.formats.reproducibility import seed_streams
from stiction.joints.damping import fit_net, output_torque, swapped, total_damping
from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains
from stiction.joints.sampled import Sampling, simulate_sampled
from stiction.joints.simulate import Joint, simulate
from stiction.robots.catalog import find_robot
from stiction.transfer.damping import DampingCfg, joint_of

LIMITED = 0.6
"""Torque limit of the limited situation, over the largest torque that the unlimited motion asks for [-]."""

SAMPLED = 0.005
"""Control period of the sampled situation [s]; the motor's own limit holds there."""

Motion = Callable[[Joint, PDGains], np.ndarray]
"""Angle over time [rad], shape (num_samples,), of a joint and its controller."""


def net_rows(robot: str, cfg: DampingCfg) -> Iterator[NetRow]:
    """Yield nets learned on both sides, without friction and with the joint's own, in simulations with three B.

    An output-side log has B and dry friction in it, so beside its net the simulation has no dry friction; a motor-side
    net keeps the joint's.
    """
    spec = getattr(find_robot(robot), cfg.joint)
    target = cfg.target(cfg.step)
    for level in (0.0, spec.frictionloss / spec.torque_limit):
        joint, gains = joint_of(spec, level)
        made = simulate(joint, gains, cfg.step, target)
        logged = {"motor_side": made.torque, "output_side": output_torque(joint, made)}
        other = swapped(joint, gains, 0.5 * gains.strength * gains.kd)[0]
        viscous = {"own": joint.viscous, "swapped": other.viscous, "dropped": 0.0}
        for side, torque in logged.items():
            net = fit_net(target - made.position, made.velocity, torque)
            friction = joint.friction if side == "motor_side" else Coulomb(0.0)
            for name, value in viscous.items():
                simulated = Joint(joint.inertia, value, friction)
                again = simulate(simulated, net.as_gains(), cfg.step, target)
                yield NetRow(
                    robot,
                    level,
                    side,
                    name,
                    net.damping,
                    net.damping + value,
                    total_damping(joint, gains),
                    float(np.abs(again.position - made.position).max()),
                )


def draw_rows(robot: str, cfg: DampingCfg) -> Iterator[DrawRow]:
    """Yield the spread of the motion for damping drawn in three ways: B and kd; kd alone, the same sums; B alone."""
    spec = getattr(find_robot(robot), cfg.joint)
    joint, gains = joint_of(spec)
    stream = seed_streams(cfg.seed, ["damping"])["damping"]
    factors = stream.uniform(1.0 - cfg.spread, 1.0 + cfg.spread, (cfg.draws, 2))
    both = [(replace(joint, viscous=b * joint.viscous), replace(gains, kd=d * gains.kd)) for b, d in factors]
    alone = [(joint, replace(gains, kd=(total_damping(*pair) - joint.viscous) / gains.strength)) for pair in both]
    viscous = [(replace(joint, viscous=b * joint.viscous), gains) for b, _ in factors]
    ways = {"B and kd": both, "kd alone, same sums": alone, "B alone": viscous}
    for situation, motion in _situations(joint, gains, spec.torque_limit, cfg).items():
        first = np.array([motion(*pair) for pair in both])
        for name, pairs in ways.items():
            angles = first if pairs is both else np.array([motion(*pair) for pair in pairs])
            sums = [total_damping(*pair) for pair in pairs]
            same = np.allclose(sums, [total_damping(*pair) for pair in both])
            yield DrawRow(
                robot,
                situation,
                name,
                float(np.std(sums)),
                float(np.sqrt(angles.var(axis=0).mean())),
                float(np.abs(angles - first).max()) if same else None,
            )


def _situations(joint: Joint, gains: PDGains, strongest: float, cfg: DampingCfg) -> dict[str, Motion]:
    """Return where the draws are simulated: as the equation has it, at a torque limit, and sampled."""
    target = cfg.target(cfg.step)
    asked = float(np.abs(simulate(joint, gains, cfg.step, target).torque).max())

    def exact(limit: float) -> Motion:
        return lambda joint, gains: simulate(joint, replace(gains, torque_limit=limit), cfg.step, target).position

    def sampled(joint: Joint, gains: PDGains) -> np.ndarray:
        limited = replace(gains, torque_limit=strongest)
        return simulate_sampled(joint, limited, Sampling(SAMPLED), cfg.target(SAMPLED)).position

    return {"free": exact(float("inf")), "torque limit": exact(LIMITED * asked), "sampled": sampled}
