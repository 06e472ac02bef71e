"""Does this friction matter? A provisional answer in words, with the numbers that it rests on, and what to train."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from stiction.formats.joints import Estimate
from stiction.identify.advice import Advice, advise
from stiction.identify.evidence import (
    BUDGET,
    EVIDENCE,
    FELT,
    FELT_BAND,
    MARGIN,
    TRAINABLE,
    effect,
    friction_level,
)
from stiction.identify.reference import CONDITIONS, Placement, Quantity, place
from stiction.identify.what_if import WhatIf, what_if

WITHOUT: dict[str, Any] = {"method": "none", "level": 0.0, "law": "coulomb", "per": "robot"}
"""The fields of `FrictionCfg` where there is no friction to train for."""


@dataclass(frozen=True)
class Verdict:
    """What the friction of one joint means for training."""

    level: float | None
    """Friction that a training has to cover, as a share of the torque limit: the upper end, with the margin; None
    without a torque limit, and beyond what can be trained."""
    text: str
    """The same in words, with the comparison."""
    placement: tuple[Placement, ...] = ()
    """Rank of ratio and dead band among public joints of the same condition."""
    what_if: tuple[WhatIf, ...] = ()
    """Seals removed, and wear."""
    advice: Advice | None = None
    """What to train with; None where there is nothing to cover."""

    @property
    def range(self) -> tuple[float, float] | None:
        """Friction that training then draws, as shares of the torque limit, lowest and highest."""
        if self.advice is None:
            return None if self.level is None else (0.0, 0.0)
        low, high = self.advice.range
        return low, high

    @property
    def training(self) -> dict[str, Any] | None:
        """The fields of `task.friction` in a run's configuration; None where no level can be proposed."""
        if self.advice is None:
            return None if self.level is None else WITHOUT
        return self.advice.settings

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for the diagnostics of `joints.json`."""
        return {
            "friction_level": self.level,
            "range": None if self.range is None else list(self.range),
            "training": self.training,
            "advice": self.advice and self.advice.to_dict(),
            "text": self.text,
            "placement": [item.to_dict() for item in self.placement],
            "what_if": [item.to_dict() for item in self.what_if],
        }


def verdict(
    coulomb: Estimate | None,
    ratio: Estimate | None,
    dead_band: Estimate | None,
    condition: str | None,
    axis: str = "rotary",
) -> Verdict:
    """Judge a joint by f/τ_max and f/kp with their intervals.

    coulomb: f [N m], or None where only ratios are known, from a log without torque; ratio: f/τ_max [1]; dead_band:
    f/kp [rad]; condition: `bare_motor`, `in_air`, `loaded` or None; axis: `rotary` or `linear`. What is None is said to
    be unknown. A linear axis is not compared with legs, and no training is proposed for it.
    """
    leg = axis == "rotary"
    parts = [*_measured(coulomb, ratio, dead_band, condition, leg)]
    placement: tuple[Placement, ...] = ()
    if leg:
        known: dict[Quantity, Estimate | None] = {"friction_ratio": ratio, "dead_band": dead_band}
        places = (place(value, condition, name) for name, value in known.items() if value is not None)
        placement = tuple(item for item in places if item is not None)
        parts += [item.text for item in placement]
    level = friction_level(ratio, condition) if leg and ratio is not None else None
    if ratio is not None and leg:
        parts += _judgement(ratio, dead_band, condition)
    if leg and condition != "loaded":
        parts.append(
            "This is a lower bound for a leg that carries the robot: friction grows with load, and only a log under a "
            "known load can tell by how much."
        )
    if level is not None and level >= TRAINABLE:
        parts.append(
            f"To cover it would take level {level:.2f}, and no training goes beyond {TRAINABLE:g}: mend the joint."
        )
        level = None
    advice = advise(max(ratio.interval95[0], 0.0), level) if level and ratio is not None else None
    if level is not None:
        parts.append(_proposal(level, condition, advice))
    return Verdict(level, " ".join(parts), placement, what_if(ratio, dead_band, condition) if leg else (), advice)


def _measured(
    coulomb: Estimate | None, ratio: Estimate | None, dead_band: Estimate | None, condition: str | None, leg: bool
) -> list[str]:
    """Say what was found, under which condition, and what is not known."""
    measured = CONDITIONS.get(condition or "", "under a condition that was not stated")
    parts, known = [], coulomb or ratio or dead_band
    if known is not None and known.interval95[0] <= 0:
        parts.append("No dry friction can be told from zero in this log.")
    if ratio is None:
        parts.append(
            "Without the motor's torque limit it cannot be said whether this friction matters: --torque-limit."
        )
    else:
        parts.append(f"Dry friction takes {_span(ratio, 100, ' %')} of the torque limit, measured {measured}.")
    if dead_band is not None:
        band = _span(dead_band, 1, " rad" if leg else " m")
        parts.append(f"The joint ignores position errors up to f/kp, {band}, at the gains of the log.")
    if coulomb is None and known is not None:
        parts.append(
            "Newton metres are not known: these are in units of the command, or of the torque column, in which the "
            "motor's strength cancels."
        )
    return parts


def _judgement(ratio: Estimate, dead_band: Estimate | None, condition: str | None) -> list[str]:
    """Say what the evidence so far says about friction of at most the interval's upper end."""
    high = max(ratio.interval95[1], 0.0)
    parts = [f"{effect(high)}. {EVIDENCE}"]
    if condition != "loaded" and effect(MARGIN * high) != effect(high):
        parts.append(f"At {MARGIN:g} times that, which a loaded leg may have: {effect(MARGIN * high).lower()}.")
    if dead_band is not None and high < FELT and dead_band.interval95[1] > FELT_BAND:
        parts.append(
            f"But the dead band is wider than the {FELT_BAND:g} rad that went with {100 * FELT:g} % in those "
            "simulations: at such low gains the same friction is felt more."
        )
    return [*parts, BUDGET]


def _proposal(level: float, condition: str | None, advice: Advice | None) -> str:
    """Say what to train with."""
    if advice is None:
        return "There is no friction to train for: --method none."
    margin = "" if condition == "loaded" else f", the upper end times {MARGIN:g}, a margin chosen, not measured"
    return f"A training has to cover {100 * level:.3g} % of the torque limit{margin}. {advice.text}"


def _span(estimate: Estimate, factor: float, unit: str) -> str:
    """Return `value unit (low to high)` with three digits; where there may be nothing, the most that it may be."""
    low, high = estimate.interval95
    said = f"{estimate.value * factor:.3g}" if low > 0 else f"at most {max(high, 0.0) * factor:.3g}"
    return f"{said}{unit} (95 %: {low * factor:.3g} to {high * factor:.3g})"
