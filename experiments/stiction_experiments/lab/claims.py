"""Claims, and the rules by which they are judged.

A criterion is about means over training seeds, by their 95 % t-intervals. An interval wholly on one side of the
criterion decides; one that straddles it does not. A single seed carries no verdict, its number is given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

import numpy as np

from stiction.core.statistics import Interval, t_interval
from stiction.evaluation.samples import SeedValues

Outcome = Literal["reproduces", "does not", "undecided", "not tested"]

JUDGED = (
    "Numbers are means over training seeds with their 95 % t-interval in brackets and every seed in parentheses. "
    "`undecided`: the interval straddles the criterion. One seed carries no verdict: `not tested`, with its "
    "number. Each sentence is judged by itself at 95 %: the number of sentences is not corrected for."
)
"""Note for readers of the verdicts."""


@dataclass(frozen=True)
class Finding:
    """Verdict of a rule, and the numbers behind it."""

    outcome: Outcome
    evidence: str


@dataclass(frozen=True)
class Verdict:
    """Verdict on one sentence; a row of claims.csv, and an entry of summary.json."""

    id: str
    sentence: str
    criterion: str
    """Condition for the sentence to reproduce."""
    outcome: Outcome
    evidence: str


Results = TypeVar("Results")
"""Type of a study's results."""


@dataclass(frozen=True)
class Claim(Generic[Results]):
    """One sentence, and how it is judged; fields as of `Verdict`."""

    id: str
    sentence: str
    criterion: str
    judge: Callable[[Results], Finding]
    """The criterion as a function of the results."""

    def verdict(self, results: Results) -> Verdict:
        """Return what became of the sentence."""
        finding = self.judge(results)
        return Verdict(self.id, self.sentence, self.criterion, finding.outcome, finding.evidence)


Labelled = tuple[str, SeedValues]
"""A name for the evidence, and the number."""


def side(interval: Interval, low: float, high: float) -> Outcome:
    """Return whether an interval lies within [low, high], outside of it, or neither."""
    if low <= interval[0] and interval[1] <= high:
        return "reproduces"
    if interval[1] < low or interval[0] > high:
        return "does not"
    return "undecided"


def describe(label: str, seeds: SeedValues) -> str:
    """Return mean, t-interval and every seed as text: `direct 0.93 [0.88, 0.98] (0.90, 0.95, 0.94)`."""
    if not seeds:
        return f"{label} not evaluated"
    values = list(seeds.values())
    interval = t_interval(values)
    if interval is None:
        return f"{label} {values[0]:.2f} (one seed)"
    each = ", ".join(f"{value:.2f}" for value in values)
    return f"{label} {np.mean(values):.2f} {_text(interval)} ({each})"


def within(label: str, seeds: SeedValues, low: float, high: float) -> Finding:
    """Judge that the mean over seeds lies within [low, high]; one seed carries no verdict."""
    interval = t_interval([*seeds.values()])
    outcome: Outcome = "not tested" if interval is None else side(interval, low, high)
    return Finding(outcome, describe(label, seeds))


def _text(interval: Interval) -> str:
    return f"[{interval[0]:.2f}, {interval[1]:.2f}]"


def all_of(*findings: Finding) -> Finding:
    """Judge that several things hold together: it fails with one that does not, and stands when all do."""
    outcomes = {finding.outcome for finding in findings}
    order: tuple[Outcome, ...] = ("does not", "not tested", "undecided", "reproduces")
    first = next(outcome for outcome in order if outcome in outcomes)
    return Finding(first, "; ".join(finding.evidence for finding in findings))
