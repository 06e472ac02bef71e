"""What benches found of virtual robots, beside what was there: one row a joint, and what follows from the rows.

This is a referee's record. It has the hidden numbers of the robots in it, and nothing that trains or drives reads it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median


@dataclass(frozen=True)
class IdentifiedFriction:
    """The dry friction of one joint of one robot."""

    robot: str
    """Name of the robot's folder: `saturn_lite--physx--all--0.1--1000`."""
    engine: str
    """Engine that the robot is in."""
    cell: str
    """What of the robot is real."""
    level: str
    """Its dry friction, as people type it: `0.1`, `bench+0.02`."""
    seed: int
    """Of the robot."""
    joint: str
    """Name of the joint."""
    friction: float
    """Truth: Coulomb friction without load, f [N m]."""
    load: float
    """Truth: what the load law adds to it while the joint moves on the bench, mean [N m]."""
    strength: float
    """Truth: torque that the motor gives over torque that it reports, k [1]."""
    identified: float | None
    """Coulomb friction that was found [N m]; None where the joint was refused."""
    low: float | None
    """Lower end of its 95 % interval [N m]."""
    high: float | None
    """Upper end."""

    @property
    def shown(self) -> float:
        """What a perfect log shows, (f + load)/k [N m]: torque is logged in the unit of the motor's own reports."""
        return (self.friction + self.load) / self.strength

    @property
    def holds(self) -> bool:
        """Whether the interval holds what a perfect log shows."""
        return self.low is not None and self.high is not None and self.low <= self.shown <= self.high

    @property
    def holds_friction(self) -> bool:
        """Whether the interval holds f itself."""
        return self.low is not None and self.high is not None and self.low <= self.friction <= self.high

    @property
    def error(self) -> float | None:
        """Relative error of what was found against what a perfect log shows [1]; None where there is neither."""
        return None if self.identified is None or self.shown == 0.0 else self.identified / self.shown - 1.0

    @property
    def friction_error(self) -> float | None:
        """Relative error against f itself [1]."""
        return None if self.identified is None or self.friction == 0.0 else self.identified / self.friction - 1.0


@dataclass(frozen=True)
class Score:
    """How well the friction of some joints was found."""

    joints: int
    """Number of joints."""
    identified: int
    """... that were not refused."""
    held: int
    """... whose interval holds what a perfect log shows."""
    held_friction: int
    """... whose interval holds f itself."""
    median_error: float | None
    """Median size of the relative error against what a perfect log shows [1]; None where no joint has one."""
    worst_error: float | None
    """Relative error of the largest size, with its sign [1]."""
    worst_joint: str
    """Robot and joint that have it; empty without one."""
    median_friction_error: float | None
    """Median size of the relative error against f itself [1]."""
    worst_friction_error: float | None
    """Relative error of the largest size against f itself, with its sign [1]."""


def score(rows: Sequence[IdentifiedFriction]) -> Score:
    """Return how well the friction of these joints was found."""
    errors = {f"{row.robot} {row.joint}": row.error for row in rows if row.error is not None}
    true_errors = [row.friction_error for row in rows if row.friction_error is not None]
    worst = max(errors, key=lambda name: abs(errors[name]), default="")
    return Score(
        joints=len(rows),
        identified=sum(row.identified is not None for row in rows),
        held=sum(row.holds for row in rows),
        held_friction=sum(row.holds_friction for row in rows),
        median_error=median(map(abs, errors.values())) if errors else None,
        worst_error=errors.get(worst),
        worst_joint=worst,
        median_friction_error=median(map(abs, true_errors)) if true_errors else None,
        worst_friction_error=max(true_errors, key=abs, default=None),
    )
