"""Clips of one policy, on the robot of the data sheet or a virtual one, rendered in a process of its own."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

import numpy as np

from stiction.core.lifeline import follow_parent
from stiction.core.opengl import render
from stiction.deploy.check import check_for_simulation
from stiction.evaluation.clip import (
    FRAME_EVERY,
    SETTLE,
    TIMEOUT,
    ClipError,
    compiled,
    following,
    posed,
    walked,
    write_clip,
)
from stiction.files.bundle import Bundle
from stiction.files.contract import robot_of
from stiction.files.velocity import Command, parse_command

ENGINE, CELL = "physx", "all"
"""Engine in which a virtual robot walks, one that no policy was trained in, and what of the robot is real."""


def record_clip(
    bundle: Path,
    level: float,
    command: str,
    out: Path,
    seconds: float = 4.0,
    law: str = "coulomb",
    robot: int | None = None,
) -> Path:
    """Render a clip of a bundle at a friction level under a command; return its path.

    level: fraction of the torque limit, or the law's coefficient [-]; seconds: length [s]; robot: seed of a virtual
    robot in PhysX, by default the robot of the data sheet in MuJoCo. Raises `ClipError` without OpenGL.
    """
    # Words are told by their places: only the last one may be left out.
    words = [word for word in (out, bundle, level, command, seconds, law, robot) if word is not None]
    return render("stiction_experiments.replication.filmed", words, out, TIMEOUT, ClipError, "clip")


def walked_virtually(bundle: Bundle, robot: int, level: float, command: Command, seconds: float) -> np.ndarray:
    """Return the state of a virtual robot, by its seed, at the start of every control period, as `walked` does."""
    from stiction.engines.catalog import make_engine
    from stiction.engines.engine import Motion
    from stiction.virtual.cases import Case, Level
    from stiction.virtual.trial import World, walk

    velocity, states = np.array(command.velocity), []

    def steer(step: int, motion: Motion) -> np.ndarray:
        states.append(np.concatenate((motion.base_position, motion.base_quaternion, motion.joint_position)))
        return velocity

    steps = round(seconds / bundle.contract.control_period)
    walk(bundle, Case(robot, CELL, Level(level)), World(partial(make_engine, ENGINE)), steer, steps)
    return np.array(states + states[-1:] * (steps - len(states)))


def _render_one(
    out: str, path: str, level: str, command: str, seconds: str, law: str = "coulomb", robot: str = ""
) -> None:
    """Render in this process; arguments as of `record_clip`."""
    bundle, length = check_for_simulation(path), SETTLE + float(seconds)
    what = float(level), parse_command(command), length
    states = walked_virtually(bundle, int(robot), *what) if robot else walked(bundle, *what, law)[1:]
    period, model = bundle.contract.control_period, compiled(robot_of(bundle.contract))
    shown = [step for step in range(len(states)) if step * period >= SETTLE and step % FRAME_EVERY == 0]
    write_clip(model, posed(model, [states[shown]]), following(model), FRAME_EVERY * period, Path(out))


if __name__ == "__main__":
    follow_parent()
    _render_one(*sys.argv[1:])
