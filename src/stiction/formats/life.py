"""How long a policy lives while friction grows: what was seen, window by window, and what became of each robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

End = Literal["alive", "too slow", "too fast", "fell", "too slow from the start", "too fast from the start"]
"""How a life ended: not at all, it follows to the last; too slow or too fast for good; by a fall, before that; or it
never was one: no window follows, and so was the first."""

NEVER = " from the start"
"""What ends the name of an end without a life before it."""

Notice = Literal["before", "after", "at once", "never"]
"""When a monitor noticed: before the life ended, after that, at its first reading, before any wear, or not at all. A
life that never was one has no before."""


@dataclass(frozen=True)
class Walk:
    """Which walk a row is about."""

    policy: str
    """Name of the bundle."""
    friction_level: str
    """Level that wear multiplies, as it was typed: `0.1`, `bench+0.02`."""
    robot: int
    """Seed of the virtual robot."""
    steady: float | None
    """Wear at which the friction stayed, of a control walk, in which nothing grew [1]; None: it grew."""


@dataclass(frozen=True)
class Window(Walk):
    """The speed over one window; a row of windows.csv."""

    time: float
    """End of the window, when it is known, since the robot was put in place [s]."""
    factor: float
    """Wear in the middle of it [1]."""
    ratio: float
    """Mean speed along the command over the commanded speed [-]."""


@dataclass(frozen=True)
class Reading(Walk):
    """What the wear monitor said of one target at the end of one of its windows; a row of readings.csv."""

    target: str
    """`level`, the mean over the joints, or the joint that wears."""
    time: float
    """End of the monitor's window [s]."""
    factor: float
    """Wear in the middle of it [1]."""
    true: float
    """Dry friction in motion there, as a bench without load would have found it, over the torque limit [-]."""
    estimate: float | None
    """What the monitor took it for [-]; None where its map does not tell this target."""
    low: float | None
    """Lower end of its 95 % interval [-]."""
    high: float | None
    """Upper end [-]."""
    unusual: bool
    """Whether it said that the walk is unlike those that it knows."""


@dataclass(frozen=True)
class Life(Walk):
    """What became of one robot; a row of lives.csv."""

    method: str
    """How the policy was trained."""
    engine: str
    """Physics engine."""
    command: str
    """What was commanded: `vx=0.5`."""
    first_ratio: float | None
    """Speed ratio of the first window [-]; None where the robot fell before its end."""
    last_ratio: float | None
    """... and of the last one [-]."""
    begin: float | None
    """Wear at which it first follows [1]; None where it does in the first window, or never."""
    end: End
    """How it ended."""
    factor: float | None
    """Wear at which the life ended [1]; None where it did not, or never was one."""
    time: float | None
    """When that was known [s]."""
    monitored: bool
    """Whether the bundle has a wear monitor."""
    unusual_factor: float | None
    """Wear at the monitor's first unusual reading [1]; None without one."""
    unusual: Notice
    """When that came."""
    grown_factor: float | None
    """Wear at the first reading whose interval lies wholly above the first reading's [1]; None without one."""
    grown: Notice
    """When that came."""
    held: float | None
    """Share of the readings whose interval held the truth [-]; None where none was told."""
