"""The friction budget: how speed falls with friction for each training method, and where a robot becomes too slow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stiction.core.statistics import t_interval
from stiction.evaluation.policies import FED, FED_BY
from stiction.evaluation.samples import Condition
from stiction.files.results import FOLLOWS
from stiction.joints.friction import has_coefficient
from stiction.robots.model import Robot
from stiction_experiments.lab.evidence import Evidence
from stiction_experiments.replication.plan import FRICTION_CELL, NOMINAL_CELL, REST_CELL, VIRTUAL_ROBOT
from stiction_experiments.replication.records import (
    FEWEST_LEVELS,
    BudgetPoint,
    ForwardPoint,
    Onset,
)

BESIDE = ("none", *FED_BY.values(), "deception")
"""Friction fed forward between the methods that it is held against."""

BARE = {VIRTUAL_ROBOT: REST_CELL, FRICTION_CELL: NOMINAL_CELL}
"""Cell with friction -> the same robot without."""


def budget(evidence: Evidence) -> list[BudgetPoint]:
    """Return the slower direction's speed ratio of every method, engine and law at every level on flat ground."""
    asked = [
        (method, Condition(engine, level, law))
        for method, engine, law in _curves(evidence)
        for level in evidence.levels(method, engine, law)
    ]
    return [point for method, condition in asked if (point := _point(evidence, method, condition)) is not None]


def beside_forward(evidence: Evidence) -> list[ForwardPoint]:
    """Return the same where friction was fed forward, of that and of what it is held against, over the same robots."""
    pairs = []
    for method, engine, law in _curves(evidence):
        for level in evidence.levels(method, engine, law) if method == FED else ():
            condition = Condition(engine, level, law)
            robots, left_out = evidence.robots(condition, *BESIDE)
            shared = evidence.on_shared_robots(condition, *BESIDE)
            points = [point for own in BESIDE if (point := _point(shared, own, condition)) is not None]
            pairs += [ForwardPoint(**vars(point), robots=len(robots), left_out=len(left_out)) for point in points]
    return pairs


def _point(evidence: Evidence, method: str, condition: Condition) -> BudgetPoint | None:
    """Return the slower direction's speed ratio of a method; None where it was not walked both ways."""
    points = list(evidence.slower(method, condition).seeds.values())
    if not points:
        return None
    low, high = t_interval(points) or (None, None)
    each = " ".join(f"{point:.4g}" for point in points)
    where = method, condition.engine, condition.law, condition.level
    return BudgetPoint(*where, len(points), float(np.mean(points)), low, high, each)


def onset_level(levels: Sequence[float], ratios: Sequence[float]) -> float | None:
    """Return the level at which the speed ratio falls under the lower end of `FOLLOWS`, interpolated between levels.

    0 where it is under from the start, None where it never is. `levels` rise from 0.
    """
    for index, ratio in enumerate(ratios):
        if ratio < FOLLOWS[0]:
            if index == 0:
                return 0.0
            above = ratios[index - 1] - FOLLOWS[0]
            share = above / (ratios[index - 1] - ratio)
            return levels[index - 1] + share * (levels[index] - levels[index - 1])
    return None


def onsets(evidence: Evidence, spec: Robot) -> list[Onset]:
    """Return where every method becomes too slow. `spec`: the robot, for the dead band of its shank.

    The onset is found for each seed and then averaged: a mean of curves has another one. A seed that stays above counts
    with the highest level that it was tested at itself, which is less than the truth; there is no interval then. A
    virtual robot without friction is the cell that has everything else; without friction nothing is fed forward.
    """
    results = []
    for method, engine, law in _curves(evidence):
        curves = [curve for curve in _by_seed(evidence, method, engine, law).values() if len(curve) >= FEWEST_LEVELS]
        if not curves:
            continue
        each = [(onset_level([*curve], [*curve.values()]), max(curve)) for curve in curves]
        above = [level is None for level, _ in each]
        ends = [last if level is None else level for level, last in each]
        level = None if all(above) else float(np.mean(ends))
        low, high = (None if any(above) else t_interval(ends)) or (None, None)
        words = " ".join(f">{last:g}" if one is None else f"{one:.3g}" for one, last in each)
        unit = spec.dead_band
        band = None if level is None or has_coefficient(law) else level * unit
        tested = min(last for _, last in each)
        results.append(Onset(method, engine, law, len(each), level, low, high, tested, words, band))
    return results


def _curves(evidence: Evidence) -> list[tuple[str, str, str]]:
    """Return method, engine and law of every curve, in the order of the rows."""
    return list(dict.fromkeys((method, engine, law) for method, engine, law, *_ in evidence.cells))


def _by_seed(evidence: Evidence, method: str, engine: str, law: str) -> dict[int, dict[float, float]]:
    """Return the slower direction's ratio of every seed at every level, from 0 on."""
    conditions = [Condition(engine, level, law) for level in evidence.levels(method, engine, law)]
    if engine in BARE and law != "coulomb":
        conditions = [Condition(BARE[engine], 0.0), *conditions]
    curves: dict[int, dict[float, float]] = {}
    for condition in conditions:
        ratios = evidence.slower(method, condition).seeds
        if not ratios and condition.level == 0.0:
            # Without friction there is nothing to feed forward: the policy walks as it is.
            ratios = evidence.slower(method.partition("+")[0], condition).seeds
        for seed, ratio in ratios.items():
            curves.setdefault(seed, {})[condition.level] = ratio
    return {seed: curve for seed, curve in curves.items() if 0.0 in curve}
