"""The friction budget and the whole comparison as records: a page is drawn from these alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from stiction.formats.experiment import Verdict
from stiction.formats.grid import MethodMean
from stiction.formats.results import ResultRow, write_results, write_summary
from stiction.formats.rows import write_rows


@dataclass(frozen=True)
class BudgetPoint:
    """Speed ratio of the slower direction of one way of training at one level in one engine; a row of budget.csv."""

    method: str
    """Way of training."""
    engine: str
    """Engine, and what of a virtual robot is real in it."""
    friction_law: str
    """Law of the friction."""
    friction_level: float
    """Friction over the torque limit, or a coefficient [-]."""
    seeds: int
    """Training seeds."""
    ratio: float
    """Mean over the seeds [-]."""
    low: float | None
    """Lower end of its 95 % t-interval; None for one seed."""
    high: float | None
    """Upper end."""
    each: str
    """Every seed's, separated by blanks."""


@dataclass(frozen=True)
class Onset:
    """Where one way of training falls under 80 % of the command in one engine; a row of onsets.csv."""

    method: str
    """Way of training."""
    engine: str
    """Engine."""
    friction_law: str
    """Law of the friction."""
    seeds: int
    """Training seeds."""
    level: float | None
    """Level at which the slower direction falls under it, mean over the seeds [-]: 0 where it is under from the start,
    None where every seed stays above at every tested level. A seed that does counts with the highest of them."""
    low: float | None
    """Lower end of its 95 % t-interval; None for one seed, and where a seed stays above."""
    high: float | None
    """Upper end."""
    tested: float
    """Highest level that was tested [-]."""
    each: str
    """Every seed's, separated by blanks; `>x` where it stays above up to the highest level x."""
    dead_band: float | None
    """The level as f/kp of the shank [rad]; None where there is no level, or it is a coefficient."""


@dataclass(frozen=True)
class PartRecord:
    """One grid of the comparison."""

    name: str
    """Name of its folder."""
    title: str
    """What it asks."""
    rows: Sequence[ResultRow]
    """Its rows."""
    details: Sequence[dict[str, Any]]
    """The same with intervals of the rates, as in summary.json."""


@dataclass(frozen=True)
class Replication:
    """Everything that the page shows."""

    parts: Sequence[PartRecord]
    """The grids."""
    means: Sequence[MethodMean]
    """Ways of training over their seeds."""
    budget: Sequence[BudgetPoint]
    """The friction budget."""
    onsets: Sequence[Onset]
    """Where each way falls under 80 %."""
    verdicts: Sequence[Verdict]
    """One a sentence."""
    ways: dict[str, str]
    """Way of training -> what it is."""
    summary: dict[str, Any]
    """What was run, on what."""

    def write(self, out: Path) -> None:
        """Write results.csv, methods.csv, budget.csv, onsets.csv, verdicts.csv and summary.json into a folder."""
        write_results(out / "results.csv", [row for part in self.parts for row in part.rows])
        tables = {"methods": self.means, "budget": self.budget, "onsets": self.onsets, "verdicts": self.verdicts}
        for name, records in tables.items():
            if records:
                write_rows(out / f"{name}.csv", records)
            else:
                (out / f"{name}.csv").unlink(missing_ok=True)
        parts = {part.name: {"title": part.title, "rows": list(part.details)} for part in self.parts}
        verdicts = [asdict(verdict) for verdict in self.verdicts]
        write_summary(out / "summary.json", self.summary | {"ways": self.ways, "verdicts": verdicts, "parts": parts})
