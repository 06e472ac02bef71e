"""A sentence over all frictions of a virtual robot: the axis of the torque limit, and the load's beside the bench's."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from stiction.transfer.experiment.judging import Finding, over_levels
from stiction.transfer.grid.plan import REAL
from stiction.transfer.replication.evidence import Evidence, Spot

BENCHED = f"{REAL}-bench"
"""Law of what the paper's bench measured, as in results.csv."""

LOADED = "+load"
"""In the name of a law what stands before the coefficient of the load."""


def over_frictions(e: Evidence, way: str, engine: str, judge: Callable[[Spot], Finding]) -> Finding:
    """Judge a sentence that names no level at every friction of virtual robots: where a way was not walked and others
    were, the evidence says so.

    Shares of the torque limit and the bench's value are one axis, and so is the load's coefficient for each of those
    that it was added to: which of 0.1 of the load and 10 % of the torque limit is more depends on the walk.
    """
    if not e.frictions(way, engine):
        return Finding("not tested", f"{way} was not walked with friction in {engine}")
    axes: dict[tuple[str, float], list[tuple[float, Finding]]] = {}
    bench = ""
    spots = {spot for other in e.ways() for spot in e.frictions(other, engine)}
    for spot in sorted(spots, key=lambda spot: (_load(spot), spot.level, spot.law)):
        found = judge(spot)
        if spot.law == BENCHED:
            bench = f"; at the bench's value, {spot.level:g}: {found.outcome}, {found.evidence}"
        load = _load(spot)
        base = (spot.law.partition(LOADED)[0], spot.level) if load else ("", 0.0)
        axes.setdefault(base, []).append((load or spot.level, found))
    judged = [_named(base, over_levels(findings)) for base, findings in axes.items()]
    together = together_over_axes(judged)
    return Finding(together.outcome, together.evidence + bench)


def _load(spot: Spot) -> float:
    """Return the coefficient of the load, 0 without."""
    return float(spot.law.partition(LOADED)[2] or 0.0)


def _named(base: tuple[str, float], found: Finding) -> Finding:
    """Return the finding of an axis; that of a load says so, and what it is added to."""
    law, level = base
    if not law:
        return found
    of = "the bench's value" if law == BENCHED else f"{level:g}"
    return Finding(found.outcome, f"load beside {of}: {found.outcome}, {found.evidence}")


def together_over_axes(findings: Sequence[Finding]) -> Finding:
    """Judge a sentence on several axes: as on all that were tested, or within limits where it has them on some.

    So it reproduces where it does on each, `only above x` where it does so on one and nothing else is said but that it
    holds throughout, or nowhere, on another; what contradicts is undecided.
    """
    evidence = "; ".join(finding.evidence for finding in findings)
    outcomes = {finding.outcome for finding in findings} - {"not tested"}
    if not outcomes:
        return Finding("not tested", evidence)
    limited = outcomes - {"reproduces", "does not"}
    decided = limited if limited and len(outcomes - limited) < 2 else outcomes
    return Finding(next(iter(decided)) if len(decided) == 1 else "undecided", evidence)
