"""What the simulations so far say about joint friction, and how much friction a training has to cover.

The evidence is `results/replication`: one simulated 32 kg hexapod told to walk at 0.5 m/s, three training seeds, in the
simulator of the training, in two other engines and on virtual robots. Every sentence that rests on it is called
provisional. Which training to choose is another module's: `advice`.
"""

from __future__ import annotations

import math

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
    "policies 2 to 3 % of 0.5 m/s. Their slower direction slowed under 80 % of it with 8 % in the simulator that "
    "trained them, with 4 % in PhysX and on virtual robots, and with 1 % in ODE, where it was at 80 % without friction."
)
"""What policies did that were trained without friction: the onsets in `results/replication`."""

BUDGET = (
    "Which training follows up to which friction, engine by engine: the friction budget, results/replication/README.md "
    "in stiction's repository; `stiction replicate` makes it anew."
)
"""Where a robot builder looks next."""

TRAINABLE = 0.8
"""Levels from here on leave the motor too little to walk with; training refuses them."""


def effect(high: float) -> str:
    """Return what friction of `high` times the torque limit does to a policy that never met it."""
    if high < FELT:
        return "By itself it probably does not trouble a walking policy"
    if high < SEVERE:
        return "It may slow down a policy that was trained without friction"
    return "A policy that was trained without friction will probably lose much of its speed"


def friction_level(ratio: Estimate, condition: str | None) -> float:
    """Return the level that covers a ratio: the upper end, times `MARGIN` unless it was loaded, up to a whole per cent.

    May be `TRAINABLE` or more; who proposes it has to check.
    """
    high = max(ratio.interval95[1], 0.0)
    return math.ceil(100 * high * (1.0 if condition == "loaded" else MARGIN) - 1e-9) / 100
