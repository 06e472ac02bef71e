"""What the simulations so far say about joint friction, and what to train with because of it.

The evidence is `results/replication`: one simulated 32 kg hexapod told to walk at 0.5 m/s, three training seeds, in the
simulator of the training, in two other engines and on virtual robots; and for the way to train
`results/friction-training`, five seeds. Every sentence that rests on it is called provisional.
"""

from __future__ import annotations

import math
from typing import Any

from stiction.formats.joints import Estimate

FELT = 0.01
"""Share of the torque limit that cost policies trained without friction 2 to 3 hundredths of the commanded speed, in
other engines than the training's: T1 in `results/replication`. The next share that was tried there is `SEVERE`."""

FELT_BAND = 0.0045
"""Largest dead band that went with `FELT` there [rad]: 1 % of 45 N m at kp 100."""

SEVERE = 0.10
"""Share at which the same policies reached 0.70 of it backward on virtual robots, and 0.22 at twice that."""

MARGIN = 2.0
"""Factor on friction measured without load. Friction grows with load, by how much is not known here: a choice."""

EVIDENCE = (
    "Provisional: in simulations of one robot, three training seeds, friction of 1 % of the torque limit cost such "
    "policies 2 to 3 % of 0.5 m/s. Their slower direction fell under 80 % of it with 8 % in the simulator that trained "
    "them, with 4 % in PhysX and on virtual robots, and with 1 % in ODE, where it was at 80 % without friction."
)
"""What policies did that were trained without friction: the onsets in `results/replication`."""

BUDGET = (
    "Which training follows up to which friction, engine by engine: the friction budget, results/replication/README.md "
    "in stiction's repository; `stiction replicate` makes it anew."
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
