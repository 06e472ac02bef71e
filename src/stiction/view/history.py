"""History for the plots: speed, one joint's torque, estimated and true friction, and reward terms."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from stiction.files.velocity import Command
from stiction.view.simulation import Simulation, Walker

AVERAGE = 0.5
"""Time over which speeds and rewards are averaged, a stride or more [s]."""

SPEED, TORQUE, FRICTION = 20.0, 4.0, 120.0
"""Time span of each plot [s]."""

COLUMNS = 4
"""Numbers per robot in the history of friction: estimate and interval if trusted, and the estimate if not."""

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

    def __init__(self, simulation: Simulation, span: float | None = None) -> None:
        """Start without any rows; span: of all plots [s], by default `SPEED`, `TORQUE` and `FRICTION`."""
        self._simulation = simulation
        robots, period = len(simulation.walkers), simulation.period
        self.joint = simulation.spec.joint_names[-1]
        """Name of the joint whose torque is recorded."""
        self.speed = Track(1 + robots, math.ceil((span or SPEED) / SPEED_EVERY))
        """Commanded speed, then each robot's along the command, forward if it stands [m/s, of a turn rad/s]."""
        self.torque = Track(robots, round((span or TORQUE) / period))
        """Motor torque of one joint of each robot [N m]."""
        self.friction = Track(1 + COLUMNS * robots, math.ceil((span or FRICTION) / FRICTION_EVERY))
        """Mean of f/τ_max over the joints [%]: the true one of the first robot that walks; of each robot `COLUMNS`."""
        self._velocities: list[deque[np.ndarray]] = [deque(maxlen=round(AVERAGE / period)) for _ in range(robots)]
        self._rewards: list[deque[dict[str, float]]] = [deque(maxlen=round(AVERAGE / period)) for _ in range(robots)]
        self._due = {"speed": 0.0, "friction": 0.0}

    def clear(self) -> None:
        """Begin anew: the robots were put to the start."""
        for track in (self.speed, self.torque, self.friction):
            track.clear()
        for velocities, rewards in zip(self._velocities, self._rewards, strict=True):
            velocities.clear()
            rewards.clear()
        self._due = dict.fromkeys(self._due, 0.0)

    def show_joint(self, name: str) -> None:
        """Record the torque of another joint."""
        self.joint = name
        self.torque.clear()

    def add(self) -> None:
        """Add the last control step."""
        simulation = self._simulation
        time, walkers = simulation.time, simulation.walkers
        number = simulation.spec.joint_names.index(self.joint)
        self.torque.add(time, *(0.0 if walker.lies else float(walker.seen.torque[number]) for walker in walkers))
        for walker, velocities in zip(walkers, self._velocities, strict=True):
            velocities.append(np.zeros(3) if walker.lies else walker.seen.velocity)
        for walker, rewards in zip(walkers, self._rewards, strict=True):
            if walker.rewards is not None and not walker.lies:
                rewards.append(walker.rewards.values)
        if time >= self._due["speed"]:
            # The time is a sum of periods; its rounding must not delay a point by a step.
            self._due["speed"] = time + SPEED_EVERY - 1e-9
            self.speed.add(time, *self.speeds())
        if time >= self._due["friction"]:
            self._due["friction"] = time + FRICTION_EVERY - 1e-9
            self.friction.add(time, self._true(), *(number for walker in walkers for number in believed(walker)))

    def speeds(self) -> list[float]:
        """Return the commanded speed and each robot's mean speed along it, over `AVERAGE` [m/s, of a turn rad/s]."""
        velocity = self._simulation.velocity
        command = Command("", (float(velocity[0]), float(velocity[1]), float(velocity[2])))
        direction = np.array([1.0, 0.0, 0.0]) if command.direction is None else command.direction
        means = [float(np.mean(past, axis=0) @ direction) if past else 0.0 for past in self._velocities]
        return [float(velocity @ direction), *means]

    def rewards(self, robot: int) -> dict[str, float]:
        """Return the mean of each reward term of a robot over `AVERAGE`, weighted, by name [1/s]; empty without any."""
        past = self._rewards[robot]
        names = past[-1] if past else {}
        return {name: float(np.mean([values[name] for values in past if name in values])) for name in names}

    def _true(self) -> float:
        """Return the mean of f/τ_max over the joints of the first robot that walks [%]."""
        limit = self._simulation.spec.joint_values("torque_limit")
        for walker in self._simulation.walkers:
            if not walker.lies:
                return 100.0 * float((walker.seen.friction / limit).mean())
        return np.nan


def believed(walker: Walker) -> tuple[float, ...]:
    """Return the estimated mean of f/τ_max, the ends of its 95 % interval, and the estimate if not trusted [%].

    NaN: no estimate yet, or not of this kind.
    """
    if walker.belief is None:
        return (np.nan,) * COLUMNS
    estimate = walker.belief.estimate
    if walker.doubt is not None:
        return np.nan, np.nan, np.nan, 100.0 * estimate.level
    low, high = estimate.level_interval95
    return 100.0 * estimate.level, 100.0 * low, 100.0 * high, np.nan


def belief_text(walkers: Sequence[Walker]) -> str:
    """Return the friction estimate of every robot, or why it has none, as Markdown."""
    silent = ", ".join(walker.policy.short for walker in walkers if not walker.believes)
    sentences = [f"**{walker.policy.short}** {friction_text(walker)}." for walker in walkers if walker.believes]
    if silent:
        sentences.append(f"{silent}: no estimate without a wear.json (`stiction export --wear`).")
    return "\n\n".join(sentences)


def friction_text(walker: Walker) -> str:
    """Return the friction estimate of a robot with a map, or the reason not to trust it."""
    if walker.belief is None:
        return "has no estimate yet; it takes a window of walking"
    estimate = walker.belief.estimate
    low, high = estimate.level_interval95
    numbers = f"{100 * estimate.level:.0f} % of the torque limits ({100 * low:.0f} to {100 * high:.0f} %)"
    if walker.doubt is not None:
        return f"estimates {numbers}, not trusted (grey, dashed): {walker.doubt}"
    return f"estimates a friction of {numbers}"
