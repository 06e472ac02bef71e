"""Onset and standstill of a policy: the frictions at which its fast commands fall below 0.8, and below half."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from statistics import fmean
from typing import Any

import numpy as np

from stiction.evaluation.evaluate import ENGINE, EvaluationCfg, batch_policy, make_rollout
from stiction.files.bundle import Bundle
from stiction.files.contract import robot_of
from stiction.files.onset import LEAST, STANDS, Motion, motion_of, predict_standstill
from stiction.files.results import ResultRow
from stiction.files.velocity import parse_command
from stiction.virtual.drive import drive

EPISODES = 4
"""Largest number of walks per command from which a policy's onset is predicted."""

MOVED = 0.2
"""Least reach without friction by which the reach under friction is divided [1]: a robot that stands has none."""

HALF = 0.5
"""Least share of the largest command on some axis for a fast command [1]: slower ones are hard without friction."""


def fast_commands(labels: Sequence[str]) -> tuple[str, ...]:
    """Return the fast commands of a set: at least `HALF` of the largest value on some axis."""
    speeds = np.abs([parse_command(text).velocity for text in labels]).reshape(-1, 3)
    fast = ((speeds >= HALF * speeds.max(axis=0, initial=0.0)) & (speeds > 0.0)).any(axis=1)
    return tuple(text for text, counts in zip(labels, fast, strict=True) if counts)


def reach_by_level(
    cells: Mapping[tuple[float, str], float], over: Callable[[list[float]], float] = min, relative: bool = False
) -> dict[float, float]:
    """Return level -> the smallest reach over its commands [1], or their mean; levels upward.

    cells: level and command -> reach; over: reduction over the commands; relative: True to divide each reach by that of
    the same command without friction; commands below `MOVED` there are left out.
    """
    shares: dict[float, list[float]] = {}
    for (level, command), reach in sorted(cells.items()):
        free = cells[0.0, command] if relative else 1.0
        if not relative or free >= MOVED:
            shares.setdefault(level, []).append(reach / free)
    return {level: over(each) for level, each in shares.items()}


def onset(reach: Mapping[float, float], least: float = LEAST) -> float | None:
    """Return the friction at which the reach first falls below `least`, interpolated between levels.

    reach: level -> reach, levels upward from 0. Linear from 0 to the next level, then in the logarithm of the friction.
    None where the reach is below `least` at level 0, or at no level.
    """
    levels = list(reach)
    first = next((number for number, level in enumerate(levels) if reach[level] < least), None)
    if not first:
        return None
    low, high = levels[first - 1], levels[first]
    share = (reach[low] - least) / (reach[low] - reach[high])
    return share * high if low == 0.0 else low * (high / low) ** share


@dataclass(frozen=True)
class Reaches:
    """Reach of one policy over friction: level -> reach [1], three times."""

    worst: Mapping[float, float]
    """Reach of the worst command."""
    relative: Mapping[float, float]
    """Reach of the worst command, each over that of the same command without friction."""
    mean: Mapping[float, float]
    """Mean of those."""

    @property
    def walked_enough(self) -> bool:
        """True if more friction tells nothing: all three have fallen, or were under it without friction."""
        ends = ((self.worst, LEAST), (self.relative, LEAST), (self.mean, STANDS))
        return all(min(reach.values(), default=0.0) < least for reach, least in ends)


def reaches_by_cell(cells: Mapping[tuple[float, str], float]) -> Reaches:
    """Return what a policy reaches. cells: level, 0 among them, and command -> reach [1]."""
    mean = reach_by_level(cells, fmean, relative=True)
    return Reaches(reach_by_level(cells), reach_by_level(cells, relative=True), mean)


def walked_onset(rows: Sequence[ResultRow]) -> dict[str, float | None]:
    """Return a policy's `onset` and `standstill` in the training's simulator, and what was walked.

    Both are by the reach over that without friction. They are None where no level shows them, where level 0 was not
    walked, and of a robot that stands without friction. `free` is the mean reach without friction of the commands that
    count, None where level 0 was not walked and 0 where it stands; `to` is the highest level walked, None without rows.
    """
    cells = {
        (row.friction_level, row.command): min(ratios)
        for row in rows
        if (row.engine, row.terrain, row.friction_law) == (ENGINE, "flat", "coulomb")
        and row.mean_velocity is not None
        and (ratios := parse_command(row.command).axis_ratios(row.mean_velocity))
    }
    fast = fast_commands(list(dict.fromkeys(command for _, command in cells)))
    cells = {cell: reach for cell, reach in cells.items() if cell[1] in fast}
    walked: dict[str, float | None] = {"onset": None, "standstill": None, "free": None}
    walked["to"] = max((level for level, _ in cells), default=None)
    if not any(level == 0.0 for level, _ in cells):
        return walked
    reaches = reaches_by_cell(cells)
    free = fmean([reach for (level, _), reach in cells.items() if level == 0.0 and reach >= MOVED] or [0.0])
    return walked | {"onset": onset(reaches.relative), "standstill": onset(reaches.mean, STANDS), "free": free}


def onset_of(bundle: Bundle, rows: Sequence[ResultRow], cfg: EvaluationCfg) -> dict[str, Any]:
    """Return the standstill of a policy, `predicted` from its walks without friction, and its onset too, as `walked`.

    rows: of the policy; cfg: commands of its whole range, episodes and seconds; at most `EPISODES` walks per command.
    """
    fast, episodes = fast_commands(cfg.commands), min(cfg.episodes, EPISODES)
    motion = walk_motion(bundle, replace(cfg, friction_levels=(0.0,), commands=fast, episodes=episodes))
    return {"predicted": asdict(predict_standstill(bundle.contract, motion)), "walked": walked_onset(rows)}


def walk_motion(bundle: Bundle, cfg: EvaluationCfg, threads: int = 1) -> Motion:
    """Walk a policy and return the motion of its joints; cfg: without friction."""
    contract, spec = bundle.contract, robot_of(bundle.contract)
    policy = batch_policy(bundle, spec, cfg, cfg.friction(contract))
    rollout = make_rollout(policy, contract, spec, cfg, threads)
    first, seen = round(cfg.settle / contract.control_period), []
    for number, step in enumerate(drive(rollout, cfg.robot_commands, round(cfg.seconds / contract.control_period))):
        if number >= first:
            fleet = rollout.fleet
            signals = (step.policy.target, fleet.joint_position, fleet.joint_velocity, fleet.torque)
            seen.append([signal.copy() for signal in signals])
    return motion_of(*(np.array(signal) for signal in zip(*seen, strict=True)))
