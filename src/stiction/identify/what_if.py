"""The same joint without its seals, or worn: what a multiple of its friction would mean. Nobody measured it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from stiction.formats.joints import Estimate
from stiction.identify.evidence import TRAINABLE, effect, friction_level

WHAT_IF = (
    ("seals removed", 0.3, "the paper saw 70 % less without the seals of its own motor"),
    ("worn, x 1.5", 1.5, "a factor chosen, not measured"),
    ("worn, x 2", 2.0, "a factor chosen, not measured"),
    ("worn, x 3", 3.0, "a factor chosen, not measured"),
)
"""Case, factor on the friction, where the factor comes from."""


@dataclass(frozen=True)
class WhatIf:
    """The same joint with its friction multiplied."""

    case: str
    """What would have happened to the joint."""
    factor: float
    """On its friction."""
    friction_ratio: Estimate | None
    """f/τ_max then [1]."""
    dead_band: Estimate | None
    """f/kp then [rad]."""
    level: float | None
    """Friction that a training has to cover then [-]; None where there is none."""
    text: str
    """The same in one sentence."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        estimates = {"friction_ratio": self.friction_ratio, "dead_band": self.dead_band}
        return {
            "case": self.case,
            "factor": self.factor,
            **{name: estimate and estimate.to_dict() for name, estimate in estimates.items()},
            "friction_level": self.level,
            "text": self.text,
        }


def what_if(ratio: Estimate | None, dead_band: Estimate | None, condition: str | None) -> tuple[WhatIf, ...]:
    """Return every case of `WHAT_IF` for f/τ_max [1] and f/kp [rad]; nothing where neither is known."""
    if ratio is None and dead_band is None:
        return ()
    return tuple(_case(*case, ratio, dead_band, condition) for case in WHAT_IF)


def _case(
    case: str, factor: float, origin: str, ratio: Estimate | None, dead_band: Estimate | None, condition: str | None
) -> WhatIf:
    """Return the joint with `factor` times its friction."""
    ratio = ratio and ratio.scaled(factor)
    dead_band = dead_band and dead_band.scaled(factor)
    level = friction_level(ratio, condition) if ratio else None
    said = [f"{100 * ratio.value:.3g} % of the torque limit"] if ratio else []
    said += [f"dead band {dead_band.value:.3g} rad"] if dead_band else []
    text = f"What if {case} ({origin}): {', '.join(said)}"
    if ratio and level is not None:
        said_of_it = effect(max(ratio.interval95[1], 0.0))
        text += f". {said_of_it}; " + (
            f"to cover: {level:.2f}"
            if level < TRAINABLE
            else f"to cover {level:.2f} is beyond training, mend the joint"
        )
        level = level if level < TRAINABLE else None
    return WhatIf(case, factor, ratio, dead_band, level, text + ".")
