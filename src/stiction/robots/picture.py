"""Picture of a standing robot, with an arrow along the axis of every driven joint, by the right-hand rule.

Rendering happens in a separate process, see `core.opengl`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from stiction.core.errors import EngineError
from stiction.core.files import publish
from stiction.core.lifeline import follow_parent
from stiction.core.opengl import render
from stiction.core.scratch import scratch
from stiction.robots.model import Robot, link_poses
from stiction.robots.record import read_robot, write_robot

WIDTH, HEIGHT, LEGEND = 960, 720, 330
"""Size of the picture, and width of its legend [pixels]."""

TIMEOUT = 120.0
"""Timeout of drawing [s]."""

COLORS = ((0.85, 0.25, 0.2), (0.2, 0.6, 0.3), (0.2, 0.4, 0.85), (0.8, 0.6, 0.1), (0.55, 0.3, 0.7), (0.1, 0.6, 0.65))
"""Colors of arrows, by kind of joint."""


class PictureError(EngineError):
    """Failure to draw a picture, mostly for lack of OpenGL."""


def draw(robot: Robot, out: Path) -> Path:
    """Draw a robot into a PNG file and return its path.

    Raises `PictureError`, with the renderer's message, without OpenGL or where the renderer failed.
    """
    with scratch() as folder:
        record = folder / "robot.json"
        write_robot(robot, record)
        return render("stiction.robots.picture", (record, out), out, TIMEOUT, PictureError, "picture")


def _render(robot: Robot, out: Path) -> None:
    """Draw a robot; needs OpenGL, in a separate process."""
    import mujoco
    from PIL import Image, ImageDraw, ImageFont

    from stiction.robots.mjcf import build

    spec = build(robot)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = WIDTH, HEIGHT
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    size = float(np.linalg.norm(np.ptp(data.xpos[1:], axis=0))) + 0.5 * robot.standing_height
    camera.lookat, camera.distance = [0.0, 0.0, 0.5 * float(data.xpos[1:, 2].max())], 1.35 * size
    camera.azimuth, camera.elevation = 125.0, -20.0
    options = mujoco.MjvOption()
    options.flags[mujoco.mjtVisFlag.mjVIS_TRANSPARENT] = True
    with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        renderer.update_scene(data, camera, options)
        position, rotation = link_poses(robot, robot.joint_values("default_position"))
        middle = np.array([0.0, 0.0, robot.standing_height])
        for number, (joint, link) in enumerate(zip(robot.joints, robot.links, strict=True)):
            color = COLORS[robot.joint_kinds.index(joint.kind) % len(COLORS)]
            start = middle + position[number]
            end = start + 0.16 * size * rotation[number] @ np.array(link.axis)
            # Beyond the model's own: the scene has room for what is only drawn.
            geom = renderer.scene.geoms[renderer.scene.ngeom]
            renderer.scene.ngeom += 1
            arrow = mujoco.mjtGeom.mjGEOM_ARROW
            mujoco.mjv_initGeom(geom, arrow, np.zeros(3), np.zeros(3), np.eye(3).ravel(), np.array([*color, 1.0]))
            mujoco.mjv_connector(geom, arrow, 0.01 * size, start, end)
            tip = renderer.scene.geoms[renderer.scene.ngeom]
            renderer.scene.ngeom += 1
            small, seen = np.full(3, 0.002 * size), np.array([*color, 1.0])
            mujoco.mjv_initGeom(
                tip, mujoco.mjtGeom.mjGEOM_SPHERE, small, 0.4 * start + 0.6 * end, np.eye(3).ravel(), seen
            )
            tip.label = str(number + 1)
        drawn = Image.fromarray(renderer.render())
    page = Image.new("RGB", (WIDTH + LEGEND, HEIGHT), "white")
    page.paste(drawn, (0, 0))
    pen, line = ImageDraw.Draw(page), min(28.0, (HEIGHT - 40) / robot.num_joints)
    font = ImageFont.load_default(size=min(15.0, 0.8 * line))
    pen.text((WIDTH + 12, 8), f"{robot.name}: joints, right-hand rule", fill="black", font=font)
    for number, joint in enumerate(robot.joints):
        color = COLORS[robot.joint_kinds.index(joint.kind) % len(COLORS)]
        fill = tuple(round(200 * share) for share in color)
        words = f"{number + 1}  {joint.name}   {joint.default_position:+.2f} rad"
        pen.text((WIDTH + 12, 34 + line * number), words, fill=fill, font=font)
    with publish(out) as partial:
        page.save(partial, format="PNG")


if __name__ == "__main__":
    follow_parent()
    _render(read_robot(Path(sys.argv[1])), Path(sys.argv[2]))
