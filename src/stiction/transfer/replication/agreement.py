"""The rules of `judging` for what was measured on virtual robots: training seeds decide, and robots must agree.

All policies walk on the same virtual robots. So an interval over seeds says what another training would come to on
these robots, and nothing of other robots; one over robots says that, of these trainings.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from stiction.transfer.experiment import judging
from stiction.transfer.experiment.judging import ABOVE_ZERO, Finding, confirmed
from stiction.transfer.experiment.table import Points
from stiction.transfer.statistics import t_interval


@dataclass(frozen=True)
class Measured:
    """One number of a way of training at one spot."""

    seeds: Points
    """Training seed -> value, of virtual robots the mean over them."""
    robots: Points = field(default_factory=dict)
    """Virtual robot -> mean over the seeds; none on the robot of the data sheet, or where only the mean is known."""


Labelled = tuple[str, Measured]
"""What it is called in the evidence, and the number."""


def within(label: str, measured: Measured, low: float, high: float) -> Finding:
    """Judge that the mean lies within [low, high], over seeds and over robots."""
    return _agreed(judging.within(label, measured.seeds, low, high), measured.robots, low, high)


def larger(first: Labelled, second: Labelled) -> Finding:
    """Judge that the first mean is larger, over seeds by Welch's interval, over robots by that of the differences."""
    found = judging.larger(*((label, measured.seeds) for label, measured in (first, second)))
    return _agreed(found, _differences(first[1], second[1]), ABOVE_ZERO, np.inf)


def larger_paired(first: Labelled, second: Labelled) -> Finding:
    """Judge that the first is larger for the same policies, and on the same robots."""
    found = judging.larger_paired(*((label, measured.seeds) for label, measured in (first, second)))
    return _agreed(found, _differences(first[1], second[1]), ABOVE_ZERO, np.inf)


def _differences(first: Measured, second: Measured) -> Points:
    """Return the differences of robots that both have."""
    return {robot: first.robots[robot] - second.robots[robot] for robot in first.robots if robot in second.robots}


def _agreed(found: Finding, robots: Points, low: float, high: float) -> Finding:
    """Return a finding with the t-interval over robots held against it; one robot carries no verdict."""
    if not robots or found.outcome == "not tested":
        return found
    interval = t_interval(list(robots.values()))
    if interval is None:
        return Finding("not tested", f"{found.evidence}, one robot")
    return confirmed(found, f"{len(robots)} robots", interval, low, high)
