"""Samples over training seeds with a record of what was read, for claims about training methods."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from stiction.evaluation import samples
from stiction.evaluation.grid import REAL
from stiction.evaluation.samples import ERROR, Cell, Condition, Row, SeedValues, cells_of, ratios_of
from stiction.files.results import DIRECTIONS


@dataclass(frozen=True)
class Measurement:
    """One number of a training method under one condition."""

    seeds: SeedValues
    """Training seed -> value, of virtual robots the mean over them."""
    robots: dict[int, float] = field(default_factory=dict)
    """Virtual robot -> mean over the seeds; none on the robot of the data sheet, or where only the mean is known."""


Weigh = Callable[[Sequence[float]], Sequence[float]]
"""Values of a policy, one a command -> their weights."""


@dataclass(frozen=True)
class Evidence(samples.Evidence):
    """Rows by cell, with what was read of them: the rows behind a verdict can be named."""

    reads: dict[tuple[Cell, str], SeedValues] = field(default_factory=dict)
    """Cell and column -> what was read there, in the order of reading."""

    def afresh(self) -> Self:
        """Return the same rows with an empty record of what was read."""
        return replace(self, reads={})

    def column(self, cell: Cell, column: str) -> SeedValues:
        """Return one column of every training seed that has it, and record it; empty where nothing was walked."""
        values = super().column(cell, column)
        if values:
            self.reads[cell, column] = values
        return values

    def mean(self, method: str, condition: Condition, column: str, *commands: str) -> Measurement:
        """Return the mean of a column over commands on flat ground; empty where nothing was walked."""
        return self._over(cells_of(method, condition, commands), column, _evenly)

    def methods(self) -> list[str]:
        """Return the training methods that were walked, in the order of the rows."""
        return list(dict.fromkeys(method for method, *_ in self.cells))

    def levels(self, method: str, engine: str, law: str = "coulomb") -> list[float]:
        """Return the levels at which a method was walked on flat ground, from low to high."""
        first = method, engine, law
        return sorted({level for *own, level, ground, _ in self.cells if (*own, ground) == (*first, "flat")})

    def frictions(self, method: str, engine: str) -> list[Condition]:
        """Return every friction of virtual robots at which a method was walked on flat ground."""
        laws = {law: None for m, at, law, *_ in self.cells if (m, at) == (method, engine) and law.startswith(REAL)}
        return [Condition(engine, level, law) for law in laws for level in self.levels(method, engine, law)]

    def robots(self, condition: Condition, *methods: str) -> tuple[set[str], set[str]]:
        """Return the virtual robots of a condition on which all of these methods walked, with every policy and in both
        directions, and the other ones there: those whose bench does not identify a friction to feed forward.
        """
        walked = [
            (cell[0], set(row.get("robots", ())))
            for cell, seeds in self.cells.items()
            if _is_walked_at(cell, condition)
            for rows in seeds.values()
            for row in rows
        ]
        shared = [robots for method, robots in walked if method in methods]
        common = set.intersection(*shared) if shared else set()
        return common, set().union(*(robots for _, robots in walked)) - common

    def on_shared_robots(self, condition: Condition, *methods: str) -> Self:
        """Return the same rows, those of these methods under a condition over their common virtual robots alone: of
        them the speed is known, and nothing else. Reading is recorded here.
        """
        shared, _ = self.robots(condition, *methods)
        cells = dict(self.cells)
        for cell, seeds in self.cells.items():
            if cell[0] in methods and _is_walked_at(cell, condition):
                cells[cell] = {seed: [_over_robots(row, shared) for row in rows] for seed, rows in seeds.items()}
        return replace(self, cells=cells)

    def slower(self, method: str, condition: Condition, commands: Sequence[str] = DIRECTIONS) -> Measurement:
        """Return the speed ratio of the slower direction of every seed."""
        return self._over(cells_of(method, condition, commands), "speed_ratio", _least)

    def faster(self, method: str, condition: Condition) -> Measurement:
        """Return the speed ratio of the faster direction of every seed."""
        return self._over(cells_of(method, condition, DIRECTIONS), "speed_ratio", _most)

    def ends(self, method: str, condition: Condition) -> dict[int, tuple[float, float]]:
        """Return the least and the largest speed ratio of every seed that walked both ways: of virtual robots that of
        the slowest and of the fastest, in either direction.
        """
        cells = cells_of(method, condition, DIRECTIONS)
        ends = {}
        for seed in self.slower(method, condition).seeds:
            each = [ratio for cell in cells for row in self.cells[cell][seed] for ratio in ratios_of(row)]
            ends[seed] = min(each), max(each)
        return ends

    def error(self, method: str, *conditions: Condition) -> Measurement:
        """Return the mean of |speed ratio - 1| over both directions and the conditions, of every seed that has all."""
        return self._over([cell for one in conditions for cell in cells_of(method, one, DIRECTIONS)], ERROR, _evenly)

    def worst(
        self, method: str, condition: Condition, column: str, commands: Sequence[str] = DIRECTIONS
    ) -> Measurement:
        """Return the largest of a column's values over some commands, of every seed."""
        return self._over(cells_of(method, condition, commands), column, _most)

    def _over(self, cells: Sequence[Cell], column: str, weigh: Weigh) -> Measurement:
        """Return a column over some cells, of every seed that has all of them, and of every virtual robot.

        A seed's weights come from its means over robots, so that the mean over robots is that over seeds.
        """
        columns = [self.column(cell, column) for cell in cells]
        seeds: SeedValues = {}
        robots: dict[int, list[float]] = {}
        for seed in sorted(set.intersection(*map(set, columns))) if columns else ():
            weights = weigh([known[seed] for known in columns])
            seeds[seed] = sum(w * known[seed] for w, known in zip(weights, columns, strict=True))
            for robot, values in _each_robot([self.cells[cell][seed] for cell in cells], column).items():
                robots.setdefault(robot, []).append(sum(w * value for w, value in zip(weights, values, strict=True)))
        return Measurement(seeds, {robot: float(np.mean(values)) for robot, values in robots.items()})


def _evenly(values: Sequence[float]) -> Sequence[float]:
    """Weigh every value alike."""
    return [1.0 / len(values)] * len(values)


def _least(values: Sequence[float]) -> Sequence[float]:
    """Take the least value alone."""
    return [float(index == int(np.argmin(values))) for index in range(len(values))]


def _most(values: Sequence[float]) -> Sequence[float]:
    """Take the largest value alone."""
    return _least([-value for value in values])


def _is_walked_at(cell: Cell, condition: Condition) -> bool:
    """Return whether a cell is one of a condition on flat ground, forward or backward."""
    return cell in cells_of(cell[0], condition, DIRECTIONS)


def _over_robots(row: Row, robots: set[str]) -> Row:
    """Return the speed of a row over some of its virtual robots; a row of the robot of the data sheet as it is."""
    if "robots" not in row:
        return row
    each = {robot: ratio for robot, ratio in row["robots"].items() if robot in robots}
    return {"robots": each, "speed_ratio": float(np.mean([*each.values()])) if each else None}


def _each_robot(cells: Sequence[Sequence[Row]], column: str) -> dict[int, list[float]]:
    """Return virtual robot -> a column's value in each cell, of the robots that have one in all.

    cells: the rows of one seed in each of them.
    """
    by_robot = []
    for rows in cells:
        values: dict[int, list[float]] = {}
        for robot, value in (pair for row in rows for pair in _of_robots(row, column)):
            if value is not None:
                values.setdefault(int(robot), []).append(value)
        by_robot.append(values)
    whole = sorted(set.intersection(*map(set, by_robot)))
    return {robot: [float(np.mean(values[robot])) for values in by_robot] for robot in whole}


def _of_robots(row: Row, column: str) -> Iterable[tuple[str, float | None]]:
    """Return virtual robots of a row with the value of each in a column; none where only the mean is known."""
    ratios: dict[str, float | None] = row.get("robots", {})
    if column == "speed_ratio":
        return ratios.items()
    if column == ERROR:
        return [(robot, None if ratio is None else abs(ratio - 1.0)) for robot, ratio in ratios.items()]
    if column == "tracking_error" and "robot_tracking_errors" in row:
        return zip(ratios, row["robot_tracking_errors"], strict=True)
    return ()
