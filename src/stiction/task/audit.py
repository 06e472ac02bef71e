"""Audit of every randomised parameter: it must change the physics as its formula says.

For each, robots with its two ends are simulated, and the *difference* of their motion is compared with the formula's:
share = <measured, expected> / <expected, expected> is 1 where the parameter acts as it should and 0 where it does
nothing. Joints are judged one by one; the worst counts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.optimize import brentq

from stiction.robots.model import GRAVITY, TRUNK_LENGTH, Robot
from stiction.task.audit_robots import FrictionBench, Stand
from stiction.task.config import TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import NUMBERS

TOLERANCE = 0.1
"""Maximum deviation of a share from 1; the errors of physics step and soft contacts are well under it."""

AUDIT_LEVEL = 0.1
"""Default friction level of the audit."""

DOWN = (0.0, 0.0, -GRAVITY)
"""Gravity [m/s²]."""

SLIDING_SPAN = 0.3
"""Maximum difference of ground friction in a measurement: with more, the robot stops before the end."""


@dataclass(frozen=True)
class AuditRow:
    """Audit of one parameter."""

    parameter: str
    """Field of `RandomizationCfg`, or `friction`, or `load_coefficient`, or the name of another check."""
    quantity: str
    share: float
    """Measured over expected effect, of the worst joint; NaN if the formula expects none."""

    @property
    def ok(self) -> bool:
        """True if the parameter acts as expected."""
        return abs(self.share - 1.0) <= TOLERANCE

    @property
    def verdict(self) -> str:
        """`ok` in words."""
        if self.ok:
            return "acts as its formula says"
        if not np.isfinite(self.share):
            return "CANNOT ACT: by its own formula it changes nothing (a multiplier of zero?)"
        return "DOES NOTHING" if abs(self.share) < TOLERANCE else "acts, but NOT as its formula says"


def effect_share(measured: np.ndarray, expected: np.ndarray) -> float:
    """Return <measured, expected> / <expected, expected> of the row furthest from 1, NaN where one expects zero."""
    measured, expected = np.atleast_2d(measured), np.atleast_2d(expected)
    norm = np.sum(expected * expected, axis=1)
    if (norm < 1e-18).any():
        return float("nan")
    share = np.sum(measured * expected, axis=1) / norm
    return float(share[np.argmax(np.abs(share - 1.0))])


def audit_joints(stand: Stand) -> list[AuditRow]:
    """Check the joint parameters other than friction, by step responses; damping if a nominal one is known."""
    cfg = stand.cfg
    names = ("armature", "damping", "stiffness", "motor_strength", "action_delay")
    spans = {name: getattr(cfg.randomization, name) for name in names}
    if not stand.spec.joint_values("damping").any():
        del spans["damping"]
    rows = []
    for name, (low, high) in spans.items():
        if low != high:
            motions = (stand.joint_motion, stand.joint_formula)
            effects = [motion(**{name: high}) - motion(**{name: low}) for motion in motions]
            rows.append(AuditRow(name, "step response, worst joint", effect_share(*effects)))
    return rows


def audit_friction(stand: Stand) -> list[AuditRow]:
    """Check the law of friction at the largest multiplier, and the load coefficient in addition."""
    cfg, rows = stand.cfg.friction, []
    most = cfg.last.range[1]
    if most > 0.0 and cfg.level != 0.0:
        highest = {name: high for name, (_, high) in cfg.drawn_numbers.items()}
        rows += _friction_rows("friction", FrictionBench(stand, most, **highest))
    if cfg.load is not None and cfg.load[1] > 0.0:
        # As with the level: less moves a joint less than the physics step's own error.
        coefficient = max(cfg.load[1], AUDIT_LEVEL)
        rows += _friction_rows("load_coefficient", FrictionBench(stand, 0.0, coefficient))
    return rows


def _friction_rows(parameter: str, bench: FrictionBench) -> list[AuditRow]:
    """Check friction at rest, at break-away, and sliding."""
    law = bench.law.name
    hold, begin = (values[np.argmax(np.abs(values - 1.0))] for values in (bench.hold(), bench.break_away()))
    shares = {
        "holds below its bound": hold,
        "torque of break-away": begin,
        "brakes above its bound": effect_share(*bench.slowed(coasting=False)),
        "slows free motion": effect_share(*bench.slowed(coasting=True)),
    }
    return [AuditRow(parameter, f"{law}: {what}, worst joint", float(share)) for what, share in shares.items()]


def audit_body(stand: Stand) -> list[AuditRow]:
    """Check masses by the weight and the moment of a hanging robot, and ground friction by sliding."""
    cfg, rows = stand.cfg.randomization, []
    if cfg.payload[0] < cfg.payload[1]:
        low, high = (stand.hanging(DOWN, payload=end)[2] for end in cfg.payload)
        share = (low - high) / (GRAVITY * (cfg.payload[1] - cfg.payload[0]))
        rows.append(AuditRow("payload", "weight", float(share)))
    if cfg.center_of_mass[0] < cfg.center_of_mass[1]:
        rows += [_center_of_mass(stand, axis) for axis in range(3)]
    hard, soft = cfg.contact_time
    if hard < soft:
        depth = stand.sunk(contact_time=hard)
        share = (stand.sunk(contact_time=soft) - depth) / (sunk_at(soft, depth, hard) - depth)
        rows.append(AuditRow("contact_time", "depth that the feet sink", share))
    low_end, high_end = cfg.ground_friction
    high_end = min(high_end, low_end + SLIDING_SPAN)
    if low_end < high_end:
        change = stand.slide(ground_friction=high_end) - stand.slide(ground_friction=low_end)
        share = change / ((high_end - low_end) * GRAVITY)
        rows.append(AuditRow("ground_friction", "deceleration in sliding", share))
    return rows


def sunk_at(time: float, depth: float, other: float) -> float:
    """Return the depth of the feet [m] at a time constant [s], from the `depth` of the same load at `other`.

    A load N sinks r with N = c r d(r)^2 / ((1 - d(r)) T^2), d(r) MuJoCo's impedance.
    """

    def load(r: float) -> float:
        # MuJoCo's default `solimp`: from 0.9 to 0.95 over 1 mm, midpoint 0.5, power 2.
        x = min(r / 0.001, 1.0)
        d = 0.9 + 0.05 * (2 * x * x if x < 0.5 else 1 - 2 * (1 - x) ** 2)
        return r * d * d / (1 - d)

    return float(brentq(lambda r: load(r) / time**2 - load(depth) / other**2, 0.0, 1.0))


def _center_of_mass(stand: Stand, axis: int) -> AuditRow:
    """Check the shift of the trunk's centre of mass along one axis, by the moment of gravity across it."""
    spec = stand.spec
    # Along z gravity says nothing of a shift along z: there it pulls forward.
    gravity, about = ((GRAVITY, 0.0, 0.0), 4) if axis == 2 else (DOWN, 4 - axis)
    ends = np.array(stand.cfg.randomization.center_of_mass) * spec.base.size[axis] / TRUNK_LENGTH
    low, high = (stand.hanging(gravity, center_of_mass=np.eye(3)[axis] * end)[about] for end in ends)
    # The moment is r x m g: of a shift forward about +y, of one to the left about -x, of one up, pulled forward, about
    # +y.
    expected = (ends[1] - ends[0]) * spec.base.mass * GRAVITY * (-1.0 if axis == 1 else 1.0)
    return AuditRow("center_of_mass", f"moment of gravity, {'xyz'[axis]}", float((high - low) / expected))


def audit_env(cfg: TaskCfg) -> list[AuditRow]:
    """Check parameters of the task itself: pushes, encoder offsets, the ranges drawn, and derived constants."""
    quiet = replace(cfg.noise, angular_velocity=0.0, roll_pitch=0.0, joint_position=0.0, joint_velocity=0.0)
    bound, interval = cfg.randomization.push_velocity, cfg.randomization.push_interval
    every_step = replace(cfg.randomization, push_interval=cfg.control_period if interval else 0.0)
    env = LocomotionEnv(replace(cfg, noise=quiet, randomization=every_step), num_envs=512, seed=0)
    env.enter_stage(len(cfg.friction.schedule) - 1)
    obs, _, dones, _ = env.step(torch.zeros(512, env.num_actions))
    change = (obs["explicit"][:, :3] - env.linear_velocity)[~dones]
    rows = []
    if bound and interval:
        # Uniform on ±bound in two directions: the squared norm is 2 bound² / 3 on average.
        share = float(change.square().sum(-1).mean() / (2 / 3 * bound**2))
        rows.append(AuditRow("push_velocity", "change of the base's velocity", share))
    rows += _encoder_rows(env)
    rows += _range_rows(env)
    stale = max(env.fleet.stale_constants(robot) for robot in range(8))
    rows.append(AuditRow("derived constants", "agreement with a fresh model", 1.0 - stale))
    return rows


def _encoder_rows(env: LocomotionEnv) -> list[AuditRow]:
    """Check that encoder offsets reach both the observation and the joint controller."""
    offset = env.randomizer.draws.encoder_offset.double().numpy()
    if not offset.any():
        return []
    frame = env.get_observations()["proprioception"].double().numpy()
    start = sum(term.size for term in env.layout.terms[: [t.name for t in env.layout.terms].index("joint_position")])
    seen = frame[:, start : start + env.num_actions] - (env.fleet.joint_position - env.fleet.standing)
    env.compensation = None  # it would move the angle that is held, by design
    env.step(torch.zeros(env.num_envs, env.num_actions))
    held = env.fleet.targets - env.fleet.standing
    return [
        AuditRow("encoder_offset", "angle measured minus true", effect_share(seen.T, offset.T)),
        AuditRow("encoder_offset", "angle held by the controller", effect_share(held.T, -offset.T)),
    ]


def _range_rows(env: LocomotionEnv) -> list[AuditRow]:
    """Check that the draws fill their ranges: drawn span over configured span."""
    rows = []
    for name, values in vars(env.randomizer.draws).items():
        low, high = _range_of(env.cfg, name)
        if low == high:
            continue
        values = values[:, :1] / env.randomizer.com_axes[0] if name == "center_of_mass" else values
        inside = bool((values >= low - 1e-6).all() and (values <= high + 1e-6).all())
        span = float(values.max() - values.min()) / (high - low)
        rows.append(AuditRow(name, "span of the values drawn", span if inside else float("nan")))
    return rows


def _range_of(cfg: TaskCfg, name: str) -> tuple[float, float]:
    """Return the lower and the upper end of a range."""
    friction = cfg.friction
    if name == "load_coefficient":
        return friction.load or (0.0, 0.0)
    if name in NUMBERS:
        return friction.drawn_numbers.get(name, (0.0, 0.0))
    if name != "friction":
        low, high = getattr(cfg.randomization, name)
        return low, high
    (low, high), (least, most) = friction.last.range, friction.spread or (1.0, 1.0)
    return low * least, high * most


def check_randomization(cfg: TaskCfg, spec: Robot, report: Callable[[str], None] = lambda _: None) -> list[AuditRow]:
    """Return the audit of every randomised parameter; friction without a level is audited at `AUDIT_LEVEL`."""
    if cfg.friction.level is None:
        cfg = replace(cfg, friction=replace(cfg.friction, level=AUDIT_LEVEL))
    stand = Stand(spec, cfg)
    rows: list[AuditRow] = []
    audits = {"joints": audit_joints, "friction": audit_friction, "masses and ground": audit_body}
    for name, audit in audits.items():
        report(name)
        rows += audit(stand)
    report("task")
    return rows + audit_env(cfg)
