"""Kind of a joint, from its name without the words for its place."""

from __future__ import annotations

import re
from collections.abc import Iterable

SIDES = {
    *("fl", "fr", "rl", "rr", "lf", "rf", "lh", "rh", "hl", "hr", "bl", "br", "ml", "mr", "lm", "rm", "lr"),
    *("l", "r", "left", "right", "front", "rear", "hind", "back", "middle", "mid", "joint", "jnt", "leg"),
}
"""Words for a joint's place, not its kind."""


def kind_of(name: str) -> str:
    """Return the kind of a joint: `hip` of `FL_hip_joint` and of `RR_hip`, `knee_pitch` of `Left_Knee_Pitch`."""
    words = [word for word in re.split(r"[_\-. ]+", name.lower()) if word]
    return "_".join(word for word in words if word not in SIDES and not word.isdigit()) or name.lower()


def kinds_of(names: Iterable[str]) -> tuple[str, ...]:
    """Return the kinds of several joints."""
    return tuple(map(kind_of, names))
