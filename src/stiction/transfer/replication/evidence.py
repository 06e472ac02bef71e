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
from stiction.transfer.grid.plan import REAL
from stiction.transfer.replication.agreement import Measured


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


Weigh = Callable[[Sequence[float]], Sequence[float]]
"""What each of a policy's values, one a command, counts."""


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

    def points(self, way: str, spot: Spot, command: str, column: str) -> Measured:
        """Return one column on flat ground; empty where nothing was walked."""
        return self._over(way, spot, (command,), column, _evenly)

    def rate(self, way: str, spot: Spot, commands: Sequence[str], column: str, terrain: str = "flat") -> Rate:
        """Return how often something happened, of the seeds that walked all the commands, each command alike.

        A trial is a walk of the robot of the data sheet. Walks of one virtual robot are not independent of each other,
        whichever their command: a robot is one trial a policy, and its share of them counts. Nor are those trials
        independent, since the policies share the robots: the rate says how many of them there are.
        """
        points = self._over(way, spot, commands, column, _evenly, terrain).seeds
        cells = [self.cells[_cell(way, spot, command, terrain)] for command in commands if points]
        rows = {seed: [row for cell in cells for row in cell[seed]] for seed in points}
        trials = {seed: _trials(own) for seed, own in rows.items()}
        robots = _robots([row for own in rows.values() for row in own])
        return Rate(points, sum(points[seed] * trials[seed] for seed in points), sum(trials.values()), len(robots))

    def ways(self) -> list[str]:
        """Return the ways of training that were walked, in the order of the rows."""
        return list(dict.fromkeys(way for way, *_ in self.cells))

    def levels(self, way: str, engine: str, law: str = "coulomb") -> list[float]:
        """Return the levels at which a way was walked on flat ground, from low to high."""
        asked = way, engine, law
        return sorted(
            {level for *first, level, terrain, _ in self.cells if tuple(first) == asked and terrain == "flat"}
        )

    def frictions(self, way: str, engine: str) -> list[Spot]:
        """Return every friction of virtual robots at which a way was walked on flat ground: shares of the torque limit,
        what the bench measured, and either with a share of the load.
        """
        laws = {law: None for w, at, law, *_ in self.cells if (w, at) == (way, engine) and law.startswith(REAL)}
        return [Spot(engine, level, law) for law in laws for level in self.levels(way, engine, law)]

    def robots(self, spot: Spot, *ways: str) -> tuple[set[str], set[str]]:
        """Return the virtual robots of a spot on which all of these ways walked, with every policy and in both
        directions, and the other ones there: friction is not fed forward where a bench does not tell it.
        """
        cells = {cell: seeds for cell, seeds in self.cells.items() if _is_walked_at(cell, spot)}
        of = {
            cell: [set(row.get("robots", ())) for rows in seeds.values() for row in rows]
            for cell, seeds in cells.items()
        }
        shared = [one for cell, each in of.items() if cell[0] in ways for one in each]
        everyone = set().union(*(one for each in of.values() for one in each))
        common = set.intersection(*shared) if shared else set()
        return common, everyone - common

    def on_shared_robots(self, spot: Spot, *ways: str) -> Evidence:
        """Return the same rows, of these ways at a spot over the virtual robots alone on which all of them walked.

        Of those nothing but their speed is known. What is read there is remembered here.
        """
        shared, _ = self.robots(spot, *ways)
        cells = dict(self.cells)
        for cell, seeds in self.cells.items():
            if cell[0] in ways and _is_walked_at(cell, spot):
                cells[cell] = {seed: [_over_robots(row, shared) for row in rows] for seed, rows in seeds.items()}
        return Evidence(cells, self.reads)

    def slower(self, way: str, spot: Spot, commands: Sequence[str] = DIRECTIONS) -> Measured:
        """Return the speed ratio of the slower direction of every seed."""
        return self._over(way, spot, commands, "speed_ratio", _least)

    def faster(self, way: str, spot: Spot) -> Measured:
        """Return the speed ratio of the faster direction of every seed: a robot that stands still has none."""
        return self._over(way, spot, DIRECTIONS, "speed_ratio", _most)

    def error(self, way: str, spot: Spot) -> Measured:
        """Return the mean of |speed ratio - 1| over both directions, of every seed."""
        return self._over(way, spot, DIRECTIONS, ERROR, _evenly)

    def worst(self, way: str, spot: Spot, column: str, commands: Sequence[str] = DIRECTIONS) -> Measured:
        """Return the largest of a column's values over some commands, of every seed."""
        return self._over(way, spot, commands, column, _most)

    def _over(
        self, way: str, spot: Spot, commands: Sequence[str], column: str, weigh: Weigh, terrain: str = "flat"
    ) -> Measured:
        """Return a column over some commands, of every seed that has all of them, and of every virtual robot.

        Which direction is a policy's slower one is said by its mean over robots, and is the same one for each of them:
        so the mean over robots is that over seeds.
        """
        cells = [_cell(way, spot, command, terrain) for command in commands]
        columns = [self.column(cell, column) for cell in cells]
        seeds: Points = {}
        robots: dict[int, list[float]] = {}
        for seed in sorted(set.intersection(*map(set, columns))):
            weights = weigh([known[seed] for known in columns])
            seeds[seed] = sum(w * known[seed] for w, known in zip(weights, columns, strict=True))
            for robot, values in _each_robot([self.cells[cell][seed] for cell in cells], column).items():
                robots.setdefault(robot, []).append(sum(w * value for w, value in zip(weights, values, strict=True)))
        return Measured(seeds, {robot: float(np.mean(values)) for robot, values in robots.items()})


def _evenly(values: Sequence[float]) -> Sequence[float]:
    """Weigh every value alike."""
    return [1.0 / len(values)] * len(values)


def _least(values: Sequence[float]) -> Sequence[float]:
    """Take the least value alone."""
    return [float(index == int(np.argmin(values))) for index in range(len(values))]


def _most(values: Sequence[float]) -> Sequence[float]:
    """Take the largest value alone."""
    return _least([-value for value in values])


def _cell(way: str, spot: Spot, command: str, terrain: str) -> Cell:
    """Return the key of a cell."""
    return way, spot.engine, spot.law, round(spot.level, 6), terrain, command


def _is_walked_at(cell: Cell, spot: Spot) -> bool:
    """Say whether a cell is one of a spot in which a speed on flat ground is commanded forward or backward."""
    _, *where, terrain, command = cell
    return (*where, terrain) == (spot.engine, spot.law, round(spot.level, 6), "flat") and command in DIRECTIONS


def _over_robots(row: Row, robots: set[str]) -> Row:
    """Return the speed of a row over some of its virtual robots; a row of the robot of the data sheet as it is."""
    if "robots" not in row:
        return row
    each = {robot: ratio for robot, ratio in row["robots"].items() if robot in robots}
    return {"robots": each, "speed_ratio": float(np.mean([*each.values()])) if each else None}


def _value(row: Row, column: str) -> float | None:
    """Return what a row has in a column, also in one that is computed."""
    if column != ERROR:
        value: float | None = row[column]
        return value
    each = row["robots"].values() if "robots" in row else [row["speed_ratio"]]
    deviations = [abs(ratio - 1.0) for ratio in each if ratio is not None]
    return float(np.mean(deviations)) if deviations else None


def _each_robot(cells: Sequence[Sequence[Row]], column: str) -> dict[int, list[float]]:
    """Return a column's value in each cell of every virtual robot that has one in all; none where only the mean is
    known of them.

    cells: the rows of one seed in each of them.
    """
    found = []
    for rows in cells:
        values: dict[int, list[float]] = {}
        for robot, value in (pair for row in rows for pair in _of_robots(row, column)):
            if value is not None:
                values.setdefault(int(robot), []).append(value)
        found.append(values)
    whole = sorted(set.intersection(*map(set, found)))
    return {robot: [float(np.mean(values[robot])) for values in found] for robot in whole}


def _of_robots(row: Row, column: str) -> Iterable[tuple[str, float | None]]:
    """Return virtual robots of a row with what each has in a column; none where that is not known of each."""
    ratios: dict[str, float | None] = row.get("robots", {})
    if column == "speed_ratio":
        return ratios.items()
    if column == ERROR:
        return [(robot, None if ratio is None else abs(ratio - 1.0)) for robot, ratio in ratios.items()]
    if column == "tracking_error" and "robot_tracking_errors" in row:
        return zip(ratios, row["robot_tracking_errors"], strict=True)
    return ()


def _robots(rows: Sequence[Row]) -> set[str]:
    """Return the virtual robots of rows; none where they are of the robot of the data sheet."""
    return {robot for row in rows for robot in row.get("robots", ())}


def _trials(rows: Sequence[Row]) -> int:
    """Return the trials behind rows of one seed: virtual robots, or episodes."""
    return len(_robots(rows)) or sum(row["episodes"] for row in rows)
