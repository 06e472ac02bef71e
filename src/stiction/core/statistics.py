"""Intervals over training seeds. A seed is one sample; episodes of one policy are not samples of the training."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

import numpy as np
from scipy.special import stdtrit

Interval = tuple[float, float]

CONFIDENCE = 0.95


def wilson(successes: float, trials: int) -> Interval:
    """Return Wilson's 95 % interval of a share (Wilson 1927): it holds near 0 and 1, where the usual one fails.

    successes: may be a fraction, a mean of clusters, which `scipy.stats.binomtest` refuses; trials: at least one.
    """
    # Of the normal distribution, not of t: the spread of a share follows from the share itself.
    quantile = 1.959964
    share, square = successes / trials, quantile**2
    centre = (share + square / (2 * trials)) / (1 + square / trials)
    half = quantile / (1 + square / trials) * sqrt(share * (1 - share) / trials + square / (4 * trials**2))
    return max(0.0, centre - half), min(1.0, centre + half)


def t_interval(points: Sequence[float]) -> Interval | None:
    """Return mean ± t(n - 1) s / √n, the 95 % interval of the mean of `points`, one a seed; None for fewer than two."""
    n = len(points)
    if n < 2:
        return None
    return interval_of(float(np.mean(points)), float(np.std(points, ddof=1)) / sqrt(n), n - 1)


def interval_of(estimate: float, error: float, freedom: float) -> Interval:
    """Return the 95 % t-interval of an estimate. `scipy.stats`, which has it, takes half a second to import."""
    low, high = (
        estimate + error * float(stdtrit(freedom, share)) for share in (0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2)
    )
    return low, high
