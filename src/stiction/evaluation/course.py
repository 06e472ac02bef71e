"""Ground of an evaluation: flat, or a course of the training that a policy crosses without seeing it.

Over a course the command holds the robot's heading, as in training, and corrects nothing else. A robot that is upright
beyond the end of the course has crossed it; of stairs it must have climbed all steps.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.core.provenance import seed_streams
from stiction.core.rotation import about
from stiction.files.velocity import AXES, Command
from stiction.robots.terrain import KINDS, REACH, SLABS, STEEPEST, STEPS, Terrain, stair_height
from stiction.task.terrain import (
    FINISH_MARGIN,
    HEADING_ERROR,
    LENGTH,
    SCAN_POINTS,
    START,
    UNDER_TRUNK,
    TerrainCfg,
    hold_heading,
)

if TYPE_CHECKING:  # Webots runs a policy by what is here, where there may be no MuJoCo.
    from stiction.files.contract import Contract
    from stiction.sim.fleet import Fleet
    from stiction.virtual.drive import Commands

UNITS = {"slope": "its angle [rad]", "rough": "its highest slab [m]", "stairs": "the height of a step [m]"}

START_HALF_WIDTH = 0.5
"""Half-width of the start, across the course [m]: the whole trunk is before the landing, whose half-width is 0.9 m."""

START_DISTANCE = REACH + START
"""Distance from the middle of a course back to where robots start [m]."""

PATIENCE = 2.0
"""Longest time of a crossing over the time at the commanded speed [1]."""


@dataclass(frozen=True)
class Course:
    """Ground of an evaluation."""

    kind: str = "flat"
    size: float = 0.0
    """Height of a step [m], angle of the slope [rad], height of the highest slab [m]; of flat ground 0."""

    def __post_init__(self) -> None:
        """Reject a course that does not exist."""
        if self.kind not in KINDS:
            raise ConfigurationError(unknown_name("terrain", self.kind, KINDS))
        steepest = STEEPEST.get(self.kind, 0.0)
        if not (0 < self.size <= steepest or (self.kind == "flat" and self.size == 0)):
            limits = ", ".join(f"{kind}=SIZE with a size up to {limit:g}" for kind, limit in STEEPEST.items())
            raise ConfigurationError(
                f"terrain {self.label!r}: expected flat, {limits} (height of a step [m], angle [rad], highest slab [m])"
            )

    @property
    def label(self) -> str:
        """Name in results: `flat`, `stairs=0.1`."""
        return self.kind if self.is_flat else f"{self.kind}={self.size:g}"

    @property
    def is_flat(self) -> bool:
        """True if the ground is flat."""
        return self.kind == "flat"

    def takes(self, command: Command) -> bool:
        """Return True if a command can be walked here: over a course only straight forward."""
        forward, *rest = command.velocity
        return self.is_flat or (forward > 0 and not any(rest))

    def seconds(self, command: Command, flat: float) -> float:
        """Return the longest duration of a walk [s]: `flat` on flat ground, else `PATIENCE` times a crossing's."""
        return flat if self.is_flat else PATIENCE * LENGTH / command.speed

    def terrain(self, num: int, seed: int = 0) -> Terrain | None:
        """Return the ground of `num` robots, the same for each, None where it is flat; seed: of rough ground."""
        if self.is_flat:
            return None
        terrain = Terrain(np.full(num, KINDS.index(self.kind)))
        slabs = np.random.default_rng(seed).uniform(size=(1, SLABS, 4))
        terrain.place(np.arange(num), np.full(num, self.size / STEEPEST[self.kind]), np.repeat(slabs, num, axis=0))
        return terrain

    def judge(self, position: np.ndarray, upright: np.ndarray) -> tuple[float | None, float | None]:
        """Return mean steps passed and share that crossed, None without; position (T, N, 2) [m], upright (T, N)."""
        if self.is_flat:
            return None, None
        over = crossed(position, upright, self.kind == "stairs").any(axis=0).mean()
        if self.kind != "stairs":
            return None, float(over)
        up, down = steps_passed(position, upright)
        return float((up[-1] + down[-1]).mean()), float(over)


FLAT = Course()


def parse_course(text: str) -> Course:
    """Return the course named by a text: `flat`, `stairs=0.1`. Raises `StictionError` for an unknown one."""
    kind, equals, number = text.strip().partition("=")
    if kind in STEEPEST and not equals:
        expected = f"{kind}=SIZE, {UNITS[kind]} up to {STEEPEST[kind]:g}"
        raise ConfigurationError(f"terrain {kind!r} has no size: expected {expected}")
    try:
        size = float(number) if equals else 0.0
    except ValueError:
        size = math.nan
    return Course(kind, size)


def starts(seed: int, count: int) -> np.ndarray:
    """Return the start poses of walks over a course, sideways [m] and heading [rad], (count, 2), each by its number."""
    return seed_streams(seed, ["start"])["start"].uniform(-1.0, 1.0, (count, 2)) * (START_HALF_WIDTH, HEADING_ERROR)


def line_up(fleet: Fleet, start: np.ndarray) -> None:
    """Put robots before their courses; start: as from `starts`, shape (k, 2): robot i gets row i modulo k."""
    fleet.show_terrain(np.arange(fleet.num_envs))
    sideways, heading = np.tile(start, (fleet.num_envs // len(start), 1)).T
    fleet.base_position[:, 0], fleet.base_position[:, 1] = -START_DISTANCE, sideways
    fleet.base_quaternion[:] = about(2, heading)


def course_commands(fleet: Fleet, speed: np.ndarray) -> Commands:
    """Return the commands of a fleet along its courses at speeds (N,) [m/s], velocities of shape (N, 3)."""

    def commands(number: int) -> np.ndarray:
        fleet.ground[:] = fleet.ground_around(SCAN_POINTS[UNDER_TRUNK]).mean(-1)
        return np.stack((speed, np.zeros_like(speed), straight_on(fleet.yaw)), -1)

    return commands


def straight_on(yaw: np.ndarray | float) -> np.ndarray:
    """Return the turn rate [rad/s] that turns a robot with that yaw [rad] back to the direction x."""
    return hold_heading(-np.asarray(yaw), TerrainCfg.heading_gain)


def crossed(position: np.ndarray, upright: np.ndarray, stairs: bool) -> np.ndarray:
    """Return True for each robot and step upright beyond the course, (T, N); stairs: only after the landing."""
    over = (position[..., 0] > REACH + FINISH_MARGIN) & upright
    return over & (steps_passed(position, upright)[0] == STEPS) if stairs else over


def steps_passed(position: np.ndarray, upright: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the steps passed upright until each moment, up and down, (T, N); position: of the base, (T, N, 2) [m]."""
    level = stair_height(position, np.ones((1, 1)))
    up = np.maximum.accumulate(level * upright)
    # On the far side the level falls again: its drop below the highest level reached is the steps down.
    down = np.maximum.accumulate((up - level) * (upright & (position[..., 0] > 0.0)))
    return up, down


SETTLE = 2.0
"""Time at the start of a walk that is not measured [s]: the robot accelerates."""


def untrained(commands: Iterable[Command], contract: Contract) -> str:
    """Return a note on commands outside a policy's training range, and that range; empty if all are inside."""
    # Imported here: code that only reads commands, such as a study's options, loads no runtime.
    from stiction.deploy.plausibility import command_range

    low, high = command_range(contract)
    beyond = [
        command.label for command in commands if not ((low <= command.velocity) & (command.velocity <= high)).all()
    ]
    spans = ", ".join(f"{axis} {a:g} to {b:g}" for axis, a, b in zip(AXES, low, high, strict=True))
    return f"command {', '.join(beyond)}: the policy was trained for {spans}" if beyond else ""
