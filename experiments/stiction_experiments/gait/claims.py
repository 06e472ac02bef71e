"""The paper's sentences on gait, each with a criterion on the numbers of several training seeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stiction.evaluation.samples import SeedValues
from stiction_experiments.gait.measure import BOTH, HOP, NEITHER, NO_TROT, NO_UNSYNC, PRONK, STANDS, VARIANTS, GaitRow
from stiction_experiments.lab.claims import Claim, Finding, Labelled, Verdict, all_of, within

MIXED = "these policies differ in more than gait rewards and seed, so that they are no samples of one training"
"""Why a mixture of trainings has no verdict."""


SENTENCES = {
    "G1": "In contrast, applying the same reward function to our hexapod robot results in the pronk gait.",
    "G2": "r_trot ensures that only one contact group is active at any time, preventing the robot from adopting the "
    "pronk gait.",
    "G3": "r_unsync ensures that the two contact groups are used equally over a period of time, preventing the robot "
    "from adopting a three-legged hopping gait.",
}
"""Sentences of the paper, in its order."""


def words(number: str) -> str:
    """Return a field of `GaitRow` in words."""
    return number.replace("_", " ")


def gait_claim(
    id: str, number: str, threshold: float, gait: str, without: str, prevented_by: str | None = None
) -> Claim[Sequence[GaitRow]]:
    """Return the claim of a sentence on a gait reward.

    number: field of `GaitRow` that it is about. threshold: the gait that the sentence names has at least this.
    gait: that gait in words. without: variant that should show the gait. prevented_by: variant that should not; None
    where the sentence is about the first alone.
    """
    criterion = f"{words(number)} at least {threshold:g} ({gait}) with {VARIANTS[without]}"

    def judge(rows: Sequence[GaitRow]) -> Finding:
        shown = within(*_measured(rows, without, number), threshold, np.inf)
        if prevented_by is None:
            return shown
        below = float(np.nextafter(threshold, -np.inf))
        finding = all_of(shown, within(*_measured(rows, prevented_by, number), -np.inf, below))
        reason = "there is nothing to prevent; " if shown.outcome == "does not" else ""
        return Finding(finding.outcome, reason + finding.evidence)

    if prevented_by is not None:
        criterion += f", and under it with {VARIANTS[prevented_by]}"
    return Claim(id, SENTENCES[id], criterion, judge)


CLAIMS = (
    gait_claim("G1", "together_share", PRONK, "a pronk", NEITHER),
    gait_claim("G2", "together_share", PRONK, "a pronk", NO_TROT, BOTH),
    gait_claim("G3", "one_sidedness", HOP, "hopping on one group", NO_UNSYNC, BOTH),
)


def judge(rows: Sequence[GaitRow], alike: bool = True) -> list[Verdict]:
    """Return a verdict for each sentence, from the rows of all policies and commands.

    alike: whether the policies were trained alike but for gait rewards and seed; without, there is no verdict.
    """
    verdicts = [claim.verdict(rows) for claim in CLAIMS]
    if alike:
        return verdicts
    return [replace(one, outcome="not tested", evidence=f"{MIXED}; {one.evidence}") for one in verdicts]


def seed_means(rows: Sequence[GaitRow], variant: str, number: str) -> SeedValues:
    """Return the mean over commands of a number of every seed, for the policies of a variant.

    A robot that stands under a command has no gait under it, and that command does not count; a seed that stands under
    all of them is left out.
    """
    values: dict[int, list[float]] = {}
    for row in rows:
        value = getattr(row, number)
        if row.variant == variant and row.moving_share >= STANDS and value is not None:
            values.setdefault(row.seed, []).append(value)
    return {seed: float(np.mean(numbers)) for seed, numbers in sorted(values.items())}


def _measured(rows: Sequence[GaitRow], variant: str, number: str) -> Labelled:
    """Return the number of a variant, with a label that says which seeds stand still."""
    seeds = seed_means(rows, variant, number)
    stood = sorted({row.seed for row in rows if row.variant == variant} - set(seeds))
    still = f", standing still: seed {', '.join(map(str, stood))}," if stood else ""
    return f"{words(number)} with {VARIANTS[variant]}{still}", seeds
