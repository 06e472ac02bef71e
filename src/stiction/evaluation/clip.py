"""Renders a short clip of a bundle walking, as an animated WebP.

Rendering happens in a process of its own, see `core.opengl`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import EngineError
from stiction.core.lifeline import follow_parent
from stiction.core.opengl import render
from stiction.core.provenance import seed_streams
from stiction.deploy.check import check_for_simulation, robot_of
from stiction.deploy.policy import load_policy
from stiction.engines.catalog import make_engine
from stiction.engines.engine import Motion
from stiction.evaluation.rollout import COULOMB, Rollout, friction_at
from stiction.files.bundle import Bundle
from stiction.files.velocity import Command, parse_command
from stiction.joints.friction import Law
from stiction.sim.fleet import Fleet
from stiction.virtual.cases import Case, Level
from stiction.virtual.trial import World, walk

WIDTH, HEIGHT = 320, 240
"""Size of a frame [pixels]."""

FRAME_EVERY = 2
"""Control steps per frame: 25 frames a second at 50 Hz."""

SETTLE = 1.0
"""What is not shown at the start [s]."""

TIMEOUT = 120.0
"""Longest that a clip may take [s]."""

ENGINE, CELL = "physx", "all"
"""Engine in which a virtual robot walks, one that no policy was trained in, and what of the robot is real."""

CAMERA = {"azimuth": 125.0, "elevation": -30.0, "distance": 1.8}
"""Position of the camera about the robot [degrees, m]."""


class ClipError(EngineError):
    """A clip could not be rendered, mostly for want of OpenGL."""


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

    Args:
        bundle: directory of the bundle.
        level: dry friction as a fraction of the torque limit, or the law's coefficient [-].
        command: as for `parse_command`.
        out: the WebP file to write.
        seconds: length of the clip [s].
        law: law of the dry friction; `stribeck` with its default numbers. A virtual robot has its own.
        robot: seed of a virtual robot that walks in PhysX, which is installed, and is shown in MuJoCo's renderer; None:
            the robot of the data sheet in the simulator of the training.

    Raises:
        ClipError: no OpenGL, or the renderer failed.

    """
    # Words are told by their places: only the last one may be left out.
    words = [word for word in (bundle, level, command, out, seconds, law, robot) if word is not None]
    return render("stiction.evaluation.clip", words, out, TIMEOUT, ClipError, "clip")


@contextmanager
def plain_renderer(model: Any, width: int, height: int) -> Iterator[Any]:
    """Make a renderer without shadows and reflections: where the processor draws, they take most of the time.

    model: compiled by MuJoCo; width, height: of a frame [pixels].
    """
    import mujoco

    with mujoco.Renderer(model, height, width) as renderer:
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            renderer.scene.flags[flag] = 0
        yield renderer


def save_clip(frames: Sequence[Any], period: float, out: Path) -> None:
    """Write images, a frame every `period` [s], as an endless WebP, whatever the suffix of `out`."""
    settings = {"append_images": frames[1:], "duration": round(1000 * period), "loop": 0, "quality": 60, "method": 2}
    frames[0].save(out, format="WEBP", save_all=True, **settings)


def film(fleet: Fleet, advance: Callable[[], object], out: Path, seconds: float) -> None:
    """Write a clip of the first robot of a fleet on its ground to `out`, as WebP whatever its suffix.

    `advance` takes the fleet one control period further; the clip begins after `SETTLE` and lasts `seconds`. Needs
    OpenGL; to be called in a process of its own.
    """
    import mujoco
    from PIL import Image

    model, _ = fleet.data(0)
    camera = mujoco.MjvCamera()
    camera.type, camera.trackbodyid = mujoco.mjtCamera.mjCAMERA_TRACKING, model.body("base").id
    for name, value in CAMERA.items():
        setattr(camera, name, value)
    frames = []
    period = fleet.control_period
    with plain_renderer(model, WIDTH, HEIGHT) as renderer:
        for step in range(round((SETTLE + seconds) / period)):
            advance()
            if step * period >= SETTLE and step % FRAME_EVERY == 0:
                renderer.update_scene(fleet.data(0)[1], camera)
                frames.append(Image.fromarray(renderer.render()))
    save_clip(frames, FRAME_EVERY * period, out)


def walked(bundle: Bundle, robot: int, level: float, command: Command, steps: int) -> list[Motion]:
    """Let a bundle walk on a virtual robot; return its motion at the start of every control period until it falls.

    robot: its seed; level: mean over its joints of f/τ_max [-]. Raises `StictionError` where the bundle does not fit
    the robot, or the engine is not installed.
    """
    velocity = np.array(command.velocity)
    motions: list[Motion] = []

    def steer(step: int, motion: Motion) -> np.ndarray:
        motions.append(motion)
        return velocity

    walk(bundle, Case(robot, CELL, Level(level)), World(partial(make_engine, ENGINE)), steer, steps)
    return motions


def replay(fleet: Fleet, motions: Sequence[Motion]) -> Callable[[], None]:
    """Return a function that puts the first robot of a fleet into the next of the motions; it stays in the last."""
    left = iter(motions)

    def advance() -> None:
        motion = next(left, None)
        if motion is not None:
            fleet.base_position[0] = motion.base_position
            fleet.base_quaternion[0] = motion.base_quaternion
            fleet.joint_position[0] = motion.joint_position

    return advance


def in_training_simulator(
    bundle: Bundle, level: float, command: Command, law: Law = COULOMB
) -> tuple[Fleet, Callable[[], object]]:
    """Return one robot of a bundle in the simulator of its training, and what takes it a control period further.

    level: dry friction as a fraction of the torque limit, or the law's coefficient [-].
    """
    contract = bundle.contract
    policy, noise = load_policy(contract, bundle.policy, (1,)), seed_streams(0, ["clip"])["clip"]
    friction = friction_at(contract, np.array([level]), law)
    rollout = Rollout(contract, policy, robot_of(contract), friction, [noise], law=law)
    return rollout.fleet, partial(rollout.step, np.array([command.velocity]))


def _render(path: str, level: str, command: str, out: str, seconds: str, law: str, robot: str = "") -> None:
    """Render in this process; arguments as of `record_clip`."""
    bundle, commanded = check_for_simulation(path), parse_command(command)
    advance: Callable[[], object]
    if robot:
        contract = bundle.contract
        fleet = Fleet(robot_of(contract), 1, contract.physics_timestep, contract.decimation)
        steps = round((SETTLE + float(seconds)) / fleet.control_period)
        advance = replay(fleet, walked(bundle, int(robot), float(level), commanded, steps))
    else:
        fleet, advance = in_training_simulator(bundle, float(level), commanded, Law(law))
    film(fleet, advance, Path(out), float(seconds))


# At the end of the module: as a program it runs from top to bottom.
if __name__ == "__main__":
    follow_parent()
    _render(*sys.argv[1:])
