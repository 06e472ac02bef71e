"""At which friction a policy slows under 80 % of its command, and on which axis that is one number for all robots.

Candidates: friction over torque limit, f/τ_max; over the gain, f/kp, the dead band; over what the first actions ask
for, f/(kp · action scale · σ). The three differ once gains, limits and σ are varied one at a time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from stiction.formats.experiment import Collapse, Onset
from stiction.formats.results import FOLLOWS
from stiction.rma.config import TrainCfg
from stiction.robots.catalog import find_robot
from stiction.transfer.experiment.table import Table

CLEARER = 1.2
"""The best axis must beat the second by this factor in spread to count as decided: seeds move an onset by some 10 %."""

FEWEST = 3
"""Conditions needed to compare axes: two would agree on some axis by accident."""

AXES = ("f/τ_max", "f/kp [rad]", "f/(kp·scale·σ)")

CANDIDATES = {
    "direct": ("", "-strong", "-weak", "-kp05", "-kp2", "-torque2"),
    "deception": ("", "-kp05", "-kp2", "-torque2"),
}
"""Method -> endings of the conditions whose onsets are compared."""


def onset_level(levels: Sequence[float], ratios: Sequence[float]) -> float | None:
    """Return the level at which the speed ratio first slows under 80 %, the lower of `FOLLOWS`, between levels.

    That it does not says nothing of being too fast. 0 where it is under from the start, None where it never is.
    `levels` rise from 0.
    """
    for index, ratio in enumerate(ratios):
        if ratio < FOLLOWS[0]:
            if index == 0:
                return 0.0
            above = ratios[index - 1] - FOLLOWS[0]
            share = above / (ratios[index - 1] - ratio)
            return levels[index - 1] + share * (levels[index] - levels[index - 1])
    return None


def axis_scales(cfg: TrainCfg) -> dict[str, float]:
    """Return what one unit of the friction level is on each axis, for the shank, whose friction is the largest."""
    robot = find_robot(cfg.task.robot)
    shank = robot.shank
    first = shank.stiffness * robot.action_scale * cfg.network.initial_std
    return dict(zip(AXES, (1.0, shank.torque_limit / shank.stiffness, shank.torque_limit / first), strict=True))


def onsets(table: Table, configured: Mapping[str, TrainCfg]) -> list[Onset]:
    """Return the onset of the student of every condition that was evaluated. `configured`: condition -> its runs'."""
    found = []
    for method, endings in CANDIDATES.items():
        for name in (f"coulomb20-{method}{ending}" for ending in endings):
            slower = {level: list(table.slower(name, level).values()) for level in table.levels(name)}
            levels = [level for level, values in slower.items() if values]
            if levels and name in configured:
                level = onset_level(levels, [float(np.mean(slower[level])) for level in levels])
                found.append(Onset(name, method, level, axis_scales(configured[name])))
    return found


def collapse(method: str, found: Sequence[Onset]) -> Collapse:
    """Return the axis on which the onsets of one method's conditions have the smallest ratio of largest to smallest."""
    own = [onset for onset in found if onset.method == method]
    if len(own) < FEWEST:
        return Collapse(method, {}, None, f"not decided: {len(own)} conditions, at least {FEWEST} are needed")
    without = [onset.condition for onset in own if not onset.level]
    if without:
        where = ", ".join(without)
        return Collapse(method, {}, None, f"not decided: no onset between the tested levels for {where}")
    spread = {axis: _ratio([onset.on(axis) or 0.0 for onset in own]) for axis in AXES}
    best, second = sorted(AXES, key=spread.__getitem__)[:2]
    text = f"spread {spread[best]:.2f} on {best}, {spread[second]:.2f} on {second}"
    if spread[second] < CLEARER * spread[best]:
        return Collapse(method, spread, None, f"not decided: {text}, too close to tell")
    return Collapse(method, spread, best, f"{text}, over {len(own)} conditions")


def _ratio(values: Sequence[float]) -> float:
    """Return the largest over the smallest."""
    return max(values) / min(values)
