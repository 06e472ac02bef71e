"""Rules by which a sentence is judged: a criterion on means over training seeds, by their 95 % intervals.

An interval wholly on one side of the criterion decides; one that straddles it does not, and the outcome says so. A
single seed carries no verdict, whatever it shows: its number is given.

A rate, such as the share of walks that end in a fall, has a second interval, and is decided where both are on the same
side. The t-interval of the seeds' rates knows how much the outcome of a training varies, but not how many walks there
were: where every seed has the same rate, it shrinks to a point. Wilson's interval of all walks together knows their
number, but not the seeds.

Neither knows how robots differ: every seed walks on the same virtual robots. Where they do, what is measured also has
an interval with the robots as the sample, and is decided where that one agrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stiction.formats.climb import wilson
from stiction.formats.experiment import Outcome
from stiction.formats.following import pace
from stiction.transfer.experiment.table import Points
from stiction.transfer.statistics import Interval, difference_interval, t_interval

ABOVE_ZERO = float(np.nextafter(0.0, 1.0))
"""Least difference that is one: two samples that are the same do not differ."""


@dataclass(frozen=True)
class Finding:
    """What a rule found."""

    outcome: Outcome
    """The verdict."""
    evidence: str
    """The numbers behind it."""


@dataclass(frozen=True)
class Rate:
    """How often something happened in the walks of a way of training."""

    points: Points
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


def side(interval: Interval, low: float, high: float) -> Outcome:
    """Return whether an interval lies within [low, high], outside of it, or neither."""
    if low <= interval[0] and interval[1] <= high:
        return "reproduces"
    if interval[1] < low or interval[0] > high:
        return "does not"
    return "undecided"


def describe(label: str, points: Points) -> str:
    """Return points as text: `direct 0.93 [0.88, 0.98] (0.90, 0.95, 0.94)`, mean, t-interval, every seed."""
    if not points:
        return f"{label} not evaluated"
    values = list(points.values())
    interval = t_interval(values)
    if interval is None:
        return f"{label} {values[0]:.2f} (one seed)"
    seeds = ", ".join(f"{value:.2f}" for value in values)
    return f"{label} {np.mean(values):.2f} [{interval[0]:.2f}, {interval[1]:.2f}] ({seeds})"


def within(label: str, points: Points, low: float, high: float) -> Finding:
    """Judge that the mean over seeds lies within [low, high]."""
    evidence = describe(label, points)
    interval = t_interval(list(points.values()))
    if interval is None:
        return Finding("not tested", evidence)
    return Finding(side(interval, low, high), evidence)


def all_follow(found: Finding, slower: Points, faster: Points, falls: Points) -> Finding:
    """Judge that every training seed follows, where `found` says that their mean does: one that does not refutes it.

    slower, faster: speed ratios of each seed's two directions; falls: share of its walks that end in a fall.
    """
    if found.outcome == "not tested":
        return found
    wrong = {
        "too slow": [seed for seed, ratio in slower.items() if pace(ratio) == "too slow"],
        "too fast": [seed for seed, ratio in faster.items() if pace(ratio) == "too fast"],
        "fell": [seed for seed, rate in falls.items() if rate > 0.0],
    }
    follow = len(slower.keys() - {seed for seeds in wrong.values() for seed in seeds})
    said = (f"{follow} of {len(slower)} seeds follow", *(f"{len(own)} {name}" for name, own in wrong.items() if own))
    return Finding(found.outcome if follow == len(slower) else "does not", f"{found.evidence}; {', '.join(said)}")


def rate_within(label: str, rate: Rate, low: float, high: float) -> Finding:
    """Judge that a rate lies within [low, high]: over the seeds, over all trials, and over virtual robots."""
    found = within(label, rate.points, low, high)
    if not rate.trials:
        return found
    found = confirmed(found, f"{rate.trials} trials", rate.interval, low, high)
    ends = rate.robots_interval
    return found if ends is None else confirmed(found, f"{rate.robots} robots", ends, low, high)


def confirmed(found: Finding, sample: str, interval: Interval, low: float, high: float) -> Finding:
    """Return a finding that another interval was held against: undecided where that one does not agree.

    sample: what the other interval is over, for the evidence.
    """
    agree = found.outcome in ("not tested", side(interval, low, high))
    evidence = f"{found.evidence}, {sample} [{interval[0]:.2f}, {interval[1]:.2f}]"
    return Finding(found.outcome if agree else "undecided", evidence)


def larger(first: tuple[str, Points], second: tuple[str, Points]) -> Finding:
    """Judge that the first sample's mean is larger than the second's, by Welch's interval of the difference."""
    evidence = f"{describe(*first)}; {describe(*second)}"
    interval = difference_interval(list(first[1].values()), list(second[1].values()))
    if interval is None:
        return Finding("not tested", evidence)
    text = f"{evidence}; difference [{interval[0]:.2f}, {interval[1]:.2f}]"
    return Finding(side(interval, ABOVE_ZERO, np.inf), text)


def larger_paired(first: tuple[str, Points], second: tuple[str, Points]) -> Finding:
    """Judge that the first is larger for the same policies, by the t-interval of the differences seed by seed."""
    evidence = f"{describe(*first)}; {describe(*second)}"
    seeds = sorted(first[1].keys() & second[1].keys())
    interval = t_interval([first[1][seed] - second[1][seed] for seed in seeds])
    if interval is None:
        return Finding("not tested", evidence)
    text = f"{evidence}; difference, policy by policy, [{interval[0]:.2f}, {interval[1]:.2f}]"
    return Finding(side(interval, ABOVE_ZERO, np.inf), text)


def all_of(*findings: Finding) -> Finding:
    """Judge that several things hold together: it fails with one that does not, and stands when all do."""
    outcomes = [finding.outcome for finding in findings]
    evidence = "; ".join(finding.evidence for finding in findings)
    for outcome in ("does not", "not tested", "undecided"):
        if outcome in outcomes:
            return Finding(outcome, evidence)
    return Finding("reproduces", evidence)


def any_of(*findings: Finding) -> Finding:
    """Judge that at least one of several things holds: it stands with one that does, and fails when none does."""
    if holding := [finding.evidence for finding in findings if finding.outcome == "reproduces"]:
        return Finding("reproduces", "; ".join(holding))
    outcomes = [finding.outcome for finding in findings]
    evidence = "; ".join(finding.evidence for finding in findings)
    for outcome in ("not tested", "undecided"):
        if outcome in outcomes:
            return Finding(outcome, evidence)
    return Finding("does not", evidence)


def over_levels(findings: Sequence[tuple[float, Finding]]) -> Finding:
    """Judge a sentence that names no level: at every level above zero, at none, only above x, or only up to x.

    `findings`: level -> whether the sentence holds there, from low to high. Above x: it is refuted at x and at every
    level below, and holds at the highest. Up to x: it holds at x and at every level below, and is refuted at the
    highest. Levels next to x on its far side may be undecided, and no others; the evidence names them. Otherwise
    undecided. Levels that could not be tested do not count; the evidence then says which were judged.
    """
    above = [(level, finding) for level, finding in findings if level > 0]
    tested = [(level, finding) for level, finding in above if finding.outcome != "not tested"]
    if not tested:
        return Finding("not tested", "; ".join(f"at {level:g}: {finding.evidence}" for level, finding in above))
    outcomes = [finding.outcome for _, finding in tested]
    changes = [index for index in range(1, len(tested)) if outcomes[index] != outcomes[index - 1]]
    # A reader wants the levels about the changes, or the ends where there is none.
    telling = (changes[0] - 1, *changes) if changes else sorted({0, len(tested) - 1})
    at = "; ".join(f"at {tested[index][0]:g}: {tested[index][1].evidence}" for index in telling)
    if left := _levels(above, "not tested"):
        at = f"{at}; judged at {', '.join(f'{level:g}' for level, _ in tested)} alone, not tested at {left}"
    if not changes:
        return Finding(outcomes[0], at)
    sides = [outcomes[0], *(outcomes[index] for index in changes)]
    if "undecided" in sides[1:-1]:
        sides.remove("undecided")
    if sides in (["does not", "reproduces"], ["reproduces", "does not"]):
        limit: Outcome = "only above x" if outcomes[-1] == "reproduces" else "only up to x"
        still = f"undecided at {levels}; " if (levels := _levels(tested, "undecided")) else ""
        return Finding(limit, f"x = {tested[changes[0] - 1][0]:g}; {still}{at}")
    words: tuple[tuple[str, Outcome], ...]
    words = (("it holds", "reproduces"), ("is refuted", "does not"), ("undecided", "undecided"))
    where = ", ".join(f"{word} at {levels}" for word, outcome in words if (levels := _levels(tested, outcome)))
    return Finding("undecided", f"{where}; {at}")


def _levels(findings: Sequence[tuple[float, Finding]], outcome: Outcome) -> str:
    """Return the levels of an outcome as text."""
    return ", ".join(f"{level:g}" for level, finding in findings if finding.outcome == outcome)
