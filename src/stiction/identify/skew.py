"""Is the torque of a log early or late against its angle? A controller that holds its torque makes it so.

What acts is then the logged torque of half an update before, and the log has B wrong by what kp and the inertia make of
that time. The equation is fitted again with the torque free to move by a fraction of a sample: one more column, the
torque's rate. The column is noisy, so its fit is no better than the plain one; but where the two disagree the truth may
be with either, and the intervals must admit both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stiction.formats.joints import Estimate
from stiction.identify.consistency import COMPARED, TIMING, Comparison, friction_at
from stiction.identify.prepare import Prepared
from stiction.identify.regression import Fit, fit_beside

FURTHEST = 1.5
"""Samples by which torque may be early or late: more is a law that is not the joint's, for want of a better."""


@dataclass(frozen=True)
class Skew:
    """What a log says about the time between torque and angle."""

    early: Estimate
    """How much earlier the torque is logged than it acts [s]."""
    estimates: dict[str, Estimate]
    """The equation's parameters with that taken into account."""


def fit_skew(prepared: Prepared, base: Fit) -> Skew:
    """Fit the equation of `base`, whose rows are those of `prepared`, with the torque free to move in time."""
    rate = np.gradient(prepared.torque - prepared.outside, prepared.step)[prepared.used]
    found = fit_beside(base, "early", rate).scatter()
    return Skew(found.pop("early"), found)


def compare_timing(prepared: Prepared, base: Fit) -> Comparison | None:
    """Set the fit beside the one whose torque may move in time; None where it would move further than clocks do."""
    skew, seen = fit_skew(prepared, base), base.estimates()
    if abs(skew.early.value) > FURTHEST * prepared.step:
        return None
    parts = ("as logged", f"torque {1e3 * skew.early.value:.2g} ms later")
    values = {name: (seen[name], skew.estimates[name]) for name in COMPARED}
    speed = float(np.quantile(np.abs(base.rows.velocity), 0.9))
    moved = replace(base, values=np.array([skew.estimates[name].value for name in base.names]))
    return Comparison(TIMING, parts, values, speed, (friction_at(base, speed), friction_at(moved, speed)), True)
