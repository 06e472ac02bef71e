"""Do two estimators of the same log say the same."""

from __future__ import annotations

import numpy as np

from stiction.formats.joints import Estimate
from stiction.identify.consistency import COMPARED
from stiction.identify.regression import Fit

LARGEST_GAP = 0.03
"""Relative disagreement of two estimators that matters, if it is also beyond `LARGEST_SIGMAS`."""

LARGEST_SIGMAS = 3.0
"""Combined standard deviations that chance rarely exceeds."""


def disagreement(fit: Fit, other: dict[str, Estimate]) -> dict[str, dict[str, float]]:
    """Return per parameter |a − b| in combined standard deviations (`sigmas`) and over |a| (`relative`).

    a is the regression's value, b the other estimator's. Both come from one log, so their errors are not independent,
    and the combined deviation is a rough yardstick.
    """
    result = {}
    for name, a in fit.estimates().items():
        if name in other and name in COMPARED:
            b = other[name]
            gap = abs(a.value - b.value)
            result[name] = {
                "sigmas": gap / max(float(np.hypot(a.std, b.std)), 1e-300),
                "relative": gap / max(abs(a.value), 1e-300),
            }
    return result


def beyond_chance(gap: dict[str, float]) -> bool:
    """Return whether a gap of `disagreement` is beyond chance and large enough to matter."""
    return gap["sigmas"] > LARGEST_SIGMAS and gap["relative"] > LARGEST_GAP
