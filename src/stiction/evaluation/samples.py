"""Rows of results as samples over training seeds, by training method and condition.

A row is one of summary.json: the columns of results.csv, and `crossed`, the share of walks that crossed their course.
What is read is recorded, so that the rows behind a verdict can be named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from stiction.core.statistics import Interval, t_interval, wilson
from stiction.evaluation.grid import REAL
from stiction.evaluation.table import BOTH, Sample
from stiction.files.results import DIRECTIONS

SeedValues = dict[int, float]
"""Training seed -> value."""


@dataclass(frozen=True)
class Condition:
    """Where a policy walks, and under which friction."""

    engine: str
    """As in results.csv."""
    level: float
    """Friction over the torque limit, or a coefficient [-]."""
    law: str = "coulomb"
    """Friction law, as in results.csv."""


@dataclass(frozen=True)
class Measurement:
    """One number of a training method under one condition."""

    seeds: SeedValues
    """Training seed -> value, of virtual robots the mean over them."""
    robots: dict[int, float] = field(default_factory=dict)
    """Virtual robot -> mean over the seeds; none on the robot of the data sheet, or where only the mean is known."""


@dataclass(frozen=True)
class Rate:
    """How often something happened in the walks of a training method."""

    seeds: SeedValues
    """Training seed -> share of its walks [-]."""
    successes: float
    """How often it happened in all of them; with clusters of walks, their mean shares added up."""
    trials: int
    """Walks, or clusters of walks that are not independent of each other: pairs of policy and virtual robot."""
    robots: int = 0
    """Virtual robots, which the policies share; 0: those walks are on the robot of the data sheet."""

    @property
    def share(self) -> float:
        """Share of all trials [-]."""
        return self.successes / self.trials

    @property
    def interval(self) -> Interval:
        """Wilson's 95 % interval of that share."""
        return wilson(self.successes, self.trials)

    @property
    def robots_interval(self) -> Interval | None:
        """Wilson's 95 % interval of that share with a robot as a trial, whichever policy walked; None without them."""
        return wilson(self.share * self.robots, self.robots) if self.robots else None


Row = dict[str, Any]
"""One row of summary.json."""

Cell = tuple[str, str, str, float, str, str]
"""Training method, engine, law, level, ground, command."""

ERROR = "speed_error"
"""A column that is computed: |speed ratio - 1|, of virtual robots the mean over them."""

Weigh = Callable[[Sequence[float]], Sequence[float]]
"""Values of a policy, one a command -> their weights."""


@dataclass(frozen=True)
class Evidence:
    """Rows by cell; a column of one cell is a sample with a point a training seed."""

    cells: dict[Cell, dict[int, list[Row]]]
    reads: dict[tuple[Cell, str], SeedValues] = field(default_factory=dict)
    """Cell and column -> what was read there, in the order of reading."""

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

    def afresh(self) -> Self:
        """Return the same rows with an empty record of what was read."""
        return replace(self, reads={})

    def column(self, cell: Cell, column: str) -> SeedValues:
        """Return one column of every training seed that has it; empty where nothing was walked."""
        found: SeedValues = {}
        for seed, rows in sorted(self.cells.get(cell, {}).items()):
            known = [value for value in (_value(row, column) for row in rows) if value is not None]
            if known:
                found[seed] = float(np.mean(known))
        if found:
            self.reads[cell, column] = found
        return found

    def mean(self, method: str, condition: Condition, column: str, *commands: str) -> Measurement:
        """Return the mean of a column over commands on flat ground; empty where nothing was walked."""
        return self._over(_cells(method, condition, commands), column, _evenly)

    def rate(
        self, method: str, condition: Condition, commands: Sequence[str], column: str, terrain: str = "flat"
    ) -> Rate:
        """Return how often something happened, of the seeds that walked all the commands, each command alike.

        A trial is a walk of the robot of the data sheet, or a pair of policy and virtual robot: walks of one virtual
        robot are not independent of each other. See `Rate`.
        """
        cells = _cells(method, condition, commands, terrain)
        shares = self._over(cells, column, _evenly).seeds
        rows = {seed: [row for cell in cells for row in self.cells[cell][seed]] for seed in shares}
        trials = {seed: len(_robots(own)) or sum(row["episodes"] for row in own) for seed, own in rows.items()}
        robots = _robots([row for own in rows.values() for row in own])
        return Rate(shares, sum(shares[seed] * trials[seed] for seed in shares), sum(trials.values()), len(robots))

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
        return self._over(_cells(method, condition, commands), "speed_ratio", _least)

    def faster(self, method: str, condition: Condition) -> Measurement:
        """Return the speed ratio of the faster direction of every seed."""
        return self._over(_cells(method, condition, DIRECTIONS), "speed_ratio", _most)

    def ends(self, method: str, condition: Condition) -> dict[int, tuple[float, float]]:
        """Return the least and the largest speed ratio of every seed that walked both ways: of virtual robots that of
        the slowest and of the fastest, in either direction.
        """
        cells = _cells(method, condition, DIRECTIONS)
        found = {}
        for seed in self.slower(method, condition).seeds:
            each = [ratio for cell in cells for row in self.cells[cell][seed] for ratio in _ratios(row)]
            found[seed] = min(each), max(each)
        return found

    def error(self, method: str, *conditions: Condition) -> Measurement:
        """Return the mean of |speed ratio - 1| over both directions and the conditions, of every seed that has all."""
        return self._over([cell for one in conditions for cell in _cells(method, one, DIRECTIONS)], ERROR, _evenly)

    def worst(
        self, method: str, condition: Condition, column: str, commands: Sequence[str] = DIRECTIONS
    ) -> Measurement:
        """Return the largest of a column's values over some commands, of every seed."""
        return self._over(_cells(method, condition, commands), column, _most)

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


def _cells(method: str, condition: Condition, commands: Sequence[str], terrain: str = "flat") -> list[Cell]:
    """Return the keys of cells, one a command."""
    level = round(condition.level, 6)
    return [(method, condition.engine, condition.law, level, terrain, command) for command in commands]


def _is_walked_at(cell: Cell, condition: Condition) -> bool:
    """Return whether a cell is one of a condition on flat ground, forward or backward."""
    return cell in _cells(cell[0], condition, DIRECTIONS)


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
    deviations = [abs(ratio - 1.0) for ratio in _ratios(row)]
    return float(np.mean(deviations)) if deviations else None


def _ratios(row: Row) -> list[float]:
    """Return the speed ratio of each virtual robot of a row, or that of the robot of the data sheet."""
    each = row["robots"].values() if "robots" in row else [row["speed_ratio"]]
    return [ratio for ratio in each if ratio is not None]


def _each_robot(cells: Sequence[Sequence[Row]], column: str) -> dict[int, list[float]]:
    """Return virtual robot -> a column's value in each cell, of the robots that have one in all.

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
    """Return virtual robots of a row with the value of each in a column; none where only the mean is known."""
    ratios: dict[str, float | None] = row.get("robots", {})
    if column == "speed_ratio":
        return ratios.items()
    if column == ERROR:
        return [(robot, None if ratio is None else abs(ratio - 1.0)) for robot, ratio in ratios.items()]
    if column == "tracking_error" and "robot_tracking_errors" in row:
        return zip(ratios, row["robot_tracking_errors"], strict=True)
    return ()


def _robots(rows: Sequence[Row]) -> set[str]:
    """Return the virtual robots of rows."""
    return {robot for row in rows for robot in row.get("robots", ())}


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
        method, engine, law, level, terrain, command = cell
        condition = Condition(engine, level, law)
        found += [_sample(cell, column, evidence.column(cell, column)) for column in MEASURES]
        rates = ((column, evidence.rate(method, condition, (command,), column, terrain)) for column in RATES)
        found += [_sample(cell, column, rate.seeds, rate) for column, rate in rates]
        if command == DIRECTIONS[-1] and terrain == "flat":
            for column in OVER_BOTH:
                rate = evidence.rate(method, condition, DIRECTIONS, column)
                found.append(_sample((*cell[:-1], BOTH), column, rate.seeds, rate if column in RATES else None))
    return [sample for sample in found if sample is not None]


def samples_of(rows: Iterable[Row], methods: Mapping[str, str]) -> list[Sample]:
    """Return the samples of any policies. rows: as in summary.json; methods: of each policy, see `methods_of`."""
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
    """Return seeds and their values as the files have them."""
    return " ".join(map(str, values)), " ".join(f"{value:.6g}" for value in values.values())
