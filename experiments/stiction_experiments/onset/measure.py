"""Walks a policy under more and more friction until it no longer follows, and measures what its joints do without.

The criteria are in `results/onset/criteria.md`, and older than every row.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from stiction.core.records import column
from stiction.evaluation.course import SETTLE
from stiction.evaluation.evaluate import EvaluationCfg, batch_policy, evaluate_bundle, make_rollout
from stiction.evaluation.policies import method_of
from stiction.evaluation.rollout import friction_at
from stiction.evaluation.summary import commands_for
from stiction.files.bundle import Bundle
from stiction.files.contract import robot_of
from stiction.files.velocity import parse_command
from stiction.robots.model import GRAVITY, Robot
from stiction.virtual.drive import drive, unheard

LEAST = 0.8
"""Share of the command under which a policy no longer follows [1]."""

GRID = (0.0, *(0.01 * 2 ** (step / 2) for step in range(13)))
"""Friction at which a policy is walked, as a share of the torque limit: none, and 1 to 64 % by factors of √2."""

AT_ONCE = 3
"""Levels that are walked in one batch: those behind the onset are for nothing."""

HALF = 0.5
"""Share of its range that a command has on some axis to count: slower ones are hard without friction already [1]."""

EPISODES, SECONDS = 4, 10.0


@dataclass(frozen=True)
class ReachRow:
    """One policy under one friction and one command."""

    policy: str
    friction_level: float
    """Friction over the torque limit [1]."""
    command: str
    reach: float
    """Smallest ratio of mean velocity to command, over the commanded axes; a walk that fell counts as zero [1]."""
    falls: int
    """Walks that fell."""
    jitter: float
    """Root mean square of joint acceleration, by control period [rad/s²]."""


@dataclass(frozen=True)
class OnsetRow:
    """Where one policy stops following, and what makes an axis of it.

    The last eleven are the friction on an axis per friction over torque limit: the onset times it is the onset there.
    """

    policy: str = field(metadata=column("policy"))
    robot: str = field(metadata=column("robot"))
    method: str = field(metadata=column("method"))
    seed: int = field(metadata=column("seed"))
    digest: str
    """Of the policy."""
    reach: float = field(metadata=column("reach without friction", form=".2f"))
    """Of the worst command [1]."""
    onset: float | None = field(metadata=column("onset", "%", form=".1%"))
    """Friction over torque limit at which the worst reach falls under 0.8 [1]; None: it is under it without friction,
    or still over it at the end of the grid."""
    relative_onset: float | None = field(metadata=column("onset of 0.8 of the reach without friction", "%", form=".1%"))
    """The same, where each reach is over that of the same command without friction."""
    torque_limit: float
    """1 [1]."""
    dead_band_worst: float
    """f/kp per level, largest over joints [rad]."""
    dead_band_mean: float
    """Its mean over joints [rad]."""
    targets_worst: float
    """f over kp times the rms of the targets about their mean, per level [1]."""
    targets_mean: float
    motion_worst: float
    """f over kp times the rms of the angles about their mean, per level [1]."""
    motion_mean: float
    torque_worst: float
    """f over the rms of the motor torque, per level [1]."""
    torque_mean: float
    weight_worst: float
    """f over weight times standing height, per level [1]."""
    weight_mean: float


@dataclass(frozen=True)
class Motion:
    """What joints do in walking, each a root mean square over walks, shape (J,)."""

    targets: np.ndarray
    """Of the policy's targets about their mean over a walk [rad]."""
    angles: np.ndarray
    """Of the angles about their mean over a walk [rad]."""
    torque: np.ndarray
    """Of the motors' torque [N m]."""


def commands_of(bundle: Bundle) -> tuple[str, ...]:
    """Return the labels of the commands that count: of the set, scaled to the policy, the half of it that is fast."""
    labels = commands_for([bundle])
    speeds = np.abs([parse_command(text).velocity for text in labels])
    fast = ((speeds >= HALF * speeds.max(axis=0)) & (speeds > 0.0)).any(axis=1)
    return tuple(text for text, counts in zip(labels, fast, strict=True) if counts)


def reaches(bundle: Bundle, levels: Sequence[float], commands: tuple[str, ...], threads: int = 1) -> list[ReachRow]:
    """Walk a policy under frictions and commands, in one batch."""
    cfg = EvaluationCfg(tuple(levels), commands, EPISODES, SECONDS)
    found = evaluate_bundle(bundle, cfg, threads=threads)
    rows = []
    for row, walks in zip(found.rows, found.episodes, strict=True):
        command = np.array(parse_command(row.command).velocity)
        stood = [np.array(walk.mean_velocity) * (walk.fall_rate == 0.0) for walk in walks]
        asked = command != 0.0
        reach = float((np.mean(stood, axis=0)[asked] / command[asked]).min())
        falls = sum(walk.fall_rate > 0.0 for walk in walks)
        rows.append(ReachRow(bundle.name, row.friction_level, row.command, reach, falls, row.joint_jitter))
    return rows


def worst(rows: Sequence[ReachRow], relative: bool = False) -> dict[float, float]:
    """Return level -> the smallest reach of its commands; `relative`: each over that without friction [1]."""
    free = {row.command: max(row.reach, 1e-9) for row in rows if row.friction_level == 0.0}
    found: dict[float, float] = {}
    for row in rows:
        reach = row.reach / free[row.command] if relative else row.reach
        found[row.friction_level] = min(reach, found.get(row.friction_level, math.inf))
    return dict(sorted(found.items()))


def onset(reach: dict[float, float]) -> float | None:
    """Return the friction at which the reach falls under `LEAST` for the first time, between levels interpolated.

    reach: level -> worst reach, levels upward from 0. Linear from 0 to the next level, then in the logarithm of the
    friction. None where it is under it at 0, or at no level.
    """
    levels = list(reach)
    first = next((number for number, level in enumerate(levels) if reach[level] < LEAST), None)
    if not first:
        return None
    low, high = levels[first - 1], levels[first]
    share = (reach[low] - LEAST) / (reach[low] - reach[high])
    return share * high if low == 0.0 else low * (high / low) ** share


def walk_motion(bundle: Bundle, commands: tuple[str, ...], threads: int = 1) -> Motion:
    """Walk a policy without friction and return what its joints do."""
    contract, spec = bundle.contract, robot_of(bundle.contract)
    cfg = EvaluationCfg((0.0,), commands, EPISODES, SECONDS)
    policy = batch_policy(bundle, spec, cfg, friction_at(contract, cfg.robot_levels))
    rollout = make_rollout(policy, contract, spec, cfg, threads)
    steps = round(cfg.seconds / contract.control_period)
    first, seen = round(SETTLE / contract.control_period), []
    for number, step in enumerate(drive(rollout, cfg.robot_commands, steps)):
        if number >= first:
            seen.append((step.policy.target.copy(), rollout.fleet.joint_position.copy(), rollout.fleet.torque.copy()))
    targets, angles, torque = (np.array(signal) for signal in zip(*seen, strict=True))
    return Motion(rms(targets - targets.mean(axis=0)), rms(angles - angles.mean(axis=0)), rms(torque))


def rms(signal: np.ndarray) -> np.ndarray:
    """Return the root mean square over steps and walks, shape (T, N, J) -> (J,)."""
    return np.sqrt(np.square(signal).mean(axis=(0, 1)))


def axes(robot: Robot, kp: np.ndarray, limit: np.ndarray, motion: Motion) -> dict[str, float]:
    """Return what each axis is per friction over torque limit, by its name in `OnsetRow`.

    kp: gains [N m/rad]; limit: torque limits [N m], both (J,).
    """
    found = {"torque_limit": 1.0}
    by_joint = {
        "dead_band": limit / kp,
        "targets": limit / (kp * motion.targets),
        "motion": limit / (kp * motion.angles),
        "torque": limit / motion.torque,
        "weight": limit / (robot.mass * GRAVITY * robot.standing_height),
    }
    for name, values in by_joint.items():
        found |= {f"{name}_worst": float(values.max()), f"{name}_mean": float(values.mean())}
    return found


def walk_onset(
    bundle: Bundle, threads: int = 1, progress: Callable[[float], None] = unheard
) -> tuple[OnsetRow, list[ReachRow]]:
    """Return where a policy stops following, with all that it reached on the way. progress: share that is done [1]."""
    contract, commands = bundle.contract, commands_of(bundle)
    rows: list[ReachRow] = []
    for begin in range(0, len(GRID), AT_ONCE):
        rows += reaches(bundle, GRID[begin : begin + AT_ONCE], commands, threads)
        progress((begin + AT_ONCE) / (len(GRID) + AT_ONCE))
        if all(min(worst(rows, relative).values()) < LEAST for relative in (False, True)):
            break
    reach, motion = worst(rows), walk_motion(bundle, commands, threads)
    progress(1.0)
    row = OnsetRow(
        bundle.name,
        contract.robot,
        method_of(contract),
        contract.seed,
        bundle.digest,
        reach[0.0],
        onset(reach),
        onset(worst(rows, relative=True)),
        **axes(robot_of(contract), contract.array("kp"), contract.array("torque_limit"), motion),
    )
    return row, rows
