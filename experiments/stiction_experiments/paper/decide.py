"""How a sentence is decided: tests over training seeds, Holm's correction within a family, one outcome a test.

A `Test` has the values of each training seed. A *difference* of two trainings is judged by a t test, paired where the
seeds are the same; *no difference* by whether the 90 % interval lies within a margin; what is said of one training
alone by whether all seeds lie on one side of a bound. A *share* of votes is judged by its exact 95 % interval against
a bound.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy import stats

from stiction.core.statistics import Interval, permutation_p, t_interval
from stiction_experiments.lab.statistics import difference_interval, exact_interval

Seeds = Mapping[int, float]
"""Training seed -> value."""

Outcome = Literal["holds", "does not hold", "undecided", "not testable", "not walked"]

SIGNIFICANT = 0.05
"""Corrected p under which a difference is decided."""

MARGIN = 0.05
"""Largest difference that is none: the absolute tolerance of following [1]."""

ONE = ("above", "below", "share")
"""Kinds of a test of one training."""

FEWEST = 3
"""Seeds without which nothing is decided."""


@dataclass(frozen=True)
class Test:
    """One question with its values."""

    __test__ = False  # no test of pytest

    label: str
    """Condition under which it is asked: `20 %`, `webots, 0`."""
    first: Seeds = field(default_factory=dict)
    second: Seeds = field(default_factory=dict)
    """Values of the training that the first is compared with; empty: the first alone, with a bound."""
    kind: Literal["larger", "noticeable", "same", "above", "below", "share"] = "larger"
    """`larger`: first over second; `noticeable`: by more than `MARGIN`, or by what the interval leaves open beyond it;
    `same`: within `MARGIN`; `above`, `below`: every seed of the first, of `bound`; `share`: ones among the
    first, votes of 0 and 1, are fewer than `bound`."""
    bound: float = 0.0
    like: Seeds | None = None
    """Values of a training that differs in friction alone: `below` holds only where none of them is below too."""
    about: str = ""
    """Names of both, for the evidence: `none, deception`."""

    @property
    def walked(self) -> bool:
        """True if there are values enough."""
        if self.like is not None and len(self.like) < FEWEST:
            return False
        return len(self.first) >= FEWEST and (self.kind in ONE or len(self.second) >= FEWEST)

    @property
    def on_its_side(self) -> list[bool]:
        """True for each seed of the first that lies on the side of the bound that is asked for."""
        return [(value >= self.bound) == (self.kind == "above") for value in self.first.values()]

    @property
    def differences(self) -> np.ndarray:
        """Differences of the seeds that both have, shape (num_seeds,)."""
        return np.array([self.first[seed] - self.second[seed] for seed in sorted({*self.first} & {*self.second})])

    @property
    def paired(self) -> bool:
        """True if both have the same seeds."""
        return {*self.first} == {*self.second}

    def p(self) -> float:
        """Return the two-sided p of the difference [1]: of a t test, of a permutation where there is no spread."""
        if self.paired:
            spread = self.differences
            if np.ptp(spread) > 0.0:
                return float(stats.ttest_1samp(spread, 0.0).pvalue)
            # Without spread there is no t: as many signs alike as there are seeds.
            return 1.0 if spread[0] == 0.0 else 2.0 * 0.5 ** len(spread)
        first, second = [*self.first.values()], [*self.second.values()]
        if np.ptp(first) == np.ptp(second) == 0.0:
            return permutation_p(first, second) or 1.0
        return float(stats.ttest_ind(first, second, equal_var=False).pvalue)

    def interval(self, share: float) -> Interval:
        """Return the interval of the mean difference, or of the share of votes; `walked` is True.

        share: probability with which it holds the true one.
        """
        if self.kind == "share":
            return exact_interval(int(sum(self.first.values())), len(self.first), share)
        if self.paired:
            interval = t_interval(self.differences.tolist(), share)
        else:
            interval = difference_interval([*self.first.values()], [*self.second.values()], share)
        assert interval is not None
        return interval


@dataclass(frozen=True)
class Decision:
    """Outcome of one test."""

    test: Test
    outcome: Outcome
    p: float | None
    """Corrected; None of a test without."""

    @property
    def evidence(self) -> str:
        """Numbers behind it: `0.93 and 0.71, difference 0.22 [0.15, 0.29], p 0.002`."""
        test = self.test
        if not test.walked:
            seeds = f"{len(test.first)}{'' if test.kind in ONE else f' and {len(test.second)}'} seeds"
            return f"{test.label}: {f'{len(test.first)} votes' if test.kind == 'share' else seeds}"
        if test.kind == "share":
            low, high = test.interval(0.95)
            yes, votes = sum(test.first.values()), len(test.first)
            return f"{test.label}: {yes:.0f} of {votes}, share {yes / votes:.2f} [{low:.2f}, {high:.2f}]"
        text = f"{test.label}: {spread_text(test.first)}"
        if test.kind in ("above", "below"):
            yes = sum(test.on_its_side)
            text += f", {yes} of {len(test.first)} {test.kind} {test.bound:g}"
            if yes == len(test.first):
                text += f", share at least {exact_interval(yes, yes, 0.95)[0]:.2f}"
        if test.second:
            low, high = test.interval(0.9 if test.kind in ("same", "noticeable") else 0.95)
            difference = np.mean([*test.first.values()]) - np.mean([*test.second.values()])
            text += f" and {spread_text(test.second)}, difference {difference:+.2f} [{low:+.2f}, {high:+.2f}]"
        return text + ("" if self.p is None else f", p {self.p:.2g}")


def spread_text(seeds: Seeds) -> str:
    """Return mean, smallest and largest of the seeds: `0.93 (0.90 to 0.95, 5 seeds)`."""
    values = [*seeds.values()]
    return f"{np.mean(values):.2f} ({min(values):.2f} to {max(values):.2f}, {len(values)} seeds)"


def holm(ps: Sequence[float]) -> list[float]:
    """Return Holm's corrected p of each (Holm 1979): the k-th smallest of m times m - k + 1, monotonous, at most 1."""
    order, corrected, largest = np.argsort(ps), [0.0] * len(ps), 0.0
    for rank, index in enumerate(order):
        largest = max(largest, min(1.0, (len(ps) - rank) * ps[index]))
        corrected[index] = largest
    return corrected


def decide(tests: Sequence[Test]) -> list[Decision]:
    """Decide the tests of one family together, in their order."""
    compared = [test for test in tests if test.walked and test.kind in ("larger", "noticeable")]
    corrected = dict(zip(map(id, compared), holm([test.p() for test in compared]), strict=True))
    return [Decision(test, _outcome(test, corrected.get(id(test))), corrected.get(id(test))) for test in tests]


def _outcome(test: Test, p: float | None) -> Outcome:
    """Return the outcome of a test; p: corrected, of a difference."""
    if not test.walked:
        return "not walked"
    if test.kind in ("same", "noticeable"):
        low, high = test.interval(0.9)
        if low >= -MARGIN and high <= MARGIN:
            return "holds" if test.kind == "same" else "does not hold"
        if test.kind == "same":
            return "does not hold" if high < -MARGIN or low > MARGIN else "undecided"
    if test.kind == "share":
        low, high = test.interval(0.95)
        return "holds" if high < test.bound else "does not hold" if low > test.bound else "undecided"
    if p is not None:
        if p >= SIGNIFICANT:
            return "undecided"
        return "holds" if np.mean([*test.first.values()]) > np.mean([*test.second.values()]) else "does not hold"
    sides = {*test.on_its_side}
    if sides == {True} and any(value < test.bound for value in (test.like or {}).values()):
        return "undecided"
    return "undecided" if len(sides) > 1 else "holds" if True in sides else "does not hold"


def joined(decisions: Sequence[Decision]) -> str:
    """Return what a sentence comes to over its conditions: `holds at 10, 20 %; undecided at 1 %`."""
    outcomes = {decision.outcome for decision in decisions}
    if len(outcomes) == 1:
        return outcomes.pop()
    order: tuple[Outcome, ...] = ("holds", "does not hold", "undecided", "not walked")
    parts = []
    for outcome in order:
        if labels := [decision.test.label for decision in decisions if decision.outcome == outcome]:
            parts.append(f"{outcome}: {', '.join(labels)}")
    return "; ".join(parts)
