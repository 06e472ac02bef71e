"""All rows of the comparison as samples over training seeds, asked for by way of training, place and friction.

A row is one of summary.json: the columns of results.csv, and `crossed`, the share of walks that crossed their course.
What is asked for is remembered, so that the rows behind a verdict can be named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stiction.formats.results import DIRECTIONS
from stiction.transfer.experiment.judging import Rate
from stiction.transfer.experiment.table import Points


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

ERROR = "speed_error"
"""A column that is computed: |speed ratio - 1|. Of virtual robots it is the mean over robots: one that is too fast does
not make up for one that is too slow."""


@dataclass(frozen=True)
class Evidence:
    """Rows by cell; a column of one cell is a sample with a point a training seed."""

    cells: dict[Cell, dict[int, list[Row]]]
    reads: dict[tuple[Cell, str], Points] = field(default_factory=dict)
    """Cell and column -> what was read there, in the order of reading; nothing where there are no rows."""

    @classmethod
    def of(cls, rows: Iterable[Row]) -> Evidence:
        """Sort the rows; `method` is the way of training."""
        cells: dict[Cell, dict[int, list[Row]]] = {}
        for row in rows:
            level = round(row["friction_level"], 6)
            key = row["method"], row["engine"], row["friction_law"], level, row["terrain"], row["command"]
            cells.setdefault(key, {}).setdefault(row["seed"], []).append(row)
        return cls(cells)

    def afresh(self) -> Evidence:
        """Return the same rows, none of them read."""
        return Evidence(self.cells)

    def column(self, cell: Cell, column: str) -> Points:
        """Return one column of every training seed that has it; empty where nothing was walked."""
        found: Points = {}
        for seed, rows in sorted(self.cells.get(cell, {}).items()):
            known = [value for value in (_value(row, column) for row in rows) if value is not None]
            if known:
                found[seed] = float(np.mean(known))
        if found:
            self.reads[cell, column] = found
        return found

    def points(self, way: str, spot: Spot, command: str, column: str, terrain: str = "flat") -> Points:
        """Return one column of every training seed; empty where nothing was walked."""
        return self.column(_cell(way, spot, command, terrain), column)

    def rate(self, way: str, spot: Spot, commands: Sequence[str], column: str, terrain: str = "flat") -> Rate:
        """Return how often something happened, of the seeds that walked all the commands, each command alike.

        A trial is a walk of the robot of the data sheet. Walks of one virtual robot are not independent of each other,
        whichever their command: a robot is one trial a policy, and its share of them counts.
        """
        points = self._over(way, spot, commands, column, lambda values: float(np.mean(values)), terrain)
        cells = [self.cells[_cell(way, spot, command, terrain)] for command in commands if points]
        trials = {seed: _trials([row for cell in cells for row in cell[seed]]) for seed in points}
        return Rate(points, sum(points[seed] * trials[seed] for seed in points), sum(trials.values()))

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
        return self._over(way, spot, DIRECTIONS, "speed_ratio", min)

    def faster(self, way: str, spot: Spot) -> Points:
        """Return the speed ratio of the faster direction of every seed: a robot that stands still has none."""
        return self._over(way, spot, DIRECTIONS, "speed_ratio", max)

    def error(self, way: str, spot: Spot) -> Points:
        """Return the mean of |speed ratio - 1| over both directions, of every seed."""
        return self._over(way, spot, DIRECTIONS, ERROR, lambda values: float(np.mean(values)))

    def worst(self, way: str, spot: Spot, column: str, commands: Sequence[str] = DIRECTIONS) -> Points:
        """Return the largest of a column's values over some commands, of every seed."""
        return self._over(way, spot, commands, column, max)

    def _over(
        self,
        way: str,
        spot: Spot,
        commands: Sequence[str],
        column: str,
        choose: Callable[[Sequence[float]], float],
        terrain: str = "flat",
    ) -> Points:
        """Return what `choose` makes of a column over some commands, of every seed that has all of them."""
        columns = [self.points(way, spot, command, column, terrain) for command in commands]
        seeds = sorted(set.intersection(*map(set, columns)))
        return {seed: choose([column[seed] for column in columns]) for seed in seeds}


def _cell(way: str, spot: Spot, command: str, terrain: str) -> Cell:
    """Return the key of a cell."""
    return way, spot.engine, spot.law, round(spot.level, 6), terrain, command


def _value(row: Row, column: str) -> float | None:
    """Return what a row has in a column, also in one that is computed."""
    if column != ERROR:
        value: float | None = row[column]
        return value
    each = row["robots"].values() if "robots" in row else [row["speed_ratio"]]
    deviations = [abs(ratio - 1.0) for ratio in each if ratio is not None]
    return float(np.mean(deviations)) if deviations else None


def _trials(rows: Sequence[Row]) -> int:
    """Return the independent trials behind rows of one seed: virtual robots, or episodes."""
    robots = {robot for row in rows for robot in row.get("robots", ())}
    return len(robots) or sum(row["episodes"] for row in rows)
