"""Rows of results as samples over training seeds, by training method and condition.

A row is one of summary.json: the columns of results.csv, and `crossed`, the share of walks that crossed their course.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from stiction.core.statistics import Interval, t_interval, wilson
from stiction.evaluation.table import BOTH, Sample
from stiction.files.results import DIRECTIONS

SeedValues = dict[int, float]


@dataclass(frozen=True)
class Condition:
    """Engine and friction of a walk."""

    engine: str
    level: float
    """Friction over the torque limit, or a coefficient [-]."""
    law: str = "coulomb"


@dataclass(frozen=True)
class Rate:
    """Rate of an event in the walks of a training method."""

    seeds: SeedValues
    """Training seed -> share of its walks [-]."""
    successes: float
    """Number of events in all trials; for clusters of walks, the sum of their mean shares."""
    trials: int
    """Number of walks, or of clusters of walks that depend on each other: pairs of policy and virtual robot."""

    @property
    def interval(self) -> Interval:
        """Wilson's 95 % interval of the share of all trials."""
        return wilson(self.successes, self.trials)


Row = dict[str, Any]

Cell = tuple[str, str, str, float, str, str]
"""Training method, engine, law, level, ground, command."""

ERROR = "speed_error"
"""Computed column: |speed ratio - 1|, for virtual robots its mean over them."""


@dataclass(frozen=True)
class Evidence:
    """Rows by cell; a column of a cell is a sample with one point per training seed."""

    cells: dict[Cell, dict[int, list[Row]]]

    @classmethod
    def of(cls, rows: Iterable[Row]) -> Self:
        """Sort the rows by their cells."""
        cells: dict[Cell, dict[int, list[Row]]] = {}
        for row in rows:
            # Levels are keys and come out of sums and files: to six digits they are equal where they should be.
            level = round(row["friction_level"], 6)
            key = row["method"], row["engine"], row["friction_law"], level, row["terrain"], row["command"]
            cells.setdefault(key, {}).setdefault(row["seed"], []).append(row)
        return cls(cells)

    def column(self, cell: Cell, column: str) -> SeedValues:
        """Return a column's mean of every training seed that has it; empty for a cell without walks."""
        means: SeedValues = {}
        for seed, rows in sorted(self.cells.get(cell, {}).items()):
            known = [value for value in (_value(row, column) for row in rows) if value is not None]
            if known:
                means[seed] = float(np.mean(known))
        return means

    def over(self, cells: Sequence[Cell], column: str) -> SeedValues:
        """Return the mean of a column over cells of equal weight, for every seed that has all of them."""
        columns = [self.column(cell, column) for cell in cells]
        seeds = sorted(set.intersection(*map(set, columns))) if columns else ()
        return {seed: sum(1.0 / len(cells) * known[seed] for known in columns) for seed in seeds}

    def rate(
        self, method: str, condition: Condition, commands: Sequence[str], column: str, terrain: str = "flat"
    ) -> Rate:
        """Return the rate of an event over the seeds that walked all the commands, commands of equal weight.

        A trial is a walk of the robot of the data sheet, or a pair of policy and virtual robot: see `Rate`.
        """
        cells = cells_of(method, condition, commands, terrain)
        shares = self.over(cells, column)
        rows = {seed: [row for cell in cells for row in self.cells[cell][seed]] for seed in shares}
        trials = {
            seed: len(_robots(seed_rows)) or sum(row["episodes"] for row in seed_rows)
            for seed, seed_rows in rows.items()
        }
        return Rate(shares, sum(shares[seed] * trials[seed] for seed in shares), sum(trials.values()))


def cells_of(method: str, condition: Condition, commands: Sequence[str], terrain: str = "flat") -> list[Cell]:
    """Return the keys of cells, one per command."""
    level = round(condition.level, 6)
    return [(method, condition.engine, condition.law, level, terrain, command) for command in commands]


def _value(row: Row, column: str) -> float | None:
    """Return the value of a row in a column, stored or computed."""
    if column != ERROR:
        value: float | None = row[column]
        return value
    deviations = [abs(ratio - 1.0) for ratio in ratios_of(row)]
    return float(np.mean(deviations)) if deviations else None


def ratios_of(row: Row) -> list[float]:
    """Return the speed ratio of each virtual robot of a row, or that of the robot of the data sheet."""
    each = row["robots"].values() if "robots" in row else [row["speed_ratio"]]
    return [ratio for ratio in each if ratio is not None]


def _robots(rows: Sequence[Row]) -> set[str]:
    """Return the names of the virtual robots in rows."""
    return {robot for row in rows for robot in row.get("robots", ())}


MEASURES = ("speed_ratio", ERROR, "tracking_error", "joint_jitter", "flight_share", "tripod_share", "steps_climbed")

RATES = ("fall_rate", "crossed")

OVER_BOTH = ("joint_jitter", "flight_share", "tripod_share", "fall_rate")
"""Columns that also have a sample over forward and backward together."""


def samples(evidence: Evidence) -> list[Sample]:
    """Return a sample of every column in every cell that has it, and over both directions where both were walked."""
    collected: list[Sample | None] = []
    for cell in evidence.cells:
        method, engine, law, level, terrain, command = cell
        condition = Condition(engine, level, law)
        collected += [_sample(cell, column, evidence.column(cell, column)) for column in MEASURES]
        rates = ((column, evidence.rate(method, condition, (command,), column, terrain)) for column in RATES)
        collected += [_sample(cell, column, rate.seeds, rate) for column, rate in rates]
        if command == DIRECTIONS[-1] and terrain == "flat":
            for column in OVER_BOTH:
                rate = evidence.rate(method, condition, DIRECTIONS, column)
                collected.append(_sample((*cell[:-1], BOTH), column, rate.seeds, rate if column in RATES else None))
    return [sample for sample in collected if sample is not None]


def samples_of(rows: Iterable[Row], methods: Mapping[str, str]) -> list[Sample]:
    """Return the samples of any policies. rows: as in summary.json; methods: policy -> method, see `methods_of`."""
    return samples(Evidence.of(row | {"method": methods[row["policy"]]} for row in rows))


def _sample(cell: Cell, column: str, values: SeedValues, rate: Rate | None = None) -> Sample | None:
    """Return a sample; None where no seed has the column."""
    if not values:
        return None
    each = list(values.values())
    low, high = t_interval(each) or (None, None)
    below, above = (None, None) if rate is None else rate.interval
    trials = None if rate is None else rate.trials
    return Sample(*cell, column, *each_seed(values), float(np.mean(each)), low, high, trials, below, above)


def each_seed(values: SeedValues) -> tuple[str, str]:
    """Return seeds and their values as text, as the files store them."""
    return " ".join(map(str, values)), " ".join(f"{value:.6g}" for value in values.values())
