"""Following: the one definition. Each commanded axis is judged alone, in the mean over walks and in the worst walk.

A cell, one policy under one friction and one command, follows when every commanded axis reaches 0.8 to 1.2 of the
command or comes within 0.05 m/s (0.05 rad/s) of it in the mean over walks, every other axis stays within 0.1, no walk
falls and none is under half of the command. Standing: a planar speed and a yaw rate under 0.05. A policy follows at a
friction when it follows every command there.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from stiction.files.results import FOLLOWS, ResultRow
from stiction.files.velocity import AXES, STAND, parse_command

COMMAND_SET = (
    *("vx=0.2", "vx=-0.2", "vx=0.5", "vx=-0.5", "vx=0.8", "vx=-0.8", "vy=0.3", "vy=-0.3"),
    *("wz=0.5", "wz=-0.5", "wz=1", "wz=-1", "vx=0.4,wz=0.5", "vx=0.4,vy=0.2", STAND),
)
"""Commands that a policy has to follow, by their labels; `scaled_commands` fits them to a slower robot."""

EVERY = "all"
"""Word in place of commands: the whole set, as `scaled_commands` has it."""

STALLS = 0.5
"""Smallest share of the command in any single walk [-]."""

NEAR = 0.05
"""Distance from the command that counts as reached at any ratio; bound of the speed of standing [m/s, rad/s]."""

DRIFT = 0.1
"""Largest mean velocity along an axis that is not commanded [m/s, rad/s]."""

Fault = Literal["falls", "too slow", "too fast", "drifts", "stalls"]
"""Reason why a command is not followed, the gravest first; `drifts` also where a robot told to stand moves."""


@dataclass(frozen=True)
class CommandVerdict:
    """Judgement of one row under the definition of this module."""

    row: ResultRow
    """The row, with its mean velocity."""
    faults: tuple[Fault, ...]
    """Reasons why the command is not followed, the gravest first; empty: it is followed."""
    miss: float
    """Distance of the mean velocity beyond the bounds, over all axes the largest [m/s, rad/s]; 0 within them."""

    @property
    def follows(self) -> bool:
        """True if the command is followed."""
        return not self.faults


DEFINITION = (
    f"A command is followed where each commanded axis reaches {100 * FOLLOWS[0]:g} to {100 * FOLLOWS[1]:g} % of it, or "
    f"comes within {NEAR:g} m/s (rad/s), in the mean over walks, every other axis stays within {DRIFT:g}, no walk "
    f"falls and none is under {100 * STALLS:g} % of the command."
)
"""For pages."""


def scaled_commands(reach: Sequence[float]) -> tuple[str, ...]:
    """Return the labels of the command set, each axis scaled by min(1, reach / largest of the set).

    reach: largest vx, vy [m/s] and wz [rad/s] of the robot or policy, shape (3,). Commands that become equal are listed
    once.
    """
    velocities = [parse_command(text).velocity for text in COMMAND_SET]
    scales = [min(1.0, limit / max(abs(velocity[axis]) for velocity in velocities)) for axis, limit in enumerate(reach)]
    labels = []
    for velocity in velocities:
        parts = [f"{axis}={value * scale:g}" for axis, value, scale in zip(AXES, velocity, scales, strict=True)]
        labels.append(parse_command(",".join(parts)).label)
    return tuple(dict.fromkeys(labels))


def judge_row(row: ResultRow) -> CommandVerdict | None:
    """Return whether a row's command is followed; None where the row has no mean velocity (older files)."""
    if row.mean_velocity is None:
        return None
    command = parse_command(row.command).velocity
    excess: dict[Fault, float] = {}
    if not any(command):
        excess["drifts"] = max(math.hypot(*row.mean_velocity[:2]), abs(row.mean_velocity[2])) - NEAR
    for reached, asked in zip(row.mean_velocity, command, strict=True):
        if asked:
            ratio = reached / asked
            fault: Fault = "too slow" if ratio < 1.0 else "too fast"
            outside = max(FOLLOWS[0] - ratio, ratio - FOLLOWS[1]) * abs(asked)
            amount = min(abs(reached - asked) - NEAR, outside)
        else:
            fault, amount = "drifts", abs(reached) - DRIFT if any(command) else -math.inf
        excess[fault] = max(amount, excess.get(fault, -math.inf))
    # Rounding of the bounds themselves is no miss.
    faults = {fault for fault, amount in excess.items() if amount > 1e-9}
    miss = max((excess[fault] for fault in faults), default=0.0)
    if row.fall_rate > 0.0:
        faults.add("falls")
    if row.slowest_walk is not None and row.slowest_walk < STALLS:
        faults.add("stalls")
    return CommandVerdict(row, tuple(fault for fault in get_args(Fault) if fault in faults), miss)


def worst_command(rows: Iterable[ResultRow]) -> CommandVerdict | None:
    """Return the verdict of the row that misses by most; None where every row with a mean velocity follows."""
    verdicts = [verdict for row in rows if (verdict := judge_row(row)) is not None and not verdict.follows]
    return max(verdicts, key=lambda verdict: ("falls" in verdict.faults, verdict.miss), default=None)
