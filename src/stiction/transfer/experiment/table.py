"""The results of the experiment as samples over training seeds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from stiction.formats.experiment import SeedMean
from stiction.formats.results import DIRECTIONS, ResultRow
from stiction.transfer.experiment.manifest import condition_of
from stiction.transfer.statistics import t_interval

STUDENT = "student"

Key = tuple[str, str, float, str]
"""Condition, who, friction level, command."""

Points = dict[int, float]
"""Seed -> value."""

Combine = Callable[[Sequence[float]], float]
"""One number of several."""


@dataclass(frozen=True)
class Table:
    """Rows of results.csv by condition, policy, level and command, and within each by seed."""

    cells: dict[Key, dict[int, ResultRow]]

    @classmethod
    def of(cls, rows: Iterable[ResultRow]) -> Table:
        """Sort rows whose policies are called `<condition>-s<seed>/<who>`."""
        cells: dict[Key, dict[int, ResultRow]] = {}
        for row in rows:
            run, _, who = row.policy.partition("/")
            condition, seed = condition_of(run)
            cells.setdefault((condition, who, round(row.friction_level, 6), row.command), {})[seed] = row
        return cls(cells)

    def points(self, condition: str, level: float, command: str, column: str, who: str = STUDENT) -> Points:
        """Return one column of every seed at a level and command; empty where nothing was evaluated."""
        rows = self.cells.get((condition, who, round(level, 6), command), {})
        return {seed: getattr(row, column) for seed, row in sorted(rows.items()) if getattr(row, column) is not None}

    def levels(self, condition: str, who: str = STUDENT) -> list[float]:
        """Return the levels at which a condition was evaluated, from low to high."""
        return sorted({level for name, by, level, _ in self.cells if (name, by) == (condition, who)})

    def slower(self, condition: str, level: float, who: str = STUDENT) -> Points:
        """Return the speed ratio of the slower direction, forward or backward, of every seed."""
        return self._over_directions(condition, level, who, min)

    def faster(self, condition: str, level: float, who: str = STUDENT) -> Points:
        """Return the speed ratio of the faster direction of every seed: a robot that is stationary has none."""
        return self._over_directions(condition, level, who, max)

    def speed_error(self, condition: str, levels: Sequence[float], who: str = STUDENT) -> Points:
        """Return the mean of |speed ratio - 1| over both directions and the levels, of every seed."""
        return self._combined(condition, levels, who, lambda ratios: float(np.mean(np.abs(np.array(ratios) - 1.0))))

    def _over_directions(self, condition: str, level: float, who: str, choose: Combine) -> Points:
        """Return what `choose` makes of forward and backward speed ratio, of every seed."""
        return self._combined(condition, [level], who, choose)

    def _combined(self, condition: str, levels: Sequence[float], who: str, combine: Combine) -> Points:
        """Return a figure of the speed ratios over levels and both directions, of seeds that have all of them."""
        columns = [self.points(condition, level, vx, "speed_ratio", who) for level in levels for vx in DIRECTIONS]
        seeds = sorted(set.intersection(*map(set, columns))) if columns else []
        return {seed: float(combine([column[seed] for column in columns])) for seed in seeds}

    def means(self) -> list[SeedMean]:
        """Return the mean speed ratio over seeds of every cell that has one, with its t-interval."""
        found = []
        for (condition, who, level, command), rows in sorted(self.cells.items()):
            values = [row.speed_ratio for row in rows.values() if row.speed_ratio is not None]
            if values:
                law = next(iter(rows.values())).friction_law
                low, high = t_interval(values) or (None, None)
                mean = float(np.mean(values))
                found.append(SeedMean(condition, who, law, level, command, len(values), mean, low, high))
        return found


def median_seed(rows: Iterable[ResultRow], condition: str, highest: float = 0.3) -> int | None:
    """Return the seed that is shipped: the median by the student's speed error over levels up to `highest`.

    Of an even number of seeds the better of the two in the middle; None where no student was evaluated.
    """
    table = Table.of(rows)
    errors = table.speed_error(condition, [level for level in table.levels(condition) if level <= highest])
    ranked = sorted(errors, key=lambda seed: (errors[seed], seed))
    return ranked[(len(ranked) - 1) // 2] if ranked else None
