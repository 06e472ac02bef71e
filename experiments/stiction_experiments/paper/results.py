"""Everything that sentences are judged by, and what a training seed is worth in it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any

from stiction_experiments.paper.climbs import Climbed
from stiction_experiments.paper.configurations import Configuration
from stiction_experiments.paper.decide import Seeds
from stiction_experiments.paper.estimator import EstimateRow
from stiction_experiments.paper.gaits import Gait
from stiction_experiments.paper.lives import Life
from stiction_experiments.paper.rows import WalkRow, Walks

HALF = 0.5
"""Share of touch-downs from which on a gait is a pronk; of a command, that is reached in the course of a training."""

Value = Callable[[Sequence[WalkRow]], float]


@dataclass(frozen=True)
class Learning:
    """Learning of one seed, from curves.csv and ledger.csv."""

    training: str
    seed: int
    area: float
    """Mean tracking error over the control steps of the training [m/s]."""
    reached: float = 0.0
    """Iteration at which robots that are told to walk forward first reach half of it; behind the last one where they
    never do."""
    seconds: float | None = None
    """Processor time of the training, with logs and nets [s]; None where it was trained before."""


@dataclass(frozen=True)
class Results:
    """Everything that sentences are judged by."""

    walks: Walks
    learned: Sequence[Learning] = ()
    stairs: Sequence[Climbed] = ()
    gaits: Sequence[Gait] = ()
    lives: Sequence[Life] = ()
    estimates: Sequence[EstimateRow] = ()
    configurations: Sequence[Configuration] = ()

    def at(self, value: Value, training: str, place: str | Sequence[str], friction: str, *commands: str) -> Seeds:
        """Return seed -> value in a place, or the mean over several."""
        places = (place,) if isinstance(place, str) else place
        return self.walks.over_places(value, training, places, friction, commands)

    def of_curve(self, training: str, name: str) -> Seeds:
        """Return seed -> a number of its learning."""
        return _by_seed(self.learned, name, training=training)

    def crossed(self, training: str, place: str, friction: str, height: float) -> Seeds:
        """Return seed -> share of walks that cross stairs."""
        return _by_seed(self.stairs, "crossed", training=training, place=place, friction=friction, height=height)

    def gait(self, training: str, name: str) -> Seeds:
        """Return seed -> a number of its gait, of the seeds that walk."""
        return _by_seed(self.gaits, name, training=training)

    def pronk(self, training: str) -> Seeds:
        """Return seed -> share of touch-downs with all feet; 0 of one that stands still."""
        return {row.seed: row.pronk or 0.0 for row in self.gaits if row.training == training}

    def trot(self, training: str) -> Seeds:
        """Return seed -> share of steps in which each contact group is in phase; 0 of a pronk, and of who stands."""
        own = [row for row in self.gaits if row.training == training]
        return {row.seed: 0.0 if (row.pronk or 0.0) >= HALF else row.in_phase or 0.0 for row in own}

    def life(self, training: str, name: str) -> Seeds:
        """Return seed -> mean over robots and commands of a number of its lives."""
        own = [row for row in self.lives if row.training == training]
        return {
            seed: fmean(getattr(row, name) for row in own if row.seed == seed) for seed in {row.seed for row in own}
        }

    def errors(self, estimator: str, parameter: str) -> Seeds:
        """Return draw -> relative error of a parameter by an estimator."""
        own = [row for row in self.estimates if (row.estimator, row.parameter) == (estimator, parameter)]
        return {row.draw: row.error for row in own}


def _by_seed(rows: Iterable[Any], name: str, **same: object) -> Seeds:
    """Return seed -> a field, of the rows whose other fields are the same, where it is known."""
    own = [row for row in rows if all(getattr(row, field) == value for field, value in same.items())]
    return {row.seed: getattr(row, name) for row in own if getattr(row, name) is not None}
