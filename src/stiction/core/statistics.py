"""Intervals over training seeds. A seed is one sample; episodes of one policy are not samples of the training."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

import numpy as np
from scipy.special import stdtrit

Interval = tuple[float, float]

CONFIDENCE = 0.95
"""Of every interval."""


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


def conformal_bound(values: np.ndarray, share: float) -> np.ndarray:
    """Return, for each column of (n, columns), the bound under which a new value lies with probability `share`.

    The ⌈share (n + 1)⌉-th smallest (split conformal prediction); the largest where n is too small for that.
    """
    rank = min(int(np.ceil(share * (len(values) + 1))), len(values))
    return np.asarray(np.sort(values, axis=0)[rank - 1])


def t_interval(points: Sequence[float]) -> Interval | None:
    """Return mean ± t(n - 1) s / √n, the 95 % interval of the mean of `points`, one a seed; None for fewer than two."""
    n = len(points)
    if n < 2:
        return None
    return _interval(float(np.mean(points)), float(np.std(points, ddof=1)) / sqrt(n), n - 1)


def difference_interval(first: Sequence[float], second: Sequence[float]) -> Interval | None:
    """Return Welch's 95 % interval of mean(first) - mean(second); None where either has fewer than two points."""
    return _welch(float(np.mean(first) - np.mean(second)), (first, 1.0), (second, 1.0)) if first and second else None


def ratio_interval(first: Sequence[float], second: Sequence[float]) -> Interval | None:
    """Return the 95 % interval of mean(first) / mean(second) by the delta method, to first order in their errors.

    None where either has fewer than two points, or the second mean is zero.
    """
    if not first or not second or not (below := float(np.mean(second))):
        return None
    ratio = float(np.mean(first)) / below
    return _welch(ratio, (first, 1.0 / below), (second, ratio / below))


def _welch(estimate: float, *samples: tuple[Sequence[float], float]) -> Interval | None:
    """Return the t-interval of a sum of sample means, each times a weight; None with a sample of fewer than two points.

    Degrees of freedom by Welch and Satterthwaite. Samples without any spread have an interval of no width.
    """
    if any(len(points) < 2 for points, _ in samples):
        return None
    parts = [weight**2 * float(np.var(points, ddof=1)) / len(points) for points, weight in samples]
    total = sum(parts)
    freedom = sum(part**2 / (len(points) - 1) for part, (points, _) in zip(parts, samples, strict=True))
    return _interval(estimate, sqrt(total), total**2 / freedom if freedom else 1.0)


def _interval(estimate: float, error: float, freedom: float) -> Interval:
    """Return the 95 % t-interval. `scipy.stats`, which has it, takes half a second to import."""
    low, high = (
        estimate + error * float(stdtrit(freedom, share)) for share in (0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2)
    )
    return low, high
