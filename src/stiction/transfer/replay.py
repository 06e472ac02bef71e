"""A walk on a virtual robot as something to be filmed: its motion, replayed without physics in MuJoCo's renderer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from stiction.formats.bundle import Bundle
from stiction.sim.fleet import Fleet
from stiction.transfer.command import Command
from stiction.transfer.engines.catalog import make_engine
from stiction.transfer.engines.engine import Motion
from stiction.transfer.robot.factorial import Case, Level
from stiction.transfer.robot.trial import World, walk

ENGINE, CELL = "physx", "all"
"""Where the robot walks, an engine that no policy was trained in, and what of it is real."""


def walked(bundle: Bundle, robot: int, level: float, command: Command, steps: int) -> list[Motion]:
    """Let a bundle walk on a virtual robot; return its motion at the start of every control period until it falls.

    robot: its seed; level: mean over its joints of f/τ_max [-].

    Raises:
        StictionError: the bundle does not fit the robot, or the engine is not installed.

    """
    velocity = np.array(command.velocity)
    motions: list[Motion] = []

    def steer(step: int, motion: Motion) -> np.ndarray:
        motions.append(motion)
        return velocity

    walk(bundle, Case(robot, CELL, Level(level)), World(partial(make_engine, ENGINE)), steer, steps)
    return motions


def replay(fleet: Fleet, motions: Sequence[Motion]) -> Callable[[], None]:
    """Return what puts the first robot of a fleet where the next of the motions has it; it stays in the last one.

    Engine and fleet have the same base frame, quaternions w, x, y, z, and joints in the order of the robot's.
    """
    left = iter(motions)

    def advance() -> None:
        motion = next(left, None)
        if motion is not None:
            fleet.base_position[0] = motion.base_position
            fleet.base_quaternion[0] = motion.base_quaternion
            fleet.joint_position[0] = motion.joint_position

    return advance
