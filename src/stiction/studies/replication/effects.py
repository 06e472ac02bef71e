"""What friction does to policies that were trained without it: the evidence behind the verdicts of `identify`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stiction.core.statistics import t_interval
from stiction.evaluate.samples import Condition, Evidence
from stiction.formats.advice import FrictionEffect
from stiction.formats.results import FOLLOWS
from stiction.studies.replication.budget import BARE
from stiction.studies.replication.records import CAUSES, SHARES, Onset, Replication


def friction_effects(result: Replication, method: str = "none") -> tuple[FrictionEffect, ...]:
    """Return what friction did in every engine, and on the virtual robots, where its level is a share of the torque
    limit.
    """
    evidence = Evidence.of(row for part in result.parts for row in part.details)
    unit = result.summary["dead_band"]
    found = []
    for onset in result.onsets:
        if onset.method == method and onset.friction_law in SHARES and onset.engine not in CAUSES:
            found.append(_effect(evidence, onset, unit))
    return tuple(found)


def _effect(evidence: Evidence, onset: Onset, unit: float) -> FrictionEffect:
    """Return the effect in one engine. unit: dead band per level [rad]."""
    method, engine, law = onset.method, onset.engine, onset.friction_law
    levels = [level for level in evidence.levels(method, engine, law) if level > 0]
    bare = evidence.slower(method, Condition(BARE.get(engine, engine), 0.0)).seeds
    speeds = {level: evidence.slower(method, Condition(engine, level, law)).seeds for level in levels}
    losses = {
        level: [bare[seed] - speed for seed, speed in own.items() if seed in bare] for level, own in speeds.items()
    }
    noticeable = next((level for level in levels if (ends := t_interval(losses[level])) and ends[0] > 0), None)
    return FrictionEffect(
        engine=engine,
        seeds=onset.seeds,
        frictionless_speed=float(np.mean(list(bare.values()))),
        noticeable=noticeable,
        speed_loss=None if noticeable is None else float(np.mean(losses[noticeable])),
        dead_band=None if noticeable is None else round(noticeable * unit, 9),
        onset=onset.level,
        severe=next((level for level in levels if _all_slow(speeds[level])), None),
    )


def _all_slow(speeds: Mapping[int, float]) -> bool:
    """Return whether every seed is too slow to follow."""
    return bool(speeds) and max(speeds.values()) < FOLLOWS[0]
