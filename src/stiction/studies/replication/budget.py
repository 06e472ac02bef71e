"""The friction budget: how speed falls with friction for each training method, and where it slows under 80 %."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stiction.core.statistics import t_interval
from stiction.evaluate.methods import FED, FORWARD
from stiction.evaluate.samples import Condition, Evidence
from stiction.joints.friction import has_coefficient
from stiction.robots.model import Robot
from stiction.studies.friction.evaluation import onset_level
from stiction.studies.replication.plan import FRICTION, NOMINAL, REST, ROBOT
from stiction.studies.replication.records import FEWEST_LEVELS, BudgetPoint, ForwardPoint, Onset

BESIDE = ("none", FED, "deception")
"""Friction fed forward between the methods that it is held against."""


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
    found = []
    for method, engine, law in _curves(evidence):
        for level in evidence.levels(method, engine, law) if method == FED else ():
            condition = Condition(engine, level, law)
            robots, left_out = evidence.robots(condition, *BESIDE)
            shared = evidence.on_shared_robots(condition, *BESIDE)
            points = [point for own in BESIDE if (point := _point(shared, own, condition)) is not None]
            found += [ForwardPoint(**vars(point), robots=len(robots), left_out=len(left_out)) for point in points]
    return found


def _point(evidence: Evidence, method: str, condition: Condition) -> BudgetPoint | None:
    """Return the slower direction's speed ratio of a method; None where it was not walked both ways."""
    points = list(evidence.slower(method, condition).seeds.values())
    if not points:
        return None
    low, high = t_interval(points) or (None, None)
    each = " ".join(f"{point:.4g}" for point in points)
    where = method, condition.engine, condition.law, condition.level
    return BudgetPoint(*where, len(points), float(np.mean(points)), low, high, each)


def onsets(evidence: Evidence, spec: Robot) -> list[Onset]:
    """Return where every method slows under 80 % of the command. `spec`: the robot, for the dead band of its shank.

    The onset is found for each seed and then averaged: a mean of curves has another one. A seed that stays above counts
    with the highest level that it was tested at itself, which is less than the truth; there is no interval then. A
    virtual robot without friction is the cell that has everything else; without friction nothing is fed forward.
    """
    found = []
    for method, engine, law in _curves(evidence):
        curves = [curve for curve in _by_seed(evidence, method, engine, law).values() if len(curve[0]) >= FEWEST_LEVELS]
        if not curves:
            continue
        each, last = [onset_level(*curve) for curve in curves], [levels[-1] for levels, _ in curves]
        above = [level is None for level in each]
        ends = [end if level is None else level for level, end in zip(each, last, strict=True)]
        level = None if all(above) else float(np.mean(ends))
        low, high = (None if any(above) else t_interval(ends)) or (None, None)
        words = " ".join(f">{end:g}" if one is None else f"{one:.3g}" for one, end in zip(each, last, strict=True))
        unit = spec.shank.torque_limit / spec.shank.stiffness
        band = None if level is None or has_coefficient(law) else level * unit
        found.append(Onset(method, engine, law, len(each), level, low, high, min(last), words, band))
    return found


def _curves(evidence: Evidence) -> list[tuple[str, str, str]]:
    """Return method, engine and law of every curve, in the order of the rows."""
    return list(dict.fromkeys((method, engine, law) for method, engine, law, *_ in evidence.cells))


BARE = {ROBOT: REST, FRICTION: NOMINAL}
"""Cell with friction -> the same robot without."""


def _by_seed(
    evidence: Evidence, method: str, engine: str, law: str
) -> dict[int, tuple[Sequence[float], Sequence[float]]]:
    """Return levels from 0 on and the slower direction's ratios of every seed."""
    conditions = [Condition(engine, level, law) for level in evidence.levels(method, engine, law)]
    if engine in BARE and law != "coulomb":
        conditions = [Condition(BARE[engine], 0.0), *conditions]
    curves: dict[int, tuple[list[float], list[float]]] = {}
    for condition in conditions:
        ratios_of = evidence.slower(method, condition).seeds
        if not ratios_of and condition.level == 0.0:
            ratios_of = evidence.slower(method.removesuffix(FORWARD), condition).seeds
        for seed, ratio in ratios_of.items():
            levels, ratios = curves.setdefault(seed, ([], []))
            levels.append(condition.level)
            ratios.append(ratio)
    return {seed: curve for seed, curve in curves.items() if curve[0][0] == 0.0}
