"""Clips of the last seconds of a viewer, as animated WebP, drawn by the renderer of all clips in its own process."""

from __future__ import annotations

import json
import sys
import tempfile
from collections import deque
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from stiction.core.lifeline import follow_parent
from stiction.core.opengl import render
from stiction.engines.ground import Ground
from stiction.evaluation.clip import (
    FRAMES,
    SIZE,
    TIMEOUT_TOGETHER,
    ClipError,
    Lane,
    metres_of,
    posed,
    write_clip,
)
from stiction.robots.mjcf import STONES, build
from stiction.robots.model import Robot
from stiction.view.scene import colors, lanes, state_of
from stiction.view.simulation import Simulation

LONGEST_CLIP = 15.0
"""Largest length of a clip [s]."""


@dataclass(frozen=True)
class Shot:
    """Walks to draw: everything a clip shows."""

    states: np.ndarray
    """Position [m], quaternion and joint angles [rad] of each robot at each frame, shape (frames, N, 7 + J)."""
    names: tuple[str, ...]
    """Names of the policies."""
    places: np.ndarray
    """Position of each robot's lane along y [m], shape (N,)."""
    ground: Ground
    """Ground of every robot."""
    seconds: float
    """Length [s]."""


class ClipBuffer:
    """The last seconds of a simulation, at the rate of a clip's frames."""

    def __init__(self, simulation: Simulation) -> None:
        """Start empty."""
        self._simulation = simulation
        self._every = max(1, round(1.0 / (FRAMES * simulation.period)))
        self._count = 0
        self._states: deque[np.ndarray] = deque(maxlen=round(LONGEST_CLIP / (self._every * simulation.period)))

    def add(self) -> None:
        """Add the last control step, if it is a frame."""
        if self._count % self._every == 0:
            self._states.append(np.stack([state_of(walker) for walker in self._simulation.walkers]))
        self._count += 1

    def clear(self) -> None:
        """Forget all frames, as before a jump to the start."""
        self._states.clear()
        self._count = 0

    def shot(self, seconds: float, width: float) -> Shot:
        """Return the last seconds; width: of a robot [m]. Raises `ClipError`: nothing was walked yet."""
        period = self._every * self._simulation.period
        states = list(self._states)[-max(2, round(seconds / period)) :]
        if len(states) < 2:
            raise ClipError("clip: got no walk yet, expected some; let the robots walk, then try again")
        names = tuple(walker.policy.short for walker in self._simulation.walkers)
        places, ground = lanes(self._simulation, width), self._simulation.ground
        return Shot(np.array(states), names, places, ground, len(states) * period)


def render_shot(shot: Shot, spec: Robot) -> bytes:
    """Return a clip of robots of one data sheet as WebP. Raises `ClipError`: no OpenGL, or it takes too long."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        mujoco.mj_saveModel(stage(spec, shot), str(path / "model.mjb"), None)
        np.savez(path / "walks.npz", states=shot.states, places=shot.places)
        (path / "names.json").write_text(json.dumps(shot.names))
        return render(
            "stiction.view.clip", [path], path / "clip.webp", TIMEOUT_TOGETHER, ClipError, "clip"
        ).read_bytes()


def stage(spec: Robot, shot: Shot) -> mujoco.MjModel:
    """Return the model of a robot with the course of every lane, moved so that all walks start at x = 0."""
    built, ground = build(spec), shot.ground
    built.visual.global_.offwidth, built.visual.global_.offheight = SIZE
    for place, start in zip(shot.places, shot.states[0, :, :2], strict=True):
        shift = np.array([0.0, place, 0.0]) - [*start, 0.0]
        for half, position, turn in zip(ground.half_sizes, ground.positions, ground.quaternions, strict=True):
            built.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX, size=half, pos=position + shift, quat=turn, rgba=[*STONES[0], 1.0]
            )
    return built.compile()


def camera_over(walks: list[np.ndarray], places: np.ndarray) -> mujoco.MjvCamera:
    """Return a camera at rest that sees all walks; places: of their lanes along y [m]."""
    metres, camera = metres_of(walks), mujoco.MjvCamera()
    low, high = metres[0], metres[-1]
    camera.lookat, camera.azimuth, camera.elevation = [(low + high) / 2, 0.0, 0.1], 90.0, -28.0
    camera.distance = max(0.62 * (high - low), 1.2 * (np.ptp(places) + 1.3)) + 0.8
    return camera


def _draw(folder: Path) -> None:
    """Draw the clip whose parts are in a folder."""
    model = mujoco.MjModel.from_binary_path(str(folder / "model.mjb"))
    names = json.loads((folder / "names.json").read_text())
    with np.load(folder / "walks.npz", allow_pickle=False) as parts:
        states, places = parts["states"], parts["places"]
    walks = [states[:, number].copy() for number in range(len(places))]
    for walk in walks:
        walk[:, :2] -= walk[0, :2].copy()
    rows = [
        Lane(name, "#{:02x}{:02x}{:02x}".format(*color), float(place))
        for name, color, place in zip(names, colors(len(names)), places, strict=True)
    ]
    camera, moments = camera_over(walks, places), posed(model, walks, rows)
    write_clip(model, moments, camera, 1 / FRAMES, folder / "clip.webp", SIZE, rows, metres_of(walks))


# At the end of the module: as a program it runs from top to bottom.
if __name__ == "__main__":
    follow_parent()
    _draw(Path(sys.argv[1]))
