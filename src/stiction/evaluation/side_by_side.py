"""Renders policies side by side in one scene: one start line, one command, one camera that stands still, metre marks.

Rendering happens in a process of its own, see `core.opengl`.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.core.lifeline import follow_parent
from stiction.core.opengl import render
from stiction.deploy.check import check_for_simulation, robot_of
from stiction.evaluation.clip import ClipError, in_training_simulator, plain_renderer, save_clip
from stiction.files.bundle import Bundle
from stiction.files.velocity import Command, parse_command

WIDTH, HEIGHT, CAPTION = 960, 400, 22
"""Size of a frame, and of a line of its legend [pixels]."""

FRAMES = 12.5
"""Frames a second, in real time."""

TIMEOUT = 300.0
"""Longest that a clip may take [s]."""

LANE = 1.3
"""Distance of two robots from each other, over their width at least [m]."""

GREY = np.array([0.25, 0.27, 0.3, 1.0])
"""Of the marks on the ground."""


def record_side_by_side(
    bundles: Sequence[Path], names: Sequence[str], colors: Sequence[str], level: float, command: str, out: Path
) -> Path:
    """Render policies of one robot that start together; return the clip's path.

    Args:
        bundles: directories of the bundles, at least one.
        names: what each is called in the legend.
        colors: of each, `#rrggbb`, of its body and its name.
        level: dry friction as a fraction of the torque limit [-].
        command: as for `parse_command`; the camera looks across the way that it leads forward or backward.
        out: the WebP file to write.

    Raises:
        ClipError: no OpenGL, or the renderer failed.

    """
    words = [out, level, command, *(word for each in zip(bundles, names, colors, strict=True) for word in each)]
    return render("stiction.evaluation.side_by_side", words, out, TIMEOUT, ClipError, "clip")


SECONDS = 7.0
"""Length of the clip [s], from the start."""


def walk(bundle: Bundle, level: float, command: Command, seconds: float) -> np.ndarray:
    """Return what one policy's robot does, at every frame: free joint and joints, shape (frames, 7 + joints)."""
    fleet, advance = in_training_simulator(bundle, level, command)
    period = fleet.control_period
    start = fleet.qpos[0].copy()
    frames = []
    for step in range(round(seconds / period)):
        if step % max(1, round(1 / (FRAMES * period))) == 0:
            frames.append(fleet.qpos[0].copy())
        advance()
    walked = np.array(frames)
    walked[:, :2] -= start[:2]
    return walked


def reached_from(walks: Sequence[np.ndarray]) -> tuple[int, int]:
    """Return the whole metres between which everything happens along x, half a metre beside the outermost robot."""
    ends = [walked[:, 0] for walked in walks]
    low, high = min(map(np.min, ends)), max(map(np.max, ends))
    return int(np.floor(low - 0.5)), int(np.ceil(high + 0.5))


def _render(words: Sequence[str]) -> None:
    """Render in this process; words as `record_side_by_side` writes them."""
    import mujoco
    from PIL import Image

    from stiction.robots.mjcf import build

    out, level, command = Path(words[0]), float(words[1]), parse_command(words[2])
    checked, names, colors = [check_for_simulation(path) for path in words[3::3]], words[4::3], words[5::3]
    if len({robot_of(bundle.contract) for bundle in checked}) > 1:
        raise ConfigurationError("policies of different robots are not shown in one scene")
    walks = [walk(bundle, level, command, SECONDS) for bundle in checked]
    spec = build(robot_of(checked[0].contract))
    spec.visual.global_.offwidth, spec.visual.global_.offheight = WIDTH, HEIGHT
    model = spec.compile()
    low, high = reached_from(walks)
    lanes = [LANE * (number - (len(walks) - 1) / 2) for number in range(len(walks))]
    camera = mujoco.MjvCamera()
    camera.lookat, camera.azimuth, camera.elevation = [(low + high) / 2, 0.0, 0.1], 90.0, -28.0
    camera.distance = max(0.62 * (high - low), 1.9 * LANE * len(walks) * 0.62) + 0.8
    shown, datas = [], [mujoco.MjData(model) for _ in walks]
    with plain_renderer(model, WIDTH, HEIGHT) as renderer:
        for moment in zip(*walks, strict=True):
            for data, lane, state in zip(datas, lanes, moment, strict=True):
                data.qpos[: len(state)] = state
                data.qpos[1] += lane
                mujoco.mj_forward(model, data)
            _fill(renderer, model, datas, camera, colors)
            _mark(renderer.scene, low, high, lanes)
            shown.append(_captioned(Image.fromarray(renderer.render()), names, colors))
    save_clip(shown, 1 / FRAMES, out)


def _fill(renderer: Any, model: Any, datas: Sequence[Any], camera: Any, colors: Sequence[str]) -> None:
    """Put all robots into the scene, each in its colour: the first with the ground, the others beside it."""
    import mujoco

    scene = renderer.scene
    renderer.update_scene(datas[0], camera)
    begins = [0, scene.ngeom]
    for data in datas[1:]:
        mujoco.mjv_addGeoms(
            model, data, mujoco.MjvOption(), mujoco.MjvPerturb(), int(mujoco.mjtCatBit.mjCAT_DYNAMIC), scene
        )
        begins.append(scene.ngeom)
    for (first, last), color in zip(pairwise(begins), colors, strict=True):
        rgb = [int(color[at : at + 2], 16) / 255 for at in (1, 3, 5)]
        for index in range(first, last):
            geom = scene.geoms[index]
            if geom.category == int(mujoco.mjtCatBit.mjCAT_DYNAMIC):
                geom.rgba[:3] = 0.75 * np.array(rgb) + 0.25 * geom.rgba[:3]


def _mark(scene: Any, low: int, high: int, lanes: Sequence[float]) -> None:
    """Draw a line across the ground at every metre, the start line thick, each with its number."""
    import mujoco

    nearest = min(lanes) - 0.75 * LANE
    for metre in range(low, high + 1):
        for label in (False, True):
            geom = scene.geoms[scene.ngeom]
            scene.ngeom += 1
            size = np.array([0.006 if metre else 0.02, 0.5 * (max(lanes) - min(lanes)) + 0.7 * LANE, 0.001])
            place, color = np.array([float(metre), 0.0, 0.001]), GREY
            if label:
                size, place = np.full(3, 1e-4), np.array([float(metre), nearest, 0.02])
            mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_BOX, size, place, np.eye(3).ravel(), color)
            geom.label = (f"{metre} m" if metre else "start") if label else ""


def _captioned(frame: Any, names: Sequence[str], colors: Sequence[str]) -> Any:
    """Return a frame with the policies' names in it, farthest lane on top as in the picture."""
    from PIL import ImageDraw, ImageFont

    pen, font = ImageDraw.Draw(frame), ImageFont.load_default(size=15.0)
    lines = list(zip(names, colors, strict=True))[::-1]
    widest = max(pen.textlength(name, font=font) for name in names)
    pen.rectangle((0, 0, 14 + widest, 8 + CAPTION * len(lines)), "white")
    for number, (name, color) in enumerate(lines):
        pen.text((7, 5 + CAPTION * number), name, fill=color, font=font)
    return frame


# At the end of the module: as a program it runs from top to bottom.
if __name__ == "__main__":
    follow_parent()
    _render(sys.argv[1:])
