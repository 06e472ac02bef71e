"""Walks of the report as a table, and what a training seed is worth in it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf, isnan, nan
from statistics import fmean

from stiction.files.following import judge_row
from stiction.files.results import ResultRow
from stiction.files.velocity import parse_command
from stiction_experiments.paper.decide import Seeds


@dataclass(frozen=True)
class WalkRow:
    """One policy in one place under one friction and one command; a row of walks.csv."""

    training: str
    seed: int
    place: str
    friction: str
    """As typed: a share of the torque limit, `bench`, or the coefficient of the place's law."""
    command: str
    mean_vx: float
    """Mean forward velocity over the walks, zero after a fall [m/s]."""
    mean_vy: float
    """Mean sideways velocity [m/s]."""
    mean_wz: float
    """Mean yaw rate [rad/s]."""
    slowest_walk: float | None
    """Smallest ratio of a single walk, over the commanded axes [1]."""
    falls: float
    """Share of walks with a fall [1]."""
    chatter: float | None
    """Root mean square of joint acceleration, by physics step [rad/s²]; None where no step was seen."""
    flight: float | None
    """Share of moving steps with no foot on the ground [1]."""
    follows: bool
    """True if the command is followed."""

    @cached_property
    def ratios(self) -> tuple[float, ...]:
        """Ratio of the mean velocity to the command, of each commanded axis [1]."""
        return tuple(parse_command(self.command).axis_ratios((self.mean_vx, self.mean_vy, self.mean_wz)))


def walk_row(training: str, place: str, friction: str, row: ResultRow) -> WalkRow:
    """Return a row of results.csv, which has its mean velocity, as one of walks.csv."""
    verdict = judge_row(row)
    assert verdict is not None and row.mean_vx is not None and row.mean_vy is not None and row.mean_wz is not None
    return WalkRow(
        *(training, row.seed, place, friction, row.command, row.mean_vx, row.mean_vy, row.mean_wz, row.slowest_walk),
        *(row.fall_rate, row.joint_chatter, row.flight_share, verdict.follows),
    )


@dataclass(frozen=True)
class Walks:
    """Every walk of the report."""

    rows: Sequence[WalkRow]

    @cached_property
    def _cells(self) -> dict[tuple[str, str, str], list[WalkRow]]:
        """Training, place and friction -> rows."""
        cells: dict[tuple[str, str, str], list[WalkRow]] = {}
        for row in self.rows:
            cells.setdefault((row.training, row.place, row.friction), []).append(row)
        return cells

    def over_places(
        self,
        value: Callable[[Sequence[WalkRow]], float],
        training: str,
        places: Iterable[str],
        friction: str,
        commands: Sequence[str] = (),
    ) -> Seeds:
        """Return seed -> mean over the places of a value of its rows there, of the seeds of which it is known in each.

        commands: those that count, by their labels; none: all.
        """
        each: list[dict[int, float]] = []
        for place in places:
            own: dict[int, list[WalkRow]] = {}
            for row in self._cells.get((training, place, friction), ()):
                if not commands or row.command in commands:
                    own.setdefault(row.seed, []).append(row)
            values = {seed: value(rows) for seed, rows in own.items()}
            each.append({seed: number for seed, number in values.items() if not isnan(number)})
        seeds = set.intersection(*(set(values) for values in each)) if each else set()
        return {seed: fmean(values[seed] for values in each) for seed in sorted(seeds)}


def share_followed(rows: Sequence[WalkRow]) -> float:
    """Return the share of commands that are followed [1]."""
    return fmean(row.follows for row in rows)


def deviation(rows: Sequence[WalkRow]) -> float:
    """Return the mean over commands of |ratio - 1|, the mean over commanded axes [1]."""
    return fmean(fmean(abs(ratio - 1.0) for ratio in row.ratios) for row in rows if row.ratios)


def worst_reach(rows: Sequence[WalkRow]) -> float:
    """Return the smallest ratio over commanded axes and commands [1]; a command in whose walks one fell counts as 0."""
    return min(0.0 if row.falls else ratio for row in rows for ratio in row.ratios)


def best_reach(rows: Sequence[WalkRow]) -> float:
    """Return the largest ratio over commanded axes and commands [1]: of a robot that stands still it is small."""
    return max(ratio for row in rows for ratio in row.ratios)


def fall_rate(rows: Sequence[WalkRow]) -> float:
    """Return the share of walks with a fall [1]."""
    return fmean(row.falls for row in rows)


def chatter(rows: Sequence[WalkRow]) -> float:
    """Return the mean of the joints' acceleration [rad/s²]; NaN where it is not known of a row, or a robot fell."""
    return fmean(nan if row.chatter is None or row.falls else row.chatter for row in rows)


def flight(rows: Sequence[WalkRow]) -> float:
    """Return the mean share of moving steps with no foot on the ground [1]; 0 where none moves."""
    return fmean(row.flight or 0.0 for row in rows)


def planar_speed(rows: Sequence[WalkRow]) -> float:
    """Return the largest planar speed of the mean [m/s]; infinite after a fall."""
    return max(inf if row.falls else (row.mean_vx**2 + row.mean_vy**2) ** 0.5 for row in rows)
