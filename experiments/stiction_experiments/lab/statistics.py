"""Intervals of differences and ratios over training seeds, and bounds that new values keep."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

import numpy as np

from stiction.core.statistics import CONFIDENCE, Interval, interval_of


def conformal_bound(values: np.ndarray, share: float) -> np.ndarray:
    """Return, for each column of (n, columns), the bound under which a new value lies with probability `share`.

    The ⌈share (n + 1)⌉-th smallest (split conformal prediction); the largest where n is too small for that.
    """
    rank = min(int(np.ceil(share * (len(values) + 1))), len(values))
    return np.asarray(np.sort(values, axis=0)[rank - 1])


def exact_interval(successes: int, trials: int, share: float = CONFIDENCE) -> Interval:
    """Return the exact interval of a share (Clopper and Pearson 1934); trials: at least one.

    share: probability with which it holds the true share, at the least.
    """
    from scipy.stats import binomtest  # half a second: not where a study has no share

    interval = binomtest(successes, trials).proportion_ci(share, method="exact")
    return float(interval.low), float(interval.high)


def difference_interval(first: Sequence[float], second: Sequence[float], share: float = CONFIDENCE) -> Interval | None:
    """Return Welch's interval of mean(first) - mean(second); None where either has fewer than two points.

    share: probability with which it holds the difference.
    """
    if not first or not second:
        return None
    return _welch(float(np.mean(first) - np.mean(second)), (first, 1.0), (second, 1.0), share=share)


def ratio_interval(first: Sequence[float], second: Sequence[float]) -> Interval | None:
    """Return the 95 % interval of mean(first) / mean(second) by the delta method, to first order in their errors.

    None where either has fewer than two points, or the second mean is zero.
    """
    if not first or not second or not (below := float(np.mean(second))):
        return None
    ratio = float(np.mean(first)) / below
    return _welch(ratio, (first, 1.0 / below), (second, ratio / below))


def _welch(estimate: float, *samples: tuple[Sequence[float], float], share: float = CONFIDENCE) -> Interval | None:
    """Return the t-interval of a sum of sample means, each times a weight; None with a sample of fewer than two points.

    Degrees of freedom by Welch and Satterthwaite. Samples without any spread have an interval of no width.
    """
    if any(len(points) < 2 for points, _ in samples):
        return None
    parts = [weight**2 * float(np.var(points, ddof=1)) / len(points) for points, weight in samples]
    total = sum(parts)
    freedom = sum(part**2 / (len(points) - 1) for part, (points, _) in zip(parts, samples, strict=True))
    return interval_of(estimate, sqrt(total), total**2 / freedom if freedom else 1.0, share)
