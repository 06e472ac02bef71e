"""Checks of estimates, shared by tests."""

from __future__ import annotations

from stiction.files.joints import Estimate


def holds(estimate: Estimate | None, truth: float) -> bool:
    """Return whether an estimate is there and its interval has the truth."""
    return estimate is not None and estimate.interval95[0] <= truth <= estimate.interval95[1]
