"""Every column of every way of training over its seeds, with intervals: the rows of methods.csv."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from stiction.formats.replication import BOTH, Sample
from stiction.formats.results import DIRECTIONS
from stiction.transfer.experiment.judging import Rate
from stiction.transfer.experiment.table import Points
from stiction.transfer.replication.evidence import ERROR, Cell, Evidence, Row, Spot
from stiction.transfer.statistics import t_interval

MEASURES = ("speed_ratio", ERROR, "tracking_error", "joint_jitter", "flight_share", "tripod_share", "steps_climbed")
"""Columns that are averages of what a policy does."""

RATES = ("fall_rate", "crossed")
"""Columns that count walks."""

OVER_BOTH = ("joint_jitter", "flight_share", "tripod_share", "fall_rate")
"""Columns that are also given over forward and backward together."""


def samples(evidence: Evidence) -> list[Sample]:
    """Return a sample of every column in every cell that has it, and over both directions where both were walked."""
    found: list[Sample | None] = []
    for cell in evidence.cells:
        way, engine, law, level, terrain, command = cell
        spot = Spot(engine, level, law)
        found += [_sample(cell, column, evidence.column(cell, column)) for column in MEASURES]
        rates = ((column, evidence.rate(way, spot, (command,), column, terrain)) for column in RATES)
        found += [_sample(cell, column, rate.points, rate) for column, rate in rates]
        if command == DIRECTIONS[-1] and terrain == "flat":
            both = (*cell[:-1], BOTH)
            found += [_over_both(evidence, both, spot, column) for column in OVER_BOTH]
    return [sample for sample in found if sample is not None]


def samples_of(rows: Iterable[Row], ways: Mapping[str, str]) -> list[Sample]:
    """Return the samples of any policies. rows: as in summary.json; ways: see `ways_of`."""
    return samples(Evidence.of(row | {"method": ways[row["policy"]]} for row in rows))


def _over_both(evidence: Evidence, cell: Cell, spot: Spot, column: str) -> Sample | None:
    """Return the mean of a column over forward and backward."""
    rate = evidence.rate(cell[0], spot, DIRECTIONS, column)
    return _sample(cell, column, rate.points, rate if column in RATES else None)


def _sample(cell: Cell, column: str, points: Points, rate: Rate | None = None) -> Sample | None:
    """Return a sample; None where no seed has the column."""
    if not points:
        return None
    values = list(points.values())
    low, high = t_interval(values) or (None, None)
    below, above = (None, None) if rate is None else rate.interval
    trials = None if rate is None else rate.trials
    return Sample(*cell, column, *each_seed(points), float(np.mean(values)), low, high, trials, below, above)


def each_seed(points: Points) -> tuple[str, str]:
    """Return seeds and their values as the files have them."""
    return " ".join(map(str, points)), " ".join(f"{value:.6g}" for value in points.values())
