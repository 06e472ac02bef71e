"""What the plots show: the last seconds of speed, one joint's torque, and friction believed beside the true one."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from stiction.files.velocity import Command
from stiction.view.simulation import Simulation, Walker

AVERAGE = 0.5
"""Speeds are means over so long, a stride or more [s]."""

SPEED, TORQUE, FRICTION = 20.0, 4.0, 120.0
"""How far back each plot goes [s]."""

SPEED_EVERY, FRICTION_EVERY = 0.1, 1.0
"""Time between two points [s]; torque has one every control step."""


class Track:
    """The newest rows of some numbers over time."""

    def __init__(self, width: int, length: int) -> None:
        """width: numbers in a row; length: rows that are kept."""
        self._width, self._rows = width, deque[tuple[float, ...]](maxlen=length)

    def add(self, time: float, *values: float) -> None:
        """Add a row; NaN where there is nothing."""
        assert len(values) == self._width
        self._rows.append((time, *values))

    def clear(self) -> None:
        """Forget all rows."""
        self._rows.clear()

    def columns(self) -> tuple[np.ndarray, ...]:
        """Return time and values, each of shape (rows,); one row of NaN at time 0 where there is none."""
        rows = np.array(self._rows or [(0.0, *[np.nan] * self._width)])
        return tuple(np.ascontiguousarray(column) for column in rows.T)


class History:
    """The last seconds of a simulation."""

    def __init__(self, simulation: Simulation) -> None:
        """Begin with nothing."""
        self._simulation = simulation
        robots, period = len(simulation.walkers), simulation.period
        self.joint = simulation.spec.joint_names[-1]
        """Name of the joint whose torque is shown."""
        self.speed = Track(1 + robots, round(SPEED / SPEED_EVERY))
        """Commanded, then of each robot, along the command; forward where none is given [m/s, of a turn rad/s]."""
        self.torque = Track(robots, round(TORQUE / period))
        """Of each robot's motor in one joint [N m]."""
        self.friction = Track(1 + 3 * robots, round(FRICTION / FRICTION_EVERY))
        """Mean of f/τ_max over the joints: the true one of the first robot that walks; of each robot what its walk
        tells, and the ends of the 95 % interval [%]."""
        self._velocities: list[deque[np.ndarray]] = [deque(maxlen=round(AVERAGE / period)) for _ in range(robots)]
        self._due = {"speed": 0.0, "friction": 0.0}

    def clear(self) -> None:
        """Begin anew: the robots were put to the start."""
        for track in (self.speed, self.torque, self.friction):
            track.clear()
        for velocities in self._velocities:
            velocities.clear()
        self._due = dict.fromkeys(self._due, 0.0)

    def show_joint(self, name: str) -> None:
        """Show the torque of another joint."""
        self.joint = name
        self.torque.clear()

    def add(self) -> None:
        """Add what the last control step brought."""
        simulation = self._simulation
        time, walkers = simulation.time, simulation.walkers
        number = simulation.spec.joint_names.index(self.joint)
        self.torque.add(time, *(0.0 if walker.lies else float(walker.seen.torque[number]) for walker in walkers))
        for walker, velocities in zip(walkers, self._velocities, strict=True):
            velocities.append(np.zeros(3) if walker.lies else walker.seen.velocity)
        if time >= self._due["speed"]:
            # Less a hair: the time is a sum of periods, and its rounding must not put a point off by a step.
            self._due["speed"] = time + SPEED_EVERY - 1e-9
            self.speed.add(time, *self.speeds())
        if time >= self._due["friction"]:
            self._due["friction"] = time + FRICTION_EVERY - 1e-9
            self.friction.add(time, self._true(), *(end for walker in walkers for end in believed(walker)))

    def speeds(self) -> list[float]:
        """Return the commanded speed and each robot's mean speed along it, over `AVERAGE` [m/s, of a turn rad/s]."""
        velocity = self._simulation.velocity
        command = Command("", (float(velocity[0]), float(velocity[1]), float(velocity[2])))
        direction = np.array([1.0, 0.0, 0.0]) if command.direction is None else command.direction
        means = [float(np.mean(past, axis=0) @ direction) if past else 0.0 for past in self._velocities]
        return [float(velocity @ direction), *means]

    def _true(self) -> float:
        """Return the mean of f/τ_max over the joints of the first robot that walks [%]."""
        limit = self._simulation.spec.joint_values("torque_limit")
        for walker in self._simulation.walkers:
            if not walker.lies:
                return 100.0 * float((walker.seen.friction / limit).mean())
        return np.nan


def believed(walker: Walker) -> tuple[float, float, float]:
    """Return what a robot's walk tells of its friction: the mean of f/τ_max and its 95 % interval [%]; NaN: nothing."""
    estimate = walker.belief
    if estimate is None:
        return (np.nan, np.nan, np.nan)
    low, high = estimate.level_interval95
    return 100.0 * estimate.level, 100.0 * low, 100.0 * high


def belief_text(walkers: Sequence[Walker]) -> str:
    """Return in some sentences what the robots' walks tell of their joints' friction, Markdown."""
    silent = ", ".join(walker.policy.short for walker in walkers if not walker.believes)
    sentences = [f"**{walker.policy.short}** {friction_text(walker)}." for walker in walkers if walker.believes]
    if silent:
        sentences.append(f"{silent}: no wear.json, so the walk tells nothing of the joints' friction.")
    return "\n\n".join(sentences)


def friction_text(walker: Walker) -> str:
    """Return what the walk of a robot that has a map for it tells of its joints' friction."""
    estimate = walker.belief
    if estimate is None:
        return "has not told its joints' friction yet: that takes a window of walking"
    why = estimate.untold[-1]
    if why is not None:
        return f"does not tell its joints' friction: {why}"
    level, low, high = believed(walker)
    return f"tells a friction of {level:.0f} % of the torque limits ({low:.0f} to {high:.0f} %)"
