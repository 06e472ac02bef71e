"""Walks a policy under more and more friction until it no longer follows, and measures what its joints do without.

The criteria are in `results/onset/criteria.md`, and older than every row.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stiction.core.records import column
from stiction.evaluation.evaluate import EvaluationCfg, evaluate_bundle
from stiction.evaluation.onset import Reaches, fast_commands, onset, reaches_by_cell, walk_motion
from stiction.evaluation.policies import method_of
from stiction.evaluation.summary import commands_for
from stiction.files.bundle import Bundle
from stiction.files.contract import robot_of
from stiction.files.onset import STANDS, axes
from stiction.files.velocity import parse_command
from stiction.virtual.drive import ignore_progress

GRID = (0.0, *(0.01 * 2 ** (step / 2) for step in range(13)))
"""Friction at which a policy is walked, as a share of the torque limit: none, and 1 to 64 % by factors of √2."""

EPISODES, SECONDS = 4, 10.0
"""Walks of a cell, and their length [s]."""

AT_ONCE = 3
"""Levels that are walked in one batch: those behind the onset are for nothing."""


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

    The last twelve are the friction on an axis per friction over torque limit: the onset times it is the onset there.
    """

    policy: str = field(metadata=column("policy"))
    robot: str = field(metadata=column("robot"))
    method: str = field(metadata=column("method"))
    seed: int = field(metadata=column("seed"))
    digest: str
    """Digest of the policy."""
    reach: float = field(metadata=column("reach without friction", form=".2f"))
    """Reach of the worst command [1]."""
    onset: float | None = field(metadata=column("onset", "%", form=".1%"))
    """Friction over torque limit at which the worst reach falls under 0.8 [1]; None: it is under it without friction,
    or still over it at the end of the grid."""
    relative_onset: float | None = field(metadata=column("onset of 0.8 of the reach without friction", "%", form=".1%"))
    """The same, where each reach is over that of the same command without friction."""
    standstill: float | None = field(metadata=column("half of the mean reach without friction", "%", form=".1%"))
    """Where the mean reach, each over that without friction, falls under 0.5 [1]."""
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
    work: float
    """Work against friction over the work of the motors, summed over joints, per level [1]."""


def reaches(bundle: Bundle, levels: Sequence[float], commands: tuple[str, ...], threads: int = 1) -> list[ReachRow]:
    """Walk a policy under frictions and commands, in one batch."""
    cfg = EvaluationCfg(tuple(levels), commands, EPISODES, SECONDS)
    evaluated = evaluate_bundle(bundle, cfg, threads=threads)
    rows = []
    for row, walks in zip(evaluated.rows, evaluated.episodes, strict=True):
        command = np.array(parse_command(row.command).velocity)
        stood = [np.array(walk.mean_velocity) * (walk.fall_rate == 0.0) for walk in walks]
        asked = command != 0.0
        # As in the table: what is judged from there later is then the same to the last digit.
        reach = float(f"{(np.mean(stood, axis=0)[asked] / command[asked]).min():.9g}")
        falls = sum(walk.fall_rate > 0.0 for walk in walks)
        rows.append(ReachRow(bundle.name, row.friction_level, row.command, reach, falls, row.joint_jitter))
    return rows


def reaches_of(rows: Sequence[ReachRow]) -> Reaches:
    """Return what a policy reaches by its rows."""
    return reaches_by_cell({(row.friction_level, row.command): row.reach for row in rows})


def readings(rows: Sequence[ReachRow]) -> dict[str, Any]:
    """Return the columns of `OnsetRow` that a policy's rows decide: its reach, and the three frictions."""
    reach = reaches_of(rows)
    return {
        "reach": reach.worst[0.0],
        "onset": onset(reach.worst),
        "relative_onset": onset(reach.relative),
        "standstill": onset(reach.mean, STANDS),
    }


def walk_onset(
    bundle: Bundle,
    before: Sequence[ReachRow] = (),
    threads: int = 1,
    progress: Callable[[float], None] = ignore_progress,
) -> tuple[OnsetRow, list[ReachRow]]:
    """Return where a policy stops following and where it stands still, with all that it reached on the way.

    before: what it reached already, of the lowest levels; progress: share that is done [1].
    """
    contract, commands, rows = bundle.contract, fast_commands(commands_for([bundle])), [*before]
    levels = GRID[len({row.friction_level for row in rows}) :]
    while levels and not (rows and reaches_of(rows).walked_enough):
        rows += reaches(bundle, levels[:AT_ONCE], commands, threads)
        levels = levels[AT_ONCE:]
        progress(1.0 - (len(levels) + 1) / (len(GRID) + 1))
    motion = walk_motion(bundle, EvaluationCfg((0.0,), commands, EPISODES, SECONDS), threads)
    progress(1.0)
    row = OnsetRow(
        bundle.name,
        contract.robot,
        method_of(contract),
        contract.seed,
        bundle.digest,
        **readings(rows),
        **axes(robot_of(contract), contract.array("kp"), contract.array("torque_limit"), motion),
    )
    return row, rows
