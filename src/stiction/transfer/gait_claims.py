"""The paper's sentences on gait, each with a criterion, and what the numbers of several seeds say to it.

A number is decided to be above or below its threshold where the 95 % t-interval of the mean over seeds is. One seed
has no interval and decides nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stiction.formats.gait import BOTH, NEITHER, NO_TROT, NO_UNSYNC, VARIANTS, ClaimRow, GaitRow
from stiction.transfer.gait import HOP, PRONK, STANDS
from stiction.transfer.statistics import t_interval

REPRODUCES, CONTRADICTED, OPEN, UNTESTED = "reproduces", "does not reproduce", "not decided", "not tested"
"""The verdicts."""

MIXED = "these policies differ in more than gait rewards and seed, so that they are no samples of one training"
"""Why a mixture of trainings has no verdict."""


@dataclass(frozen=True)
class Claim:
    """A sentence that says what a gait reward does."""

    sentence: str
    """As printed."""
    number: str
    """Field of `GaitRow` that it is about."""
    threshold: float
    """The gait that the sentence names has at least this."""
    gait: str
    """That gait in words."""
    without: str
    """Variant that should show the gait."""
    prevented_by: str | None
    """Variant that should not; None where the sentence speaks of the first alone."""

    @property
    def criterion(self) -> str:
        """Return what is asked of the numbers."""
        said = f"{self.number} at least {self.threshold:g} ({self.gait}) with {VARIANTS[self.without]}"
        return said + (f", and under it with {VARIANTS[self.prevented_by]}" if self.prevented_by else "")


CLAIMS = (
    Claim(
        "In contrast, applying the same reward function to our hexapod robot results in the pronk gait.",
        "together_share",
        PRONK,
        "a pronk",
        NEITHER,
        None,
    ),
    Claim(
        "r_trot ensures that only one contact group is active at any time, preventing the robot from adopting the "
        "pronk gait.",
        "together_share",
        PRONK,
        "a pronk",
        NO_TROT,
        BOTH,
    ),
    Claim(
        "r_unsync ensures that the two contact groups are used equally over a period of time, preventing the robot "
        "from adopting a three-legged hopping gait.",
        "one_sidedness",
        HOP,
        "hopping on one group",
        NO_UNSYNC,
        BOTH,
    ),
)
"""What the paper says, in its order."""


def judge(rows: Sequence[GaitRow], alike: bool = True) -> list[ClaimRow]:
    """Return a verdict for each sentence, from the rows of all policies and commands.

    alike: whether the policies were trained alike but for gait rewards and seed; without, there is no verdict.
    """
    return [_judge(claim, rows, alike) for claim in CLAIMS]


def seed_means(rows: Sequence[GaitRow], variant: str, number: str) -> dict[int, float]:
    """Return seed -> mean over commands of a number, for the policies of a variant.

    A robot that stands under a command has no gait under it, and that command does not count; a seed that stands under
    all of them is left out.
    """
    values: dict[int, list[float]] = {}
    for row in rows:
        value = getattr(row, number)
        if row.variant == variant and row.moving_share >= STANDS and value is not None:
            values.setdefault(row.seed, []).append(value)
    return {seed: float(np.mean(found)) for seed, found in sorted(values.items())}


def above(values: Sequence[float], threshold: float) -> bool | None:
    """Say whether the mean over seeds is at least `threshold`; None where that is open."""
    interval = t_interval(values)
    if interval is None:
        return None
    low, high = interval
    return True if low >= threshold else False if high < threshold else None


def _judge(claim: Claim, rows: Sequence[GaitRow], alike: bool) -> ClaimRow:
    """Return the verdict on one sentence."""
    shown = [variant for variant in (claim.without, claim.prevented_by) if variant]
    found = {variant: seed_means(rows, variant, claim.number) for variant in shown}
    figures = "; ".join(_figures(rows, claim, variant, seeds) for variant, seeds in found.items())
    verdict = _verdict(claim, found) if alike else f"{UNTESTED}: {MIXED}"
    return ClaimRow(claim.sentence, claim.criterion, verdict, figures)


def _verdict(claim: Claim, found: dict[str, dict[int, float]]) -> str:
    """Return the verdict, and why where it is none."""
    missing = [VARIANTS[variant] for variant, seeds in found.items() if not seeds]
    if missing:
        return f"{UNTESTED}: no policy that moves was trained with {' or '.join(missing)}"
    fewest = min(map(len, found.values()))
    shows = above(list(found[claim.without].values()), claim.threshold)
    if shows is False:
        what = "there is nothing to prevent" if claim.prevented_by else "the gait does not appear"
        return f"{CONTRADICTED}: {what}, {VARIANTS[claim.without]} gives no {claim.gait.removeprefix('a ')}"
    kept = above(list(found[claim.prevented_by].values()), claim.threshold) if claim.prevented_by else False
    if kept is True:
        return f"{CONTRADICTED}: {claim.gait} in spite of it"
    if shows is None or kept is None:
        return f"{OPEN}: {'one seed' if fewest < 2 else f'{fewest} seeds, and the interval crosses the threshold'}"
    return f"{REPRODUCES}: {fewest} seeds"


def _figures(rows: Sequence[GaitRow], claim: Claim, variant: str, seeds: dict[int, float]) -> str:
    """Return the numbers of one variant as text."""
    stood = {row.seed for row in rows if row.variant == variant} - set(seeds)
    text = ", ".join(f"{value:.2f} (seed {seed})" for seed, value in seeds.items()) or "none"
    if interval := t_interval(list(seeds.values())):
        text += f", 95 % interval of the mean {interval[0]:.2f} to {interval[1]:.2f}"
    if stood:
        text += f", standing still: seed {', '.join(map(str, sorted(stood)))}"
    return f"{claim.number} with {VARIANTS[variant]}: {text}"
