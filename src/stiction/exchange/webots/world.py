"""Worlds for the exported robot: flat ground, and the stairs of the training's courses. Not run in Webots.

Sources: docs/reference of https://github.com/cyberbotics/webots (worldinfo.md, contactproperties.md, solid.md).

* `basicTimeStep` [ms] is the physics step of the policy's training; the controller refuses any other.
* Contacts: `bounce` is 0 (Webots' default is 0.5), the Coulomb coefficient 1, as between foot and ground in training;
  `softCFM` and `softERP` are Webots' own.
* Bodies at rest are not put to sleep: both thresholds are zero. A robot held still by dry friction is not idle.
* A PROTO is declared before it is used: `EXTERNPROTO "../protos/NAME.proto"`, since R2022b.
* The floor is a box, not a `Plane`: a box looks the same in every convention of axes.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stiction.exchange.webots.controller import PLUGIN
from stiction.exchange.webots.proto import (
    HEADER,
    Node,
    Value,
    comment,
    friction_fields,
    proto_name,
    text,
    vector,
    write,
)
from stiction.robots.mjcf import STONES
from stiction.robots.model import Robot
from stiction.robots.terrain import KINDS, REACH, SLABS, STEEPEST, Terrain
from stiction.task.terrain import START

ROBOT = "ROBOT"
"""Name by which the physics plugin looks up the robot."""

GROUND_FRICTION = 1.0
"""Coulomb coefficient between any two surfaces [-]."""

FLOOR = (60.0, 60.0, 1.0)
"""Extent of the floor [m]; its top is at 0."""


def joint_friction(robot: Robot, level: float) -> dict[str, float]:
    """Return the robot's fields for dry friction [N m] at a level, a fraction of the joints' torque limit [-]."""
    return {name: level * robot.joints[first].torque_limit for name, (first, *_) in friction_fields(robot).items()}


def stairs(step_height: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the boxes of the stairs that training uses: full sizes and middles [m], both of shape (boxes, 3).

    step_height: [m], at most what training has.
    """
    terrain = Terrain(np.array([KINDS.index("stairs")]))
    terrain.place(np.array([0]), np.array([step_height / STEEPEST["stairs"]]), np.zeros((1, SLABS, 4)))
    return 2 * terrain.boxes, terrain.position[0]


def write_world(robot: Robot, timestep: float, friction: Mapping[str, float], step_height: float = 0.0) -> str:
    """Return the text of a world: the robot on flat ground, or before stairs.

    timestep: physics step [s]; friction: see `joint_friction`; step_height: [m], of stairs, 0 for none.
    """
    start = -(REACH + START) if step_height else 0.0
    about = comment(
        f"{robot.name} {f'before stairs of {step_height:g} m' if step_height else 'on flat ground'}; "
        f"friction of the joints [N m] is a field of the robot.\n"
        "Written by `stiction export --to webots`. NOT RUN in Webots."
    )
    nodes = [_info(robot, timestep), *_scenery(robot, start)]
    if step_height:
        nodes += [
            _box(f"step {k}", *each, STONES[k % 2]) for k, each in enumerate(zip(*stairs(step_height), strict=True))
        ]
    start_pose: dict[str, Value] = {"translation": (start, 0.0, robot.standing_height), "name": robot.name}
    nodes.append(Node(proto_name(robot.name), {**start_pose, **friction}, define=ROBOT))
    extern = f"EXTERNPROTO {text(f'../protos/{proto_name(robot.name)}.proto')}"
    return f"{HEADER}\n{about}\n{extern}\n\n" + "".join(f"{write(node)}\n" for node in nodes)


def _info(robot: Robot, timestep: float) -> Node:
    """Return the settings of the world."""
    silent: dict[str, Value] = {sound: "" for sound in ("bumpSound", "rollSound", "slideSound")}
    contact = Node("ContactProperties", {"coulombFriction": [GROUND_FRICTION], "bounce": 0, **silent})
    return Node(
        "WorldInfo",
        {
            "title": f"stiction: {robot.name}",
            "physics": PLUGIN,
            "basicTimeStep": milliseconds(timestep),
            "physicsDisableLinearThreshold": 0,
            "physicsDisableAngularThreshold": 0,
            "contactProperties": [contact],
        },
    )


def milliseconds(timestep: float) -> float:
    """Return a time [s] in milliseconds, without the noise of the conversion: 0.005 is 5."""
    return round(1000 * timestep, 9)


def _scenery(robot: Robot, start: float) -> list[Node]:
    """Return view, light and floor; the view looks along x, 0.3 rad down, and follows the robot."""
    return [
        Node(
            "Viewpoint",
            {"orientation": (0.0, 1.0, 0.0, 0.3), "position": (start - 3.0, 0.0, 1.2), "follow": robot.name},
        ),
        Node("Background", {"skyColor": [(0.75, 0.83, 0.9)]}),
        Node("DirectionalLight", {"direction": (0.3, 0.4, -1.0), "intensity": 2, "castShadows": True}),
        _box("floor", np.array(FLOOR), np.array([0.0, 0.0, -FLOOR[2] / 2]), (0.9, 0.9, 0.88)),
    ]


def _box(name: str, size: np.ndarray, middle: np.ndarray, colour: tuple[float, ...]) -> Node:
    """Return a box that nothing moves; sizes and place in metres."""
    box = Node("Box", {"size": vector(size)})
    paint = Node("PBRAppearance", {"baseColor": colour, "roughness": 1, "metalness": 0})
    return Node(
        "Solid",
        {
            "translation": vector(middle),
            "children": [Node("Shape", {"appearance": paint, "geometry": box})],
            "name": name,
            "boundingObject": box,
        },
    )
