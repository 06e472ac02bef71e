"""Claims, and the rules by which they are judged.

A criterion is about means over training seeds, by their 95 % t-intervals. An interval wholly on one side of the
criterion decides; one that straddles it does not. A single seed carries no verdict, its number is given.

All policies walk on the same virtual robots: an interval over seeds holds for other trainings on these robots, one over
robots for these trainings on other robots. What is measured on virtual robots is decided where both agree; without
robots (the robot of the data sheet) the seeds decide alone.

A rate, such as the share of walks that end in a fall, also has Wilson's interval over its trials, and over robots, and
is decided where they agree with the seeds: where every seed has the same rate, such as none, the t-interval is a point.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

import numpy as np

from stiction.core.statistics import Interval, t_interval
from stiction.evaluation.samples import Condition, Rate, SeedValues
from stiction.files.results import DIRECTIONS, FOLLOWS
from stiction_experiments.lab.evidence import Evidence, Measurement
from stiction_experiments.lab.statistics import difference_interval
from stiction_experiments.lab.straight import BAND, pace

Outcome = Literal["reproduces", "does not", "only above x", "only up to x", "undecided", "not tested"]

LIMITS = (
    "`only above` some friction: the sentence does not hold there or at less, and holds at more; `only up to`: it "
    "holds there and at less, and does not at more. Next to that friction, on the other side, levels may be open: the "
    "evidence names them, and the levels that could not be judged."
)
"""Meaning of the outcomes with an x, a friction."""

SAID = {
    "reproduces": ("holds", "hold"),
    "only above x": ("holds only above some friction", "hold only above some friction"),
    "only up to x": ("holds only up to some friction", "hold only up to some friction"),
    "does not": ("does not hold", "do not hold"),
    "undecided": ("is undecided", "are undecided"),
    "not tested": ("was not tested", "were not tested"),
}
"""Outcome -> what a person says of one sentence, and of several, of which that came out."""


def said_of(verdicts: Sequence[Verdict], what: str) -> str:
    """Return how many sentences came out how, as a sentence to be read aloud; what: `sentences of the paper`."""
    counts = {outcome: sum(one.outcome == outcome for one in verdicts) for outcome in SAID}
    listed = [f"{count} {SAID[outcome][count > 1]}" for outcome, count in counts.items() if count]
    return f"Of {len(verdicts)} {what}, {', '.join(listed[:-1])}{' and ' if listed[1:] else ''}{listed[-1]}."


JUDGED = (
    "Numbers are means over training seeds with their 95 % t-interval in brackets and every seed in parentheses. "
    f"`undecided`: the interval straddles the criterion. {LIMITS} One seed carries no verdict: `not tested`, with its "
    "number. Each sentence is judged by itself at 95 %: the number of sentences is not corrected for."
)
"""Note for readers of the verdicts."""

ABOVE_ZERO = float(np.nextafter(0.0, 1.0))
"""Least difference that is one: two samples that are the same do not differ."""

STABLE = 1 / 3
"""Share of walks that may fall of a robot that is stable. No fall on eight robots shows that the rate over robots is
under it (Wilson: 0.324), however many policies walked on them; so does no fall in twelve walks on the robot of the data
sheet (0.242), and none in six does not (0.390)."""


def in_words(share: float) -> str:
    """Return a share as a criterion says it: `half`, `a third`, else in per cent."""
    return {1 / 2: "half", 1 / 3: "a third", 1 / 4: "a quarter"}.get(share, f"{100 * share:g} %")


FOLLOWING = (
    f"{BAND} both ways by every seed, on each virtual robot, and no fall, and falls shown to be in under "
    f"{in_words(STABLE)} of walks"
)
"""Definition of `follows` in criteria."""


@dataclass(frozen=True)
class Finding:
    """Verdict of a rule, and the numbers behind it."""

    outcome: Outcome
    evidence: str


@dataclass(frozen=True)
class Verdict:
    """Verdict on one sentence; a row of claims.csv or verdicts.csv, and an entry of summary.json."""

    id: str
    sentence: str
    criterion: str
    """Condition for the sentence to reproduce."""
    outcome: Outcome
    evidence: str


Results = TypeVar("Results")
"""Type of a study's results: an `Evidence`, or rows of its own."""


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


def changed_verdicts(
    before: Iterable[Verdict], now: Iterable[Verdict], earlier: Iterable[Mapping[str, Any]] = ()
) -> list[dict[str, Any]]:
    """Return the sentences whose outcome differs between two judgements of the same rows, with both criteria.

    earlier: changes that were known before: of such a sentence the first outcome stays.
    """
    first = {verdict.id: (verdict.outcome, verdict.criterion) for verdict in before}
    first |= {one["id"]: (one["before"], one["asked_before"]) for one in earlier}
    pairs = ((first[verdict.id], verdict) for verdict in now if verdict.id in first)
    return [
        {"id": v.id, "before": outcome, "asked_before": asked, "now": v.outcome, "asked": v.criterion}
        for (outcome, asked), v in pairs
        if outcome != v.outcome
    ]


def rejudged_summary(
    before: Mapping[str, Any],
    verdicts: Iterable[Verdict],
    now: Iterable[Verdict],
    provenance: Mapping[str, Any],
    own: Iterable[str],
) -> dict[str, Any]:
    """Return what summary.json keeps where its rows are judged anew, with `judged` and `changed`.

    before: the summary, with `verdicts`; now: those of today; provenance: by what the rows are judged now; own: entries
    that are written anew, beside verdicts and parts.
    """
    anew = {"schema_version", "verdicts", "parts", *own}
    unchanged = {name: value for name, value in before.items() if name not in anew}
    return unchanged | {"judged": provenance, "changed": changed_verdicts(verdicts, now, before.get("changed", []))}


Labelled = tuple[str, Measurement]
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


def within(label: str, measured: Measurement, low: float, high: float) -> Finding:
    """Judge that the mean lies within [low, high], over seeds and over robots."""
    return _judged(describe(label, measured.seeds), t_interval([*measured.seeds.values()]), measured.robots, low, high)


def larger(first: Labelled, second: Labelled) -> Finding:
    """Judge that the first mean is larger, over seeds by Welch's interval, over robots by that of the differences."""
    interval = difference_interval([*first[1].seeds.values()], [*second[1].seeds.values()])
    return _compared(first, second, "difference", interval)


def larger_paired(first: Labelled, second: Labelled) -> Finding:
    """Judge that the first is larger for the same policies, and on the same robots, by the differences of each."""
    interval = t_interval([*differences(first[1].seeds, second[1].seeds).values()])
    return _compared(first, second, "difference, policy by policy,", interval)


def differences(first: Mapping[int, float], second: Mapping[int, float]) -> SeedValues:
    """Return the differences of seeds, or of robots, that both have."""
    return {key: first[key] - second[key] for key in sorted(first.keys() & second.keys())}


def _compared(first: Labelled, second: Labelled, what: str, interval: Interval | None) -> Finding:
    """Judge that a difference is above zero, by its interval over seeds and, robot by robot, by that over robots."""
    evidence = f"{describe(first[0], first[1].seeds)}; {describe(second[0], second[1].seeds)}"
    if interval is not None:
        evidence = f"{evidence}; {what} {_text(interval)}"
    return _judged(evidence, interval, differences(first[1].robots, second[1].robots), ABOVE_ZERO, np.inf)


def _judged(evidence: str, interval: Interval | None, robots: Mapping[int, float], low: float, high: float) -> Finding:
    """Judge that both an interval over seeds and that over robots, if there are any, lie within [low, high].

    One seed, whose interval is None, carries no verdict, and neither does one robot.
    """
    if interval is None:
        return Finding("not tested", evidence)
    finding = Finding(side(interval, low, high), evidence)
    if not robots:
        return finding
    over_robots = t_interval([*robots.values()])
    if over_robots is None:
        return Finding("not tested", f"{evidence}, one robot")
    return confirmed(finding, f"{len(robots)} robots", over_robots, low, high)


def rate_within(label: str, rate: Rate, low: float, high: float) -> Finding:
    """Judge that a rate lies within [low, high]: over the seeds, over all trials, and over virtual robots."""
    finding = within(label, Measurement(rate.seeds), low, high)
    if not rate.trials:
        return finding
    finding = confirmed(finding, f"{rate.trials} trials", rate.interval, low, high)
    ends = rate.robots_interval
    return finding if ends is None else confirmed(finding, f"{rate.robots} robots", ends, low, high)


def confirmed(finding: Finding, sample: str, interval: Interval, low: float, high: float) -> Finding:
    """Return a finding that another interval was held against: undecided where that one does not agree.

    sample: what the other interval is over, for the evidence.
    """
    agree = finding.outcome in ("not tested", side(interval, low, high))
    return Finding(finding.outcome if agree else "undecided", f"{finding.evidence}, {sample} {_text(interval)}")


def _text(interval: Interval) -> str:
    return f"[{interval[0]:.2f}, {interval[1]:.2f}]"


def follows(e: Evidence, method: str, condition: Condition, label: str) -> Finding:
    """Judge that a method follows: every training seed in both directions, on each virtual robot, and nobody falls.

    One seed that does not, or a single fall, refutes it. That nobody fell in the walks that there were shows no more
    than the upper end of Wilson's interval: it must be under `STABLE`, in each direction.
    """
    slower, faster = e.slower(method, condition), e.faster(method, condition)
    rates = {vx: e.rate(method, condition, (vx,), "fall_rate") for vx in DIRECTIONS}
    mean = all_of(within(f"{label}, slower direction", slower, *FOLLOWS), within("faster direction", faster, *FOLLOWS))
    if mean.outcome == "not tested":
        return mean
    ends = e.ends(method, condition)
    wrong = {
        "too slow": {seed for seed, (low, _) in ends.items() if pace(low) == "too slow"},
        "too fast": {seed for seed, (_, high) in ends.items() if pace(high) == "too fast"},
        "fell": {seed for rate in rates.values() for seed, share in rate.seeds.items() if share > 0.0},
    }
    follow = len(slower.seeds.keys() - set.union(*wrong.values()))
    counts = (f"{follow} of {len(slower.seeds)} seeds follow", *(f"{len(w)} {name}" for name, w in wrong.items() if w))
    falls = (rate_within(f"{label}, falls at {vx}", rate, -np.inf, STABLE) for vx, rate in rates.items())
    every = Finding("reproduces" if follow == len(slower.seeds) else "does not", ", ".join(counts))
    return all_of(mean, every, *falls)


def all_of(*findings: Finding) -> Finding:
    """Judge that several things hold together: it fails with one that does not, and stands when all do."""
    return _first(findings, "does not", "not tested", "undecided", "reproduces")


def any_of(*findings: Finding) -> Finding:
    """Judge that at least one of several things holds: it stands with one that does, and fails when none does."""
    holding = [finding for finding in findings if finding.outcome == "reproduces"]
    return _first(holding or findings, "reproduces", "not tested", "undecided", "does not")


def each(*judges: Callable[[Results], Finding]) -> Callable[[Results], Finding]:
    """Judge that several criteria hold together."""
    return lambda results: all_of(*(judge(results) for judge in judges))


def _first(findings: Sequence[Finding], *order: Outcome) -> Finding:
    """Return the first outcome in an order that there is, else the last of the order, with all evidence."""
    outcomes = {finding.outcome for finding in findings}
    outcome = next((one for one in order if one in outcomes), order[-1])
    return Finding(outcome, "; ".join(finding.evidence for finding in findings))


def over_levels(findings: Sequence[tuple[float, Finding]]) -> Finding:
    """Judge a sentence that names no level: at every level above zero, at none, only above x, or only up to x.

    findings: level -> whether the sentence holds there, from low to high. `only above x`: it does not hold at x
    and at every level below, and does at the highest; `only up to x` the other way round. Levels next to x on its far
    side may be undecided, and no others. Levels that could not be tested do not count; the evidence names them.
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
    words: dict[Outcome, str] = {"reproduces": "it holds", "does not": "is refuted", "undecided": "undecided"}
    where = ", ".join(f"{word} at {levels}" for outcome, word in words.items() if (levels := _levels(tested, outcome)))
    return Finding("undecided", f"{where}; {at}")


def _levels(findings: Sequence[tuple[float, Finding]], outcome: Outcome) -> str:
    return ", ".join(f"{level:g}" for level, finding in findings if finding.outcome == outcome)
