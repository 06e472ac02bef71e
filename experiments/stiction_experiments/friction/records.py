"""Records and files of the experiment on training with friction: a page is drawn from these alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from stiction.files.results import ResultRow
from stiction_experiments.friction.planned import State
from stiction_experiments.lab.claims import Verdict
from stiction_experiments.lab.straight import Following

STUDENT = "student"
"""Deployed and judged policy of a run's two."""

HIGHEST = 0.3
"""Highest friction level that counts in means over levels, and in tables [-]."""


def short_name(condition: str) -> str:
    """Return a condition's name as pages and evidence have it."""
    return condition.removeprefix("coulomb20-")


@dataclass(frozen=True)
class ConditionRecord:
    """One training method, as the manifest has it."""

    name: str
    """Name of its runs without the seed."""
    part: str
    purpose: str
    arguments: str
    """Words for `stiction train`, without preset, seed and folder."""
    robot: str
    law: str
    """Friction law that it was trained and is evaluated with."""
    nominal: float
    """Nominal friction level [-]."""
    training_mean: float
    """Mean friction level of the last stage of training [-]."""


@dataclass(frozen=True)
class RunRecord:
    """One run of the manifest."""

    name: str
    condition: str
    seed: int
    state: State
    """Where it stood when this was written."""
    revision: str
    """Code that trained it; empty where it has not begun."""
    minutes: float | None
    """Time that it took [min]; None where it is not finished."""


@dataclass(frozen=True)
class SeedMean:
    """The mean speed ratio of a condition over its seeds; a row of intervals.csv. The seeds are in results.csv."""

    condition: str
    who: str
    friction_law: str
    friction_level: float
    """Level of the evaluation [-]."""
    command: str
    seeds: int
    mean: float
    """Mean speed ratio over seeds [-]."""
    low: float | None
    """Lower end of the 95 % t-interval of that mean; None with one seed."""
    high: float | None


@dataclass(frozen=True)
class CurvePoint:
    """One point of the learning curves; a row of curves.csv. Of the randomised training, not of an evaluation."""

    run: str
    phase: str
    iteration: int
    """Iteration of the phase, the last of those averaged."""
    forward_ratio: float
    """Speed over commanded speed while forward is commanded [-]."""
    backward_ratio: float


@dataclass(frozen=True)
class LearnedFigure:
    """Last metrics of a training's code or disturber; a row of learned.csv."""

    run: str
    figure: str
    """Its name in the run's metrics: `code/kl`, `hinf/eta`."""
    iterations: int
    """Last iterations of which this is the mean."""
    mean: float


@dataclass(frozen=True)
class Experiment:
    """Everything that the experiment's page shows."""

    rows: Sequence[ResultRow]
    curves: Sequence[CurvePoint]
    conditions: Sequence[ConditionRecord]
    """The training methods in the parts that were asked for."""
    runs: Sequence[RunRecord]
    parts: dict[str, str]
    summary: dict[str, Any]
    """Provenance of the runs, and the settings of the evaluation."""
    means: Sequence[SeedMean] = ()
    verdicts: Sequence[Verdict] = ()
    following: Sequence[Following] = ()
    """Seeds that follow, by condition and policy, `coulomb20-none/student`."""
    learned: Sequence[LearnedFigure] = ()
    """Learned figures of the trainings whose folders are or were here."""

    @property
    def tables(self) -> dict[str, Sequence[Any]]:
        """File -> its rows."""
        judged = {"results": self.rows, "intervals": self.means, "following": self.following}
        return judged | {"curves": self.curves, "learned": self.learned}

    @property
    def plain(self) -> dict[str, Any]:
        """Return the content of summary.json: all that is in no table."""
        names = ("conditions", "runs", "verdicts")
        lists = {name: [asdict(record) for record in getattr(self, name)] for name in names}
        return self.summary | {"parts": self.parts} | lists
