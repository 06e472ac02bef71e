"""All rows of the comparison as samples over training seeds, asked for by way of training, place and friction.

A row is one of summary.json: the columns of results.csv, and `crossed`, the share of walks that crossed their course.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stiction.transfer.experiment.table import Points

BOTH = ("vx=0.5", "vx=-0.5")


@dataclass(frozen=True)
class Spot:
    """Where, and under which friction."""

    engine: str
    """As in results.csv."""
    level: float
    """Friction [-]."""
    law: str = "coulomb"
    """Law, as in results.csv."""


Row = dict[str, Any]
"""One row of summary.json."""

Cell = tuple[str, str, str, float, str, str]
"""Way of training, engine, law, level, ground, command."""


@dataclass(frozen=True)
class Evidence:
    """Rows by cell; a column of one cell is a sample with a point a training seed."""

    cells: dict[Cell, dict[int, list[Row]]]

    @classmethod
    def of(cls, rows: Iterable[Row]) -> Evidence:
        """Sort the rows; `method` is the way of training."""
        cells: dict[Cell, dict[int, list[Row]]] = {}
        for row in rows:
            level = round(row["friction_level"], 6)
            key = row["method"], row["engine"], row["friction_law"], level, row["terrain"], row["command"]
            cells.setdefault(key, {}).setdefault(row["seed"], []).append(row)
        return cls(cells)

    def points(self, way: str, spot: Spot, command: str, column: str, terrain: str = "flat") -> Points:
        """Return one column of every training seed; empty where nothing was walked."""
        key = way, spot.engine, spot.law, round(spot.level, 6), terrain, command
        found: Points = {}
        for seed, rows in sorted(self.cells.get(key, {}).items()):
            values = [row[column] for row in rows]
            known = [value for value in values if value is not None]
            if known:
                found[seed] = float(np.mean(known))
        return found

    def ways(self) -> list[str]:
        """Return the ways of training that were walked, in the order of the rows."""
        return list(dict.fromkeys(way for way, *_ in self.cells))

    def levels(self, way: str, engine: str, law: str = "coulomb") -> list[float]:
        """Return the levels at which a way was walked on flat ground, from low to high."""
        asked = way, engine, law
        return sorted(
            {level for *first, level, terrain, _ in self.cells if tuple(first) == asked and terrain == "flat"}
        )

    def slower(self, way: str, spot: Spot) -> Points:
        """Return the speed ratio of the slower direction of every seed."""
        return self._over(way, spot, min)

    def faster(self, way: str, spot: Spot) -> Points:
        """Return the speed ratio of the faster direction of every seed: a robot that stands still has none."""
        return self._over(way, spot, max)

    def error(self, way: str, spots: Sequence[Spot]) -> Points:
        """Return the mean of |speed ratio - 1| over both directions and some spots, of every seed.

        Of virtual robots it is the mean over robots: one that is too fast does not make up for one that is too slow.
        """
        columns = [self._deviations(way, spot, command) for spot in spots for command in BOTH]
        return {seed: float(np.mean([column[seed] for column in columns])) for seed in _common(columns)}

    def _deviations(self, way: str, spot: Spot, command: str) -> Points:
        """Return the mean of |speed ratio - 1| at one spot and command, of every seed."""
        found: Points = {}
        key = way, spot.engine, spot.law, round(spot.level, 6), "flat", command
        for seed, rows in sorted(self.cells.get(key, {}).items()):
            each = [ratio for row in rows for ratio in row.get("robots", {0: row["speed_ratio"]}).values()]
            found[seed] = float(np.mean([abs(ratio - 1.0) for ratio in each]))
        return found

    def worst(self, way: str, spot: Spot, column: str) -> Points:
        """Return the larger of a column's values, forward and backward, of every seed."""
        columns = [self.points(way, spot, command, column) for command in BOTH]
        return {seed: max(column[seed] for column in columns) for seed in _common(columns)}

    def _over(self, way: str, spot: Spot, choose: Callable[[Iterable[float]], float]) -> Points:
        """Return what `choose` makes of the speed ratios of both directions, of every seed that has both."""
        columns = [self.points(way, spot, command, "speed_ratio") for command in BOTH]
        return {seed: choose(column[seed] for column in columns) for seed in _common(columns)}


def _common(columns: Sequence[Points]) -> list[int]:
    """Return the seeds that all columns have."""
    return sorted(set.intersection(*map(set, columns))) if columns else []
