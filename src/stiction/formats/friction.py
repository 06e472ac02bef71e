"""Dry friction in words: what a level of each law means, for contracts, results and pages.

`coulomb` and `stribeck` have a torque: their level is a fraction of each joint's torque limit. `load` and `effort` have
a coefficient, a number per newton and newton metre that the joint bears: their level is that coefficient.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from stiction.formats.errors import StictionError

LAWS = {
    "coulomb": "a torque that depends on neither load nor speed",
    "stribeck": "a torque, more of it at rest than in motion",
    "load": "in proportion to the force and torque that the joint transmits",
    "effort": "in proportion to the motor's torque",
}
"""Law -> what the friction does, in words for people."""

COEFFICIENT_LAWS = ("load", "effort")
"""Laws whose level is a coefficient; that of the others is a fraction of the torque limit."""

MAX_LEVEL = 0.9
"""Highest friction level: above it hardly any torque is left to move the joint [-]. It bounds coefficients too."""


@dataclass(frozen=True)
class Law:
    """A law of dry friction with the numbers that all its levels share."""

    name: str = "coulomb"
    """One of `LAWS`."""
    static_ratio: float = 1.5
    """Friction at rest over friction in motion [1], of `stribeck`."""
    stribeck_velocity: float = 0.1
    """Speed at which 63 % of that excess is gone [rad/s], of `stribeck`."""

    def __post_init__(self) -> None:
        """Refuse a law that does not exist, and friction that is lower at rest or never falls."""
        if self.name not in LAWS:
            raise StictionError(f"friction law {self.name!r}: expected one of {', '.join(LAWS)}")
        if not 1 <= self.static_ratio <= 10 or not 0 < self.stribeck_velocity < math.inf:
            raise StictionError(
                f"static ratio {self.static_ratio}, Stribeck velocity {self.stribeck_velocity} rad/s: expected a ratio "
                "in [1, 10] and a positive speed"
            )


def has_coefficient(law: str) -> bool:
    """Say whether the level of a law is a coefficient, not a fraction of the torque limit."""
    return law in COEFFICIENT_LAWS


def level_text(law: str, level: float) -> str:
    """Return a level as people read it: `20 %` of the torque limit, or `c = 0.05`."""
    return f"c = {level:g}" if has_coefficient(law) else f"{100 * level:g} %"


def level_number(law: str, level: float) -> float:
    """Return a level in the unit of `level_axis`: per cent of the torque limit, or the coefficient."""
    return level if has_coefficient(law) else 100 * level


def level_axis(law: str) -> str:
    """Return the label of an axis of levels."""
    if law == "load":
        return "load friction c, N m per N and N m transmitted"
    if law == "effort":
        return "effort friction c, N m per N m of the motor"
    name = "Stribeck friction in motion" if law == "stribeck" else "dry friction"
    return f"{name}, % of each joint's torque limit"
