"""What the simulations so far say about joint friction, and what to train with because of it.

The evidence is `results/friction-training`: one simulated 32 kg hexapod, five training seeds, Coulomb friction,
0.5 m/s. Every sentence that rests on it is called provisional.
"""

from __future__ import annotations

import math
from typing import Any

from stiction.formats.joints import Estimate

FELT = 0.05
"""Share of the torque limit up to which policies trained without friction still reached 89 % of a commanded 0.5 m/s,
backward, the slower direction, mean over seeds in `results/friction-training`."""

FELT_BAND = 0.0225
"""Largest dead band that went with `FELT` there [rad]: 5 % of 45 N m at kp 100."""

SEVERE = 0.10
"""Share at which the same policies fell under 80 %, backward: 74 %; at 0.20 they reached 42 % forward, 40 % back."""

MARGIN = 2.0
"""Factor on friction measured without load. Friction grows with load, by how much is not known here: a choice."""

BUDGET = (
    "Which training follows up to which friction, in other engines and on a virtual robot: the friction budget of "
    "`stiction replicate`, in results/replication."
)
"""Where a robot builder looks next."""

TRAINABLE = 0.8
"""Levels from here on leave the motor too little to walk with; training refuses them."""

METHOD = "deception"
"""Way to train: in `results/friction-training` it deviated least from the command, from no friction to 30 %."""

RANGE = (0.0, 1.2)
"""What `METHOD` multiplies the level with, as `stiction.locomotion.config` has it."""


def effect(high: float) -> str:
    """Return what friction of `high` times the torque limit does to a policy that never met it."""
    if high < FELT:
        return "By itself it probably does not trouble a walking policy"
    if high < SEVERE:
        return "It may slow down a policy that was trained without friction"
    return "A policy that was trained without friction will probably lose much of its speed"


def friction_settings(level: float) -> dict[str, Any]:
    """Return the fields of `FrictionCfg` that train at a level; at level 0 there is nothing to train for."""
    return {"method": METHOD if level > 0 else "none", "level": level, "law": "coulomb", "per": "robot"}


def friction_level(ratio: Estimate, condition: str | None) -> float:
    """Return the level that covers a ratio: the upper end, times `MARGIN` unless it was loaded, up to a whole per cent.

    May be `TRAINABLE` or more; who proposes it has to check.
    """
    high = max(ratio.interval95[1], 0.0)
    return math.ceil(100 * high * (1.0 if condition == "loaded" else MARGIN) - 1e-9) / 100
