"""Intervals over training seeds. A seed is one sample; episodes of one policy are not samples of the training."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student_t

Interval = tuple[float, float]

CONFIDENCE = 0.95
"""Of every interval."""


def _half_width(error: float, freedom: float) -> float:
    """Return the t quantile times a standard error."""
    return float(student_t.ppf(0.5 + CONFIDENCE / 2, freedom)) * error


def t_interval(points: Sequence[float]) -> Interval | None:
    """Return the 95 % t-interval of the mean of `points`, one a seed; None for fewer than two.

    mean ± t(n - 1) s / √n.
    """
    n = len(points)
    if n < 2:
        return None
    mean = float(np.mean(points))
    half = _half_width(float(np.std(points, ddof=1)) / n**0.5, n - 1)
    return mean - half, mean + half


def difference_interval(first: Sequence[float], second: Sequence[float]) -> Interval | None:
    """Return Welch's 95 % interval of mean(first) - mean(second); None where either has fewer than two points.

    Degrees of freedom by Welch and Satterthwaite. Two samples without any spread differ by exactly their difference.
    """
    if len(first) < 2 or len(second) < 2:
        return None
    difference = float(np.mean(first) - np.mean(second))
    parts = [float(np.var(points, ddof=1)) / len(points) for points in (first, second)]
    total = sum(parts)
    if total == 0.0:
        return difference, difference
    freedom = total**2 / sum(part**2 / (len(points) - 1) for part, points in zip(parts, (first, second), strict=True))
    half = _half_width(total**0.5, freedom)
    return difference - half, difference + half


def ratio_interval(first: Sequence[float], second: Sequence[float]) -> Interval | None:
    """Return the 95 % interval of mean(first) / mean(second), None where either has fewer than two points.

    To first order in the errors of the two means (the delta method), degrees of freedom by Welch and Satterthwaite: it
    holds where the second mean is many of its errors away from zero. None where that mean is zero.
    """
    if len(first) < 2 or len(second) < 2 or not (below := float(np.mean(second))):
        return None
    ratio = float(np.mean(first)) / below
    samples = ((first, 1.0), (second, ratio))
    parts = [float(np.var(points, ddof=1)) / len(points) * (weight / below) ** 2 for points, weight in samples]
    total = sum(parts)
    if total == 0.0:
        return ratio, ratio
    freedom = total**2 / sum(part**2 / (len(points) - 1) for part, (points, _) in zip(parts, samples, strict=True))
    half = _half_width(total**0.5, freedom)
    return ratio - half, ratio + half
