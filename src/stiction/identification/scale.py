"""Scale of the verdict: the friction from which on the answer is a little, probably or yes, and a joint's place.

Judged by what the same robot with the same gains did in simulation, where it walked; else by what every robot did that
walked, and that is called an extrapolation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import median

import numpy as np

from stiction.core.records import two_digits
from stiction.files.advice import robot_title
from stiction.files.joints import JointRecord
from stiction.files.onset import OnsetEvidence, nearest, shipped_onsets

MARGIN = 2.0
"""Factor on friction measured without load. Friction grows with load, by how much is not known here: a choice."""

SYMBOLS = {"torque_limit": ("f/τ_max", 100.0, " %"), "dead_band_worst": ("f/kp", 1.0, " rad")}
"""Axis that a joint's own log shows, the one by which it is judged first -> symbol, factor to its unit, and unit."""


def margin_of(record: JointRecord) -> float:
    """Return the factor on friction that load may add."""
    return 1.0 if record.test_condition == "loaded" else MARGIN


def span_text(axis: str, values: list[float]) -> str:
    """Return the ends of values on an axis, the least first, in words: `3 to 22 %`."""
    _, factor, unit = SYMBOLS[axis]
    ends = dict.fromkeys(two_digits(value * factor) for value in (values[0], values[-1]))
    return f"{' to '.join(ends)}{unit}"


@dataclass(frozen=True)
class Thresholds:
    """Friction that troubled policies trained without it, on one axis, of each policy, the least first."""

    noticed: list[float]
    """Friction at which they lost a tenth of their speed under some command."""
    onset: list[float]
    """Friction at which they lost a fifth."""
    text: str
    """Clause on the policies and their loss, and whether it is an extrapolation."""

    @property
    def ends(self) -> tuple[float, float, float]:
        """Upper ends of `no`, `a little` and `probably`: the first that noticed, the first that lost a fifth, half."""
        return self.noticed[0], self.onset[0], median(self.onset)


def thresholds(record: JointRecord, robot: str | None, axis: str, evidence: OnsetEvidence | None = None) -> Thresholds:
    """Return what friction did to policies of this robot with these gains, or of every robot where that is not known.

    evidence: by default the shipped one.
    """
    evidence = evidence or shipped_onsets()
    gains = np.array([[record.torque_limit or math.nan, record.used_kp or math.nan]])
    near = nearest(robot, gains, evidence)
    walked = (near.condition,) if near.same else (*evidence.conditions, *evidence.others)
    noticed, onset = (
        sorted(value for each in walked for value in each.each(axis, reading)) for reading in ("noticed", "onsets")
    )
    who = f"{near.title}, {len(onset)} seeds" if near.same else f"{len(walked)} robots and gains, {len(onset)} policies"
    text = (
        f"in simulation policies trained without friction ({who}) lost a tenth of some command's speed from "
        f"{SYMBOLS[axis][0]} {span_text(axis, noticed)} on, and a fifth from {span_text(axis, onset)}"
    )
    if not near.same:
        whose = "the robot is not known" if robot is None else f"no {robot_title(robot)} walked with such gains"
        text += f"; this is an extrapolation, for {whose}: the nearest that walked, {near.title}, "
        text += f"lost a fifth from {span_text(axis, sorted(near.condition.each(axis)))}"
    return Thresholds(noticed, onset, text)


@dataclass(frozen=True)
class Scale:
    """Place of a joint's friction among the answers."""

    axis: str
    """Key of `SYMBOLS`."""
    low: float
    """Lower end of the interval on the axis."""
    high: float
    """Upper end."""
    margin: float
    """Factor on the friction that load may add; the answer is that of the upper end times this."""
    ends: tuple[float, float, float]
    """Upper ends of `no`, `a little` and `probably`."""

    @property
    def most(self) -> float:
        """Upper end with the margin."""
        return self.margin * self.high

    @property
    def answer(self) -> str:
        """Answer to whether this much friction matters: `no`, `a little`, `probably` or `yes`.

        A yes must hold at the lower end of the interval.
        """
        no, little, probably = self.ends
        if self.most < no:
            return "no"
        return "yes" if self.low >= probably else "probably" if self.most >= little else "a little"


def scale_of(record: JointRecord, robot: str | None = None) -> Scale | None:
    """Return the place of a joint among the answers; None where the log shows neither of the axes.

    Onsets lie equally far apart on both, so the one that needs less knowledge is taken, f/τ_max.
    """
    on = {"torque_limit": record.friction_ratio, "dead_band_worst": record.dead_band}
    axis = next((axis for axis in SYMBOLS if on[axis] is not None), None)
    if axis is None or (estimate := on[axis]) is None:
        return None
    return Scale(axis, *estimate.interval95, margin_of(record), thresholds(record, robot, axis).ends)
