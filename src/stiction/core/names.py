"""What a joint is, told from its name: what is left of it without the words that say where it is."""

from __future__ import annotations

import re
from collections.abc import Iterable

SIDES = {
    *("fl", "fr", "rl", "rr", "lf", "rf", "lh", "rh", "hl", "hr", "bl", "br", "ml", "mr", "lm", "rm", "lr"),
    *("l", "r", "left", "right", "front", "rear", "hind", "back", "middle", "mid", "joint", "jnt", "leg"),
}
"""Words in a joint's name that say where it is, not what."""


def kind_of(name: str) -> str:
    """Return what a joint is: `hip` of `FL_hip_joint` and of `RR_hip`, `knee_pitch` of `Left_Knee_Pitch`."""
    words = [word for word in re.split(r"[_\-. ]+", name.lower()) if word]
    return "_".join(word for word in words if word not in SIDES and not word.isdigit()) or name.lower()


def kinds_of(names: Iterable[str]) -> tuple[str, ...]:
    """Return what each of some joints is."""
    return tuple(map(kind_of, names))
