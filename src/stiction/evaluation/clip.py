"""The renderer of clips, and its clips of bundles that walk side by side, as animated WebP.

Rendering happens in a process of its own, see `core.opengl`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stiction.core.errors import ConfigurationError, EngineError
from stiction.core.lifeline import follow_parent
from stiction.core.opengl import render
from stiction.core.provenance import seed_streams
from stiction.deploy.check import check_for_simulation
from stiction.files.contract import robot_of
from stiction.files.velocity import Command, parse_command

if TYPE_CHECKING:
    from stiction.files.bundle import Bundle
    from stiction.robots.model import Robot

WIDTH, HEIGHT = 320, 240
"""Size of a frame [pixels]."""

FRAME_EVERY = 2

SETTLE = 1.0
"""Time at the start that is not shown [s]."""

TIMEOUT = 120.0
"""Maximum time to make a clip [s]."""

CAMERA = {"azimuth": 125.0, "elevation": -30.0, "distance": 1.8}
"""Position of the camera about the robot [degrees, m]."""


class ClipError(EngineError):
    """A clip could not be rendered, mostly for want of OpenGL."""


def record_side_by_side(
    bundles: Sequence[Path], names: Sequence[str], colors: Sequence[str], level: float, command: str, out: Path
) -> Path:
    """Render policies of one robot that start together: one camera that stands still, metre marks; return the path.

    names, colors: of each in the legend, `#rrggbb`; level: fraction of the torque limit [-]; command: forward alone.
    Above the scene stand friction, command and the speed that each reached in this walk. Raises `ClipError`.
    """
    robots = (word for each in zip(bundles, names, colors, strict=True) for word in each)
    words = [out, level, command, *robots]
    return render("stiction.evaluation.clip", words, out, TIMEOUT_TOGETHER, ClipError, "clip")


# The renderer.


@dataclass(frozen=True)
class Lane:
    """One of the robots that are shown side by side."""

    name: str
    color: str
    place: float
    """Along y [m]."""
    speed: float = 0.0
    """`mean_speed` of its walk [m/s]."""


def write_clip(
    model: Any,
    moments: Iterable[Sequence[Any]],
    camera: Any,
    period: float,
    out: Path,
    size: tuple[int, int] = (WIDTH, HEIGHT),
    lanes: Sequence[Lane] = (),
    metres: range = range(0),
    title: str = "",
) -> None:
    """Write a frame of each moment as an endless WebP, whatever the suffix of `out`; needs OpenGL.

    moments: the data of every robot with positions computed, the first with the ground; period: between them [s]; size:
    of the scene [pixels]; lanes: where robots are told apart; metres: along x, marked on the ground; title: above the
    names of the lanes.
    """
    import mujoco
    from PIL import Image

    frames = []
    with mujoco.Renderer(model, size[1], size[0], font_scale=mujoco.mjtFontScale.mjFONTSCALE_300) as renderer:
        # Without shadows and reflections: where the processor draws, they take most of the time.
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            renderer.scene.flags[flag] = 0
        for datas in moments:
            _fill(renderer, model, datas, camera, [lane.color for lane in lanes])
            _mark(renderer.scene, metres, [lane.place for lane in lanes])
            frames.append(_captioned(Image.fromarray(renderer.render()), lanes, title))
    settings = {"append_images": frames[1:], "duration": round(1000 * period), "loop": 0, "quality": 55, "method": 4}
    frames[0].save(out, format="WEBP", save_all=True, **settings)


def following(model: Any) -> Any:
    """Return a camera that follows the robot of a model."""
    import mujoco

    camera = mujoco.MjvCamera()
    camera.type, camera.trackbodyid = mujoco.mjtCamera.mjCAMERA_TRACKING, model.body("base").id
    for name, value in CAMERA.items():
        setattr(camera, name, value)
    return camera


def posed(model: Any, walks: Sequence[np.ndarray], lanes: Sequence[Lane] = ()) -> Iterator[list[Any]]:
    """Yield the data of robots at every moment of their walks, each an array of shape (moments, 7 + joints)."""
    import mujoco

    datas = [mujoco.MjData(model) for _ in walks]
    for moment in zip(*walks, strict=True):
        for number, (data, state) in enumerate(zip(datas, moment, strict=True)):
            data.qpos[: len(state)] = state
            data.qpos[1] += lanes[number].place if lanes else 0.0
            mujoco.mj_forward(model, data)
        yield datas


def _fill(renderer: Any, model: Any, datas: Sequence[Any], camera: Any, colors: Sequence[str]) -> None:
    """Put all robots into the scene, each in its colour: the first with the ground, the others beside it."""
    import mujoco

    scene, moving = renderer.scene, int(mujoco.mjtCatBit.mjCAT_DYNAMIC)
    renderer.update_scene(datas[0], camera)
    begins = [0, scene.ngeom]
    for data in datas[1:]:
        mujoco.mjv_addGeoms(model, data, mujoco.MjvOption(), mujoco.MjvPerturb(), moving, scene)
        begins.append(scene.ngeom)
    for (first, last), color in zip(pairwise(begins), colors, strict=False):
        rgb = [int(color[at : at + 2], 16) / 255 for at in (1, 3, 5)]
        for geom in scene.geoms[first:last]:
            if geom.category == moving:
                geom.rgba[:3] = 0.75 * np.array(rgb) + 0.25 * geom.rgba[:3]


def _mark(scene: Any, metres: range, lanes: Sequence[float]) -> None:
    """Draw a line across the ground at every metre, the start line thick, each with its number."""
    import mujoco

    for metre in metres:
        for label in (False, True):
            geom = scene.geoms[scene.ngeom]
            scene.ngeom += 1
            size = np.array([0.006 if metre else 0.02, 0.5 * (max(lanes) - min(lanes)) + 0.7 * LANE, 0.001])
            place = np.array([float(metre), 0.0, 0.001])
            if label:
                size, place = np.full(3, 1e-4), np.array([float(metre), min(lanes) - 0.75 * LANE, 0.02])
            mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_BOX, size, place, np.eye(3).ravel(), GREY)
            geom.label = (f"{metre} m" if metre else "start") if label else ""


def _captioned(scene: Any, lanes: Sequence[Lane], title: str) -> Any:
    """Return a frame with a title, and the robots' names and speeds, farthest lane on top, above the scene."""
    from PIL import Image, ImageDraw, ImageFont

    if not lanes:
        return scene
    words = [title, *(lane.name for lane in lanes)]
    size: float = CAPTION
    while max(ImageFont.load_default(size).getlength(word) for word in words) > 0.72 * scene.width:
        size *= 0.9
    font, line = ImageFont.load_default(size), round(1.3 * CAPTION)
    above = line * len(words) + CAPTION // 2
    frame = Image.new("RGB", (scene.width, scene.height + above), "white")
    frame.paste(scene, (0, above))
    pen = ImageDraw.Draw(frame)
    pen.text((CAPTION // 2, CAPTION // 4), title, fill=BLACK, font=font)
    for number, lane in enumerate(lanes[::-1], 1):
        top = CAPTION // 4 + line * number
        pen.rectangle((CAPTION // 2, top + 4, CAPTION // 2 + CAPTION, top + 4 + CAPTION), lane.color)
        pen.text((2 * CAPTION, top), lane.name, fill=BLACK, font=font)
        pen.text((scene.width - CAPTION // 2, top), f"{lane.speed:.2f} m/s", fill=BLACK, font=font, anchor="ra")
    return frame


# A bundle.


def walked(bundle: Bundle, level: float, command: Command, seconds: float, law: str = "coulomb") -> np.ndarray:
    """Return the state of a walk in MuJoCo at start and end of every control period, (moments, 7 + joints).

    level: fraction of the torque limit, or the law's coefficient [-]; seconds: length [s].
    """
    from stiction.deploy.policy import load_policy
    from stiction.evaluation.rollout import Rollout, friction_at
    from stiction.joints.friction import Law
    from stiction.virtual.drive import drive

    contract, noise = bundle.contract, seed_streams(0, ["clip"])["clip"]
    friction = friction_at(contract, np.array([level]), Law(law))
    policy = load_policy(contract, bundle.policy, (1,))
    rollout = Rollout(contract, policy, robot_of(contract), friction, [noise], law=Law(law))
    states = [rollout.fleet.qpos[0].copy()]
    for _ in drive(rollout, np.array([command.velocity]), round(seconds / contract.control_period)):
        states.append(rollout.fleet.qpos[0].copy())
    return np.array(states)


def mean_speed(states: np.ndarray, period: float) -> float:
    """Return the speed along x of a walk after its first `SETTLE` [m/s]; states: `walked`; period: between them [s]."""
    first = round(SETTLE / period)
    return float(states[-1, 0] - states[first, 0]) / (period * (len(states) - 1 - first))


def compiled(robot: Robot, size: tuple[int, int] = (WIDTH, HEIGHT)) -> Any:
    """Return MuJoCo's model of a robot on flat ground, for frames of a width and height [pixels]."""
    from stiction.robots.mjcf import build

    spec = build(robot)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = size
    return spec.compile()


# Policies side by side.

SIZE, CAPTION = (960, 340), 34
"""Size of the scene, and of the text above it [pixels]: 12 px where a telephone shows it 366 px wide."""

BLACK = "#1f2328"
"""Colour of that text."""

FRAMES = 10.0

TOGETHER = 8.0
"""Length of the clip [s], from the start."""

TIMEOUT_TOGETHER = 300.0
"""Maximum time to make a clip of all policies [s]."""

LANE = 1.3
"""Distance of two robots from each other, over their width at least [m]."""

GREY = np.array([0.25, 0.27, 0.3, 1.0])


def metres_of(walks: Sequence[np.ndarray]) -> range:
    """Return the whole metres between which everything happens along x, half a metre beside the outermost robot."""
    ends = [states[:, 0] for states in walks]
    low, high = min(map(np.min, ends)), max(map(np.max, ends))
    return range(int(np.floor(low - 0.5)), int(np.ceil(high + 0.5)) + 1)


def _render_together(out: str, level: str, command: str, *robots: str) -> None:
    """Render in this process; words as `record_side_by_side` writes them."""
    import mujoco

    from stiction.joints.friction import level_text

    bundles = [check_for_simulation(path) for path in robots[::3]]
    if len({robot_of(bundle.contract) for bundle in bundles}) > 1:
        raise ConfigurationError("policies of different robots are not shown in one scene")
    walks, speeds, asked = [], [], parse_command(command)
    for bundle in bundles:
        states, period = walked(bundle, float(level), asked, TOGETHER), bundle.contract.control_period
        states[:, :2] -= states[0, :2].copy()
        speeds.append(mean_speed(states, period))
        walks.append(states[: -1 : max(1, round(1 / (FRAMES * period)))])
    middle = (len(walks) - 1) / 2
    lanes = [
        Lane(name, color, LANE * (number - middle), speed)
        for number, (name, color, speed) in enumerate(zip(robots[1::3], robots[2::3], speeds, strict=True))
    ]
    metres, model, camera = metres_of(walks), compiled(robot_of(bundles[0].contract), SIZE), mujoco.MjvCamera()
    low, high = metres[0], metres[-1]
    camera.lookat, camera.azimuth, camera.elevation = [(low + high) / 2, 0.0, 0.1], 90.0, -27.0
    camera.distance = max(0.47 * (high - low), 1.18 * LANE * len(walks)) + 0.4 * LANE * (len(walks) - 1)
    title = f"{level_text('coulomb', float(level))} joint friction, commanded {asked.velocity[0]:g} m/s"
    write_clip(model, posed(model, walks, lanes), camera, 1 / FRAMES, Path(out), SIZE, lanes, metres, title)


# At the end of the module: as a program it runs from top to bottom.
if __name__ == "__main__":
    follow_parent()
    _render_together(*sys.argv[1:])
