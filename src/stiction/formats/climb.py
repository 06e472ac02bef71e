"""How high a policy climbs: one row per policy, friction level and step height, and what follows from the rows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import sqrt

ENOUGH = 0.8
"""Share of trials that must succeed for a height to count as climbed."""


@dataclass(frozen=True)
class Climb:
    """What a policy reached at one height and level."""

    policy: str
    """Name of the bundle."""
    friction_level: float
    """Dry friction as a fraction of each joint's torque limit [-]."""
    step_height: float
    """[m]."""
    trials: int
    """Number of robots."""
    successes: int
    """... that went over the landing and left the last step behind."""
    falls: int
    """... that fell before, or whose simulation became unstable."""
    steps_climbed: float
    """Mean number of steps passed, up and down."""
    seconds: float | None
    """Median time of those that succeeded [s]; None where none did."""


def wilson(successes: float, trials: int, quantile: float = 1.959964) -> tuple[float, float]:
    """Return Wilson's 95 % interval of a share (Wilson 1927): it holds near 0 and 1, where the usual one fails.

    successes: a mean of clusters makes them a fraction. trials: at least one.
    """
    share, square = successes / trials, quantile**2
    centre = (share + square / (2 * trials)) / (1 + square / trials)
    half = quantile / (1 + square / trials) * sqrt(share * (1 - share) / trials + square / (4 * trials**2))
    return max(0.0, centre - half), min(1.0, centre + half)


def highest_climbed(rows: Iterable[Climb]) -> Climb | None:
    """Return the row of the greatest height up to which every tested one was climbed by `ENOUGH`, or None.

    rows: of one policy and level.
    """
    best = None
    for row in sorted(rows, key=lambda row: row.step_height):
        if row.successes < ENOUGH * row.trials:
            break
        best = row
    return best
