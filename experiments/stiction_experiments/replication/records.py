"""The friction budget and the whole comparison as records: a page is drawn from these alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from stiction.evaluation.policies import MethodCell
from stiction.evaluation.table import Sample
from stiction.files.advice import SHARES
from stiction.files.results import ResultRow
from stiction_experiments.lab.claims import Verdict
from stiction_experiments.lab.files import row_of
from stiction_experiments.lab.straight import Following

SUMMARY = "summary.json"
"""Name of the file that has all rows."""

FEWEST_LEVELS = 3
"""Levels without which there is no curve."""

CAUSES = ("physx+nominal", "physx+friction", "physx+rest")
"""Cells of the virtual robot by which causes are told apart: robots that nobody has, whose friction limits nobody."""


@dataclass(frozen=True)
class EvidenceRow(MethodCell):
    """Column of one cell as a criterion read it; a row of evidence.csv, with the seeds as in methods.csv."""

    claim: str
    """Sentence that was judged by it."""
    column: str
    """As in `Sample`."""
    seeds: str
    """Training seeds, separated by blanks."""
    each: str
    """Value of each seed, in the same order."""


@dataclass(frozen=True)
class BudgetPoint:
    """Speed ratio of the slower direction of one training method at one level in one engine; a row of budget.csv."""

    method: str
    engine: str
    """Engine, and what of a virtual robot is real in it."""
    friction_law: str
    friction_level: float
    """Friction over the torque limit, or a coefficient [-]."""
    seeds: int
    ratio: float
    """Mean over the seeds [-]."""
    low: float | None
    """Lower end of its 95 % t-interval; None for one seed."""
    high: float | None
    each: str
    """Every seed's, separated by blanks."""


@dataclass(frozen=True)
class ForwardPoint(BudgetPoint):
    """The same of a method beside friction fed forward, over the virtual robots on which all of those methods walked.

    A row of forward.csv.
    """

    robots: int
    """Number of those robots; 0: it is the robot of the data sheet."""
    left_out: int
    """Number of the others: their benches do not tell the friction of every joint."""


@dataclass(frozen=True)
class Onset:
    """Where one training method becomes too slow in one engine; a row of onsets.csv. It may be too fast before."""

    method: str
    engine: str
    friction_law: str
    seeds: int
    level: float | None
    """Level at which the slower direction becomes too slow, mean over the seeds [-]: 0 where it is from the start, None
    where no seed is at any level it was tested at. A seed that never is counts with its highest."""
    low: float | None
    """Lower end of its 95 % t-interval; None for one seed, and where a seed stays above."""
    high: float | None
    tested: float
    """Highest level at which every seed was tested [-]."""
    each: str
    """Every seed's, separated by blanks; `>x` where it stays above up to x, the highest it was tested at."""
    dead_band: float | None
    """The level as f/kp of the shank [rad]; None where there is no level, or it is a coefficient."""


@dataclass(frozen=True)
class PartRecord:
    """One grid of the comparison."""

    name: str
    title: str
    details: Sequence[dict[str, Any]]
    """Its rows with intervals of the rates, as in summary.json."""
    warnings: Sequence[str] = ()
    """Sentences on walks that failed, with the reason."""

    @property
    def rows(self) -> list[ResultRow]:
        """Its rows as in results.csv."""
        return [row_of(row) for row in self.details]


@dataclass(frozen=True)
class Replication:
    """Everything that the page shows."""

    parts: Sequence[PartRecord]
    samples: Sequence[Sample]
    """Training methods over their seeds."""
    budget: Sequence[BudgetPoint]
    forward: Sequence[ForwardPoint]
    """Friction fed forward, and what it is held against, on the same robots."""
    onsets: Sequence[Onset]
    following: Sequence[Following]
    verdicts: Sequence[Verdict]
    evidence: Sequence[EvidenceRow]
    """Rows behind the verdicts."""
    methods: dict[str, str]
    """Training method -> what it is."""
    summary: dict[str, Any]

    @property
    def needs(self) -> tuple[Following, ...]:
        """Return the methods that follow at frictions of a user's robot, by shares of the torque limit."""
        return tuple(one for one in self.following if one.friction_law in SHARES and one.engine not in CAUSES)

    @property
    def tables(self) -> dict[str, Sequence[Any]]:
        """File -> its rows."""
        return {
            "results": [row for part in self.parts for row in part.rows],
            "methods": self.samples,
            "budget": self.budget,
            "forward": self.forward,
            "onsets": self.onsets,
            "following": self.following,
            "verdicts": self.verdicts,
            "evidence": self.evidence,
        }

    @property
    def plain(self) -> dict[str, Any]:
        """Return the content of summary.json."""
        parts = {part.name: {"title": part.title, "rows": list(part.details)} for part in self.parts}
        verdicts = [asdict(verdict) for verdict in self.verdicts]
        return self.summary | {"ways": self.methods, "verdicts": verdicts, "parts": parts}
