"""The criteria of what the paper concludes, and of explanations: where friction is felt, and if it is the cause."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stiction.formats.results import FOLLOWS
from stiction.transfer.experiment.judging import Finding, all_of, over_levels
from stiction.transfer.experiment.table import Points
from stiction.transfer.grid.config import BATCH
from stiction.transfer.grid.plan import REAL
from stiction.transfer.replication.agreement import Measured, larger_paired, within
from stiction.transfer.replication.criteria import Judge, everywhere, stands
from stiction.transfer.replication.evidence import Evidence, Spot
from stiction.transfer.replication.frictions import BENCHED, LOADED, over_frictions
from stiction.transfer.replication.plan import FRICTION, PAPER, REST, ROBOT

NOTICEABLE = 0.1
"""Loss of speed ratio that one notices."""


def loses(way: str, level: float) -> Judge:
    """A way loses a noticeable part of its speed up to a level, in other engines, policy by policy."""
    return lambda e: everywhere(e, way, lambda spot: _lost(e, way, spot), level)


def loses_at_each_level(way: str, engine: str) -> Judge:
    """The same in one engine, level by level."""

    def judge(e: Evidence) -> Finding:
        spots = [Spot(engine, level) for level in e.levels(way, engine) if level > 0]
        if not spots:
            return Finding("not tested", f"{way} was not walked with friction in {engine}")
        return over_levels([(spot.level, _lost(e, way, spot)) for spot in spots])

    return judge


def _lost(e: Evidence, way: str, spot: Spot) -> Finding:
    """Judge what a way lost of its speed ratio between no friction and a spot."""
    lost = _less(e.slower(way, replace(spot, level=0.0)).seeds, e.slower(way, spot).seeds)
    return within(f"{way}, speed ratio lost", Measured(lost), NOTICEABLE, np.inf)


def friction_is_the_cause(e: Evidence) -> Finding:
    """Friction alone leaves the conventional policy slower than all other differences alone, policy by policy."""
    rest = e.slower("none", Spot(REST, 0.0))

    def at(spot: Spot) -> Finding:
        return larger_paired(("all but friction", rest), ("friction alone", e.slower("none", spot)))

    return over_frictions(e, "none", FRICTION, at)


def _less(first: Points, second: Points) -> Points:
    """Return the differences of seeds that both have."""
    return {seed: first[seed] - second[seed] for seed in sorted(first.keys() & second.keys())}


def lower_is_better(e: Evidence) -> Finding:
    """Half of the friction leaves the conventional policy nearer to the command."""
    high, low = (e.error("none", Spot(ROBOT, level, REAL)) for level in (0.2, 0.1))
    return larger_paired(("none at 0.2", high), ("at 0.1", low))


def frozen_by(law: str) -> Judge:
    """The paper's number as a coefficient stops a policy that never met friction: it stands, and does not lie."""
    return lambda e: stands(e, "none", Spot(BATCH, PAPER, law))


def load_above_bench(e: Evidence) -> Finding:
    """The bench's friction does not trouble the conventional policy, a share of the load does."""
    levels = {law: level for w, at, law, level, *_ in e.cells if (w, at) == ("none", ROBOT) and law.startswith(REAL)}
    asked: Sequence[tuple[str, bool]] = ((BENCHED, False), (f"{BENCHED}{LOADED}0.1", True))
    if any(law not in levels for law, _ in asked):
        return Finding("not tested", "the virtual robot was not walked at the bench's friction with 0.1 of the load")
    return all_of(*(_slow_or_not(e, Spot(ROBOT, levels[law], law), slow) for law, slow in asked))


def _slow_or_not(e: Evidence, spot: Spot, slow: bool) -> Finding:
    """Judge that the conventional policy is too slow in its slower direction, or that it is not, however fast."""
    ends = (-np.inf, FOLLOWS[0]) if slow else (FOLLOWS[0], np.inf)
    return within(f"none at {spot.law} {spot.level:g}", e.slower("none", spot), *ends)
