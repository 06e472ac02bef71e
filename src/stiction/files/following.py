"""Definition of following: each commanded axis is judged separately, in the mean over walks and in the worst walk.

A cell, one policy under one friction and one command, follows when every commanded axis reaches 0.8 to 1.2 of the
command or comes within 0.05 m/s (0.05 rad/s) of it in the mean over walks, every other axis stays within 0.1, no walk
falls and none is under half of the command. Standing: a planar speed and a yaw rate under 0.05. For virtual robots the
slowest and the fastest are judged too, along the command. A policy follows at a friction when it follows every command
there; a training, of three seeds or more, when each of them does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from stiction.files.results import FOLLOWS, ResultRow
from stiction.files.velocity import AXES, STAND, parse_command

COMMAND_SET = (
    *("vx=0.2", "vx=-0.2", "vx=0.5", "vx=-0.5", "vx=0.8", "vx=-0.8", "vy=0.3", "vy=-0.3"),
    *("wz=0.5", "wz=-0.5", "wz=1", "wz=-1", "vx=0.4,wz=0.5", "vx=0.4,vy=0.2", STAND),
)
"""Command set, by labels; `scaled_commands` fits it to a slower robot."""

EVERY = "all"
"""Word for the whole command set, as in `scaled_commands`."""

STALLS = 0.5
"""Minimum share of the command in any single walk [-]."""

NEAR = 0.05
"""Distance to the command that counts as reached at any ratio; bound of the speed of standing [m/s, rad/s]."""

DRIFT = 0.1
"""Maximum mean velocity along an axis that is not commanded [m/s, rad/s]."""

Fault = Literal["falls", "too slow", "too fast", "drifts", "stalls"]
"""Reason why a command is not followed, the gravest first; `drifts` also if a robot that is told to stand moves."""


@dataclass(frozen=True)
class CommandVerdict:
    """Judgement of one row under the definition of this module."""

    row: ResultRow
    """The row, with its mean velocity."""
    faults: tuple[Fault, ...]
    """Reasons why the command is not followed, the gravest first; empty: it is followed."""
    miss: float
    """Maximum distance of the mean velocity beyond the bounds, over all axes [m/s, rad/s]; 0 within them."""

    @property
    def follows(self) -> bool:
        """True if the command is followed."""
        return not self.faults

    @property
    def text(self) -> str:
        """Command and faults: `wz=0.5: too slow, stalls`."""
        return f"{self.row.command}: {', '.join(self.faults)}"


DEFINITION = (
    f"A command is followed where each commanded axis reaches {100 * FOLLOWS[0]:g} to {100 * FOLLOWS[1]:g} % of it, or "
    f"comes within {NEAR:g} m/s (rad/s), in the mean over walks, every other axis stays within {DRIFT:g}, no walk "
    f"falls and none is under {100 * STALLS:g} % of the command."
)
"""Definition for pages."""


def scaled_commands(reach: Sequence[float]) -> tuple[str, ...]:
    """Return the labels of the command set, each axis scaled by min(1, reach / maximum of the set).

    reach: maximum vx, vy [m/s] and wz [rad/s] of the robot or policy, shape (3,). Commands that become equal are listed
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
    command = parse_command(row.command)
    excess: dict[Fault, float] = {}
    if not command.speed:
        excess["drifts"] = max(math.hypot(*row.mean_velocity[:2]), abs(row.mean_velocity[2])) - NEAR
    robots = [(ratio * command.speed, command.speed) for ratio in (row.slowest, row.fastest) if ratio is not None]
    for reached, commanded in (*zip(row.mean_velocity, command.velocity, strict=True), *robots):
        if commanded:
            ratio = reached / commanded
            fault: Fault = "too slow" if ratio < 1.0 else "too fast"
            outside = max(FOLLOWS[0] - ratio, ratio - FOLLOWS[1]) * abs(commanded)
            amount = min(abs(reached - commanded) - NEAR, outside)
        else:
            fault, amount = "drifts", abs(reached) - DRIFT if command.speed else -math.inf
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


FEWEST_SEEDS = 3
"""Minimum number of training seeds for a statement about a training: a choice."""


@dataclass(frozen=True)
class CommandCount:
    """Commands that the policies of one training follow in one place under one friction."""

    method: str
    engine: str
    """Engine, with the imperfections of a virtual robot."""
    friction_law: str
    friction_level: float
    """Friction over the torque limit, or a coefficient [-]."""
    seeds: int
    follow_all: int
    """Number of seeds that follow every command walked there."""
    cells: int
    """Pairs of seed and command; for virtual robots that walked separately a pair for each."""
    followed: int
    miss: float
    """Mean distance beyond the bounds over the cells [m/s, rad/s]."""
    largest_miss: float
    """Maximum distance beyond the bounds [m/s, rad/s]."""
    worst: str
    """Command that misses by most, and its faults: `wz=0.5: too slow`; empty if all are followed."""
    each: str = ""
    """Commands that each seed follows, separated by blanks; empty in older files."""

    @property
    def by_seed(self) -> tuple[int, ...]:
        """Commands that each seed follows; empty if unknown."""
        return tuple(map(int, self.each.split()))

    @property
    def every_seed(self) -> bool:
        """True if every seed follows every command."""
        return self.follow_all == self.seeds

    @property
    def covered(self) -> bool:
        """True if every seed follows every command, with enough seeds for a statement about the training."""
        return self.every_seed and self.seeds >= FEWEST_SEEDS

    @property
    def text(self) -> str:
        """Seeds that follow all commands: `4 of 5 (73 of 75 cells, worst wz=1: too slow)`."""
        share = f" ({self.followed} of {self.cells} cells, worst {self.worst})" if self.worst else ""
        return f"{self.follow_all} of {self.seeds}{share}"


def count_commands(
    rows: Iterable[ResultRow], method_of: Callable[[ResultRow], str] = lambda row: row.method
) -> list[CommandCount]:
    """Return the counts by method, engine, friction law and level on flat ground, in the order of the rows.

    method_of: row -> its training method; each of its policies is one training seed. Rows without a mean velocity, of
    older files, do not count.
    """
    cells: dict[tuple[str, str, str, float], list[CommandVerdict]] = {}
    for row in rows:
        if row.terrain == "flat" and (verdict := judge_row(row)) is not None:
            cell = method_of(row), row.engine, row.friction_law, round(row.friction_level, 6)
            cells.setdefault(cell, []).append(verdict)
    counts = []
    for cell, verdicts in cells.items():
        walked = {(verdict.row.policy, verdict.row.command) for verdict in verdicts}
        followed = walked - {(item.row.policy, item.row.command) for item in verdicts if not item.follows}
        policies, commands = ({pair[part] for pair in walked} for part in (0, 1))
        worst = worst_command(verdict.row for verdict in verdicts)
        misses = [verdict.miss for verdict in verdicts]
        counts.append(
            CommandCount(
                *cell,
                seeds=len(policies),
                follow_all=sum(all((policy, command) in followed for command in commands) for policy in policies),
                cells=len(verdicts),
                followed=sum(verdict.follows for verdict in verdicts),
                miss=sum(misses) / len(misses),
                largest_miss=max(misses),
                worst="" if worst is None else worst.text,
                each=" ".join(str(sum(item == policy for item, _ in followed)) for policy in sorted(policies)),
            )
        )
    return counts
