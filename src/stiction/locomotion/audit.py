"""Measures that every randomised parameter changes the physics as its own formula says.

Randomisation that silently does nothing is a recurring fault: a multiplier of a zero default, a derived constant that
is not recomputed, a controller that overwrites the value. So nothing is read back here. For each parameter, robots
with its two ends are simulated, and the *difference* of their motion is compared with the difference that the formula
gives:

    share = <measured, expected> / <expected, expected>

is 1 where the parameter acts as it should and 0 where it does nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch

from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Joint, simulate
from stiction.locomotion.config import FrictionCfg, RandomizationCfg, TaskCfg
from stiction.locomotion.env import LocomotionEnv
from stiction.locomotion.randomization import Randomizer, nominal_joints
from stiction.robots.spec import RobotSpec
from stiction.sim.fleet import Fleet

TOLERANCE = 0.1
"""Largest deviation of a share from 1. The physics step and the soft contacts stay well under it."""

STEP = 0.15
"""Step of the joint target on the bench [rad]."""

BENCH_SECONDS = 0.3
"""Length of a bench run [s]."""

GRAVITY = 9.81
"""[m/s²]."""


@dataclass(frozen=True)
class AuditRow:
    """What was found out about one parameter."""

    parameter: str
    """Field of `RandomizationCfg`, or `friction`, or a check of its own."""
    quantity: str
    """What was measured."""
    share: float
    """Measured over expected effect; NaN where the formula expects none."""

    @property
    def ok(self) -> bool:
        """Whether the parameter does what it says."""
        return abs(self.share - 1.0) <= TOLERANCE

    @property
    def verdict(self) -> str:
        """One phrase for the table."""
        if self.ok:
            return "acts as its formula says"
        if not np.isfinite(self.share):
            return "CANNOT ACT: by its own formula it changes nothing (a multiplier of zero?)"
        return "DOES NOTHING" if abs(self.share) < TOLERANCE else "acts, but NOT as its formula says"


def effect_share(measured: np.ndarray, expected: np.ndarray) -> float:
    """Return <measured, expected> / <expected, expected>; NaN where nothing is expected."""
    norm = float(np.sum(expected * expected))
    return float(np.sum(measured * expected)) / norm if norm > 1e-18 else float("nan")


class Bench:
    """One robot's joints and body on a test stand, randomised through the same `Randomizer` as in training."""

    def __init__(self, spec: RobotSpec, cfg: RandomizationCfg, level: float) -> None:
        """`level`: nominal dry friction as a share of the torque limit."""
        self.spec, self.cfg, self.level = spec, cfg, level

    def fleet(self, num: int, **draws: float | np.ndarray) -> tuple[Fleet, Randomizer]:
        """Return `num` robots, nominal but for `draws`, without gravity."""
        fleet = Fleet(self.spec, num)
        friction = FrictionCfg(level=self.level)
        randomizer = Randomizer(fleet, self.cfg, friction, nominal_joints(fleet, friction))
        for name in ("armature", "damping", "stiffness", "motor_strength", "ground_friction"):
            getattr(randomizer.draws, name)[:] = 1.0
        for name, value in draws.items():
            getattr(randomizer.draws, name)[:] = torch.as_tensor(value, dtype=torch.float32)
        randomizer.apply(torch.arange(num))
        return fleet, randomizer

    def joint_motion(self, **draws: float) -> np.ndarray:
        """Return each joint's angle after a step of its target, all else held, (joints, samples)."""
        joints = self.spec.num_joints
        fleet, _ = self.fleet(joints, **draws)
        fleet.set_gravity((0.0, 0.0, 0.0))
        fleet.base_position[:, 2] += 1.0
        fleet.clamp(~np.eye(joints, dtype=bool), base=True)
        everyone = np.arange(joints)
        fleet.set_targets(fleet.standing + STEP * np.eye(joints))
        motion = [fleet.joint_position[everyone, everyone] - fleet.standing]
        for _ in range(round(BENCH_SECONDS / fleet.timestep)):
            fleet.simulation.step(1)
            motion.append(fleet.joint_position[everyone, everyone] - fleet.standing)
        return np.array(motion).T

    def joint_formula(
        self,
        armature: float = 1.0,
        damping: float = 1.0,
        friction: float = 0.0,
        stiffness: float = 1.0,
        motor_strength: float = 1.0,
        action_delay: float = 0.0,
    ) -> np.ndarray:
        """Return what I q'' + B q' = τ + f gives for the same step, (joints, samples)."""
        fleet = Fleet(self.spec, 1)
        # The reference joins its targets by straight lines: a grid ten times finer makes the step a step.
        fine = 10
        links, step = fleet.link_inertia(), fleet.timestep / fine
        nominal = nominal_joints(fleet, FrictionCfg(level=self.level))
        target = np.full(round(BENCH_SECONDS / step) + 1, STEP)
        target[: round(action_delay / step)] = 0.0
        motion = []
        for j in range(self.spec.num_joints):
            joint = Joint(
                inertia=links[j] + armature * nominal.armature[j],
                viscous=damping * nominal.damping[j],
                friction=Coulomb(friction * nominal.frictionloss[j]),
            )
            gains = PDGains(
                kp=stiffness * fleet.nominal_kp[j],
                kd=fleet.nominal_kd[j],
                torque_limit=fleet.torque_limit[j],
                strength=motor_strength,
            )
            motion.append(simulate(joint, gains, step, target).position[::fine])
        return np.array(motion)

    def standing_feet(
        self, gravity: tuple[float, float, float], **draws: float | np.ndarray
    ) -> tuple[float, np.ndarray]:
        """Return the weight on the feet [N] and its centre on the ground [m], (2,), joints held, under `gravity`."""
        fleet, _ = self.fleet(1, **draws)
        fleet.set_gravity(gravity)
        fleet.clamp(np.ones((1, self.spec.num_joints), bool), base=False)
        for _ in range(round(1.0 / fleet.control_period)):
            fleet.step()
        force = fleet.foot_force[0]
        return float(force.sum()), force @ (fleet.foot_position(0)[:, :2] - fleet.base_position[0, :2]) / force.sum()

    def slide(self, **draws: float) -> float:
        """Return the deceleration [m/s²] of a robot that slides on its feet, joints held, over half a second."""
        fleet, _ = self.fleet(1, **draws)
        fleet.clamp(np.ones((1, self.spec.num_joints), bool), base=False)
        for _ in range(25):
            fleet.step()
        fleet.qvel[:, 0] = start = 3.0
        for _ in range(25):
            fleet.step()
        return float(start - fleet.qvel[0, 0]) / (25 * fleet.control_period)


def audit_joints(bench: Bench) -> list[AuditRow]:
    """Check what acts in a joint, by its step response."""
    cfg = bench.cfg
    spans = {
        name: getattr(cfg, name) for name in ("armature", "damping", "stiffness", "motor_strength", "action_delay")
    }
    spans = {name: span for name, span in spans.items() if span[0] != span[1]}
    rows = []
    for name, ends in {**spans, "friction": (0.0, 1.2)}.items():
        effects = []
        for motion in (bench.joint_motion, bench.joint_formula):
            low, high = (motion(**{name: end}) for end in ends)
            effects.append(high - low)
        share = effect_share(*effects)
        rows.append(AuditRow(name, "step response of every joint", share))
    return rows


def audit_body(bench: Bench) -> list[AuditRow]:
    """Check masses and ground friction, by weight, centre of pressure and sliding."""
    cfg, spec, rows = bench.cfg, bench.spec, []
    down, tilt = (0.0, 0.0, -GRAVITY), 0.1
    low, high = (bench.standing_feet(down, payload=end)[0] for end in cfg.payload)
    rows.append(AuditRow("payload", "weight on the feet", (high - low) / (GRAVITY * (cfg.payload[1] - cfg.payload[0]))))

    size = np.array(spec.base.size)
    for axis, gravity, lever in (
        (0, down, 1.0),
        (1, down, 1.0),
        (2, (tilt * GRAVITY, 0.0, -GRAVITY), tilt),
    ):
        ends = np.array(cfg.center_of_mass) * size[axis] / size[0]
        shifts = [np.eye(3)[axis] * end for end in ends]
        low_centre, high_centre = (bench.standing_feet(gravity, center_of_mass=shift)[1] for shift in shifts)
        expected = (ends[1] - ends[0]) * spec.base.mass / spec.mass * lever
        measured = (high_centre - low_centre)[1 if axis == 1 else 0]
        rows.append(AuditRow("center_of_mass", f"centre of pressure, {'xyz'[axis]}", float(measured / expected)))

    low_end = cfg.ground_friction[0]
    high_end = min(cfg.ground_friction[1], low_end + 0.3)
    change = bench.slide(ground_friction=high_end) - bench.slide(ground_friction=low_end)
    rows.append(AuditRow("ground_friction", "deceleration in sliding", change / ((high_end - low_end) * GRAVITY)))
    return rows


def audit_env(cfg: TaskCfg) -> list[AuditRow]:
    """Check what acts in the task itself: pushes, encoder offsets, the ranges drawn, and derived constants."""
    period, bound = cfg.control_period, cfg.randomization.push_velocity
    quiet = replace(cfg.noise, angular_velocity=0.0, roll_pitch=0.0, joint_position=0.0, joint_velocity=0.0)
    pushed = replace(cfg, noise=quiet, randomization=replace(cfg.randomization, push_interval=period))
    env = LocomotionEnv(pushed, num_envs=512, seed=0)
    obs, _, dones, _ = env.step(torch.zeros(512, env.num_actions))
    change = (obs["explicit"][:, :3] - env.linear_velocity)[~dones]
    rows = []
    if bound:
        # Uniform on ±bound in two directions: the squared norm is 2 bound² / 3 on average.
        rows.append(
            AuditRow(
                "push_velocity",
                "change of the base's velocity",
                float(change.square().sum(-1).mean() / (2 / 3 * bound**2)),
            )
        )
    rows += _encoder_rows(env, obs)
    rows += _range_rows(env)
    rows.append(AuditRow("derived constants", "agreement with a fresh model", 1.0 - env.fleet.stale_constants(0)))
    return rows


def _encoder_rows(env: LocomotionEnv, obs: object) -> list[AuditRow]:
    """Check that encoder offsets reach both the observation and the joint controller."""
    offset = env.randomizer.draws.encoder_offset.double().numpy()
    if not offset.any():
        return []
    frame = env.get_observations()["proprioception"].double().numpy()
    start = sum(term.size for term in env.layout.terms[: [t.name for t in env.layout.terms].index("joint_position")])
    seen = frame[:, start : start + env.num_actions] - (env.fleet.joint_position - env.fleet.standing)
    env.step(torch.zeros(env.num_envs, env.num_actions))
    held = env.fleet.targets - env.fleet.standing
    return [
        AuditRow("encoder_offset", "angle measured minus true", effect_share(seen, offset)),
        AuditRow("encoder_offset", "angle held by the controller", effect_share(held, -offset)),
    ]


def _range_rows(env: LocomotionEnv) -> list[AuditRow]:
    """Check that the draws fill their ranges: drawn span over configured span."""
    rows = []
    for name, values in vars(env.randomizer.draws).items():
        low, high = env.cfg.friction.range if name == "friction" else getattr(env.cfg.randomization, name)
        if low == high:
            continue
        values = values[:, :1] if name == "center_of_mass" else values
        inside = bool((values >= low - 1e-6).all() and (values <= high + 1e-6).all())
        span = float(values.max() - values.min()) / (high - low)
        rows.append(AuditRow(name, "span of the values drawn", span if inside else float("nan")))
    return rows


def check_randomization(
    cfg: TaskCfg, spec: RobotSpec, report: Callable[[str], None] = lambda _: None
) -> list[AuditRow]:
    """Return the audit of every randomised parameter of a task; `report` is told what is being measured."""
    level = cfg.friction.level if cfg.friction.level is not None else 0.1
    bench = Bench(spec, cfg.randomization, level)
    report("joints")
    rows = audit_joints(bench)
    report("masses and ground")
    rows += audit_body(bench)
    report("task")
    return rows + audit_env(cfg)
