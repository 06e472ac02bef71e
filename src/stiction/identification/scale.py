"""Scale of the verdict: the friction from which on the answer is a little, probably or yes, and a joint's place."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median

from stiction.files.joints import JointRecord
from stiction.files.onset import shipped_onsets
from stiction.identification.advice import thresholds

MARGIN = 2.0
"""Factor on friction measured without load. Friction grows with load, by how much is not known here: a choice."""


def margin_of(record: JointRecord) -> float:
    """Return the factor on friction that load may add."""
    return 1.0 if record.test_condition == "loaded" else MARGIN


@dataclass(frozen=True)
class Scale:
    """Place of a joint's friction among the answers, on the axis on which onsets lie closest."""

    axis: str
    """Name in `files.onset.AXES`."""
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


def scale_of(record: JointRecord) -> Scale | None:
    """Return the place of a joint among the answers; None where the log shows neither of the axes."""
    on = {"torque_limit": record.friction_ratio, "dead_band_worst": record.dead_band}
    shown = {axis: estimate.interval95 for axis, estimate in on.items() if estimate is not None}
    if (axis := min(shown, key=shipped_onsets().spread, default=None)) is None:
        return None
    suffers = thresholds(axis)
    ends = (suffers.noticed[0], suffers.onset[0], median(shipped_onsets().middles(axis)))
    return Scale(axis, *shown[axis], margin_of(record), ends)
