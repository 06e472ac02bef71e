"""Does this friction matter? A provisional answer in words, with the numbers that it rests on."""

from __future__ import annotations

import math
from dataclasses import dataclass

from stiction.formats.joints import Estimate

FELT = 0.05
"""Share of the torque limit up to which a policy trained without friction still reached 90 % of a commanded 0.5 m/s, in
`results/flat-ground`: one simulated 32 kg hexapod, one training seed, Coulomb friction."""

SEVERE = 0.10
"""Share at which the same policy fell under 80 %, backward; at 0.20 it reached 61 % forward and 51 % backward."""

MARGIN = 2.0
"""Factor on friction measured without load. Friction grows with load, by how much is not known here: a choice."""

TRAINABLE = 0.8
"""Levels from here on leave the motor too little to walk with; training refuses them."""

CONDITIONS = {"bare_motor": "on a bare motor", "in_air": "on a leg in the air", "loaded": "under load"}


@dataclass(frozen=True)
class Verdict:
    """What the friction of one joint means for training."""

    level: float | None
    """`--friction-level` to train at, or None without a torque limit, and beyond what can be trained."""
    text: str
    """The same in words."""


def verdict(
    coulomb: Estimate, ratio: Estimate | None, dead_band: Estimate | None, condition: str | None, axis: str = "rotary"
) -> Verdict:
    """Judge a joint by f/τ_max and f/kp with their intervals.

    coulomb: f [N m]; ratio: f/τ_max [1]; dead_band: f/kp [rad]; condition: one of `CONDITIONS` or None; axis: `rotary`
    or `linear`. What is None is said to be unknown.
    """
    unit = "rad" if axis == "rotary" else "m"
    measured = CONDITIONS.get(condition or "", "under a condition that was not stated")
    parts, level = [], None
    if ratio is None:
        parts.append(
            "Without the motor's torque limit it cannot be said whether this friction matters: --torque-limit."
        )
    else:
        parts.append(f"Dry friction takes {_span(ratio, 100, ' %')} of the torque limit, measured {measured}.")
        if axis == "rotary":
            high = max(ratio.interval95[1], 0.0)
            level = math.ceil(100 * high * (1.0 if condition == "loaded" else MARGIN) - 1e-9) / 100
            parts.append(_judgement(high))
    if dead_band is not None:
        band = _span(dead_band, 1, f" {unit}")
        parts.append(f"The joint ignores position errors up to f/kp = {band} at the gains of the log.")
    if coulomb.interval95[0] <= 0:
        parts.append("The interval of the dry friction reaches zero: this log does not prove that there is any.")
    if condition != "loaded" and axis == "rotary":
        parts.append(
            "This is a lower bound for a leg that carries the robot: friction grows with load, and only a log under a "
            "known load can tell by how much."
        )
    if level is not None and level >= TRAINABLE:
        parts.append(
            f"To cover it would take level {level:.2f}, and no training goes beyond {TRAINABLE:g}: mend the joint."
        )
        level = None
    if level is not None:
        margin = "" if condition == "loaded" else f" (the upper end times {MARGIN:g}, a margin chosen, not measured)"
        parts.append(f"To cover it, train with --friction-level {level:.2f}{margin}.")
    return Verdict(level, " ".join(parts))


def _judgement(high: float) -> str:
    """Return what the evidence so far says about friction of at most `high` times the torque limit."""
    if high < FELT:
        word = "By itself it probably does not trouble a walking policy"
    elif high < SEVERE:
        word = "It may slow down a policy that was trained without friction"
    else:
        word = "A policy that was trained without friction will probably lose much of its speed"
    return (
        f"{word}. Provisional: in simulations of one robot, one training seed, such a policy still followed "
        "0.5 m/s with friction of 1 % of the torque limit, and reached 79 to 85 % of it at 10 %, 51 to 61 % at 20 %."
    )


def _span(estimate: Estimate, factor: float, unit: str) -> str:
    """Return `value unit (low to high)` with three digits."""
    low, high = estimate.interval95
    return f"{estimate.value * factor:.3g}{unit} (95 %: {low * factor:.3g} to {high * factor:.3g})"
