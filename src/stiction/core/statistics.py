"""Intervals over training seeds. A seed is one sample; episodes of one policy are not samples of the training."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import comb, sqrt

import numpy as np

Interval = tuple[float, float]

CONFIDENCE = 0.95


def wilson(successes: float, trials: int) -> Interval:
    """Return Wilson's 95 % interval of a share (Wilson 1927), which is valid near 0 and 1.

    successes: may be a fraction, a mean of clusters, which `scipy.stats.binomtest` refuses; trials: at least one.
    """
    # Of the normal distribution, not of t: the spread of a share follows from the share itself.
    quantile = 1.959964
    share, square = successes / trials, quantile**2
    centre = (share + square / (2 * trials)) / (1 + square / trials)
    half = quantile / (1 + square / trials) * sqrt(share * (1 - share) / trials + square / (4 * trials**2))
    return max(0.0, centre - half), min(1.0, centre + half)


MOST_SPLITS = 200_000
"""Maximum number of splits of an exact test: ten points against ten have 184,756."""


def permutation_p(first: Sequence[float], second: Sequence[float]) -> float | None:
    """Return the two-sided p of Fisher's exact permutation test of two means, one point per seed.

    It is the share of all splits of the points into two such samples whose means differ by at least as much. None where
    a sample is empty, or the splits exceed `MOST_SPLITS`.
    """
    points, size = [*first, *second], len(first)
    if not first or not second or comb(len(points), size) > MOST_SPLITS:
        return None
    # As far from its expectation as the first sample's sum is; what is as far but for rounding counts.
    expected, least = sum(points) * size / len(points), abs(sum(first) - sum(points) * size / len(points)) - 1e-9
    splits = [abs(sum(split) - expected) >= least for split in combinations(points, size)]
    return sum(splits) / len(splits)


def t_interval(points: Sequence[float], share: float = CONFIDENCE) -> Interval | None:
    """Return mean ± t(n - 1) s / √n, the interval of the mean of `points`, one per seed; None for one or none.

    share: probability with which it holds the mean.
    """
    n = len(points)
    if n < 2:
        return None
    return interval_of(float(np.mean(points)), float(np.std(points, ddof=1)) / sqrt(n), n - 1, share)


def interval_of(estimate: float, error: float, freedom: float, share: float = CONFIDENCE) -> Interval:
    """Return the t-interval of an estimate; share: see `t_interval`.

    `scipy.stats`, which has it, takes half a second to import.
    """
    from scipy.special import stdtrit  # not where there is no interval: verbs that print advice start without it

    low, high = (estimate + error * float(stdtrit(freedom, end)) for end in (0.5 - share / 2, 0.5 + share / 2))
    return low, high
