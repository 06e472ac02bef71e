"""Webots PROTO of a `Robot`, its joints as in a policy's contract. Not run in Webots.

What stands where in Webots, and its source (docs/reference, and src/webots/nodes for what the documents leave out):

* The robot's x is forward, y left, z up, the world's z up (FLU and ENU, Webots' defaults since R2022a): as here.
* **Joint angles count from the standing pose.** `minStop` has to lie in [-π, 0] and `maxStop` in [0, π]
  (jointparameters.md), which the limits of a knee do not. So the links stand in the PROTO as in the standing pose, and
  the controller adds that pose to what the sensors say. ODE sees an angle modulo 2π, counted from the pose in which the
  joint was made: a stop beyond π would strike from the other side, and is moved to `FARTHEST`.
* `Physics`: density -1 means that the mass holds; `inertiaMatrix [ I11 I22 I33, I12 I13 I23 ]` is about the
  `centerOfMass` (physics.md). With mass, centre and matrix a body needs no `boundingObject` (WbPhysics.cpp,
  CUSTOM_INERTIA_MATRIX): what only is seen in MuJoCo only is seen here.
* Capsules and cylinders lie along z, as here; the height of a capsule counts without its caps (capsule.md). A convex
  hull is an `IndexedFaceSet` of triangles that look outward (indexedfaceset.md).
* `staticFriction` is a bound of dry friction as soon as a torque is set (WbRotationalMotor.cpp, turnOffMotor: a motor
  with target speed 0 and that bound); under position and velocity control it does nothing
  (https://github.com/cyberbotics/webots/issues/2483). `dampingConstant` is B, taken implicitly (WbHingeJoint.cpp).
* There is no rotor inertia: the physics plugin adds it (`export.py`).

A field holds one value or a list of values; which, is the node type's business. Here a tuple of numbers is one value
(a vector, a rotation, a colour), a list is a list of values. Numbers are written with the digits that read back
exactly. Source of the language: docs/reference/proto-definition.md and the node types in resources/nodes of
https://github.com/cyberbotics/webots, R2023b.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from stiction.engines.ode.contact import outward
from stiction.exchange.webots.controller import CHANNEL, GPS, GYRO, IMU, RECEIVER, SENSOR
from stiction.files.contract import Contract
from stiction.robots.mjcf import PLAIN
from stiction.robots.model import Body, Joint, Robot
from stiction.robots.shapes import Shape

HEADER = "#VRML_SIM R2023b utf8"
"""First line of a world and of a PROTO. R2023b: `Pose` nodes, and a launcher that gives a controller arguments."""

INDENT = "  "


@dataclass(frozen=True)
class Is:
    """Value of a field that the PROTO's interface gives: `staticFriction IS hipFriction`."""

    name: str
    """Field of the interface."""


@dataclass(frozen=True)
class Node:
    """Node of a file: `DEF FL_hip_link Solid { ... }`."""

    kind: str
    """Type, such as `Solid`."""
    fields: Mapping[str, Value] = field(default_factory=dict)
    """Field -> value, in the order in which they are written."""
    define: str = ""
    """Name by which a physics plugin looks it up, none by default."""


Value = bool | int | float | str | tuple[float, ...] | Is | Node | list["Value"]
"""Possible value of a field."""


def number(value: float) -> str:
    """Return a number with the digits that read back exactly, whole ones without a point."""
    exact = float(value) + 0.0  # -0.0 becomes 0.0
    return str(int(exact)) if exact.is_integer() and abs(exact) < 1e15 else repr(exact)


def vector(values: np.ndarray | Sequence[float]) -> tuple[float, ...]:
    """Return numbers as one value of a field."""
    return tuple(np.asarray(values, float).tolist())


def text(value: str) -> str:
    """Return a string within quotes; a quote in it is escaped, and a letter that cannot be printed is a blank."""
    printable = "".join(c if c.isprintable() else " " for c in value)
    return '"' + printable.replace("\\", "\\\\").replace('"', '\\"') + '"'


def write(value: Value, depth: int = 0) -> str:
    """Return the text of a value that starts in a line indented by `depth` and may go on in further lines."""
    if isinstance(value, bool):
        return "TRUE" if value else "FALSE"
    if isinstance(value, str):
        return text(value)
    if isinstance(value, int | float):
        return number(value)
    if isinstance(value, Is):
        return f"IS {value.name}"
    if isinstance(value, tuple):
        return " ".join(map(number, value))
    inner, end = "\n" + INDENT * (depth + 1), "\n" + INDENT * depth
    if isinstance(value, list):
        return "[" + "".join(inner + write(item, depth + 1) for item in value) + (end if value else " ") + "]"
    name = f"DEF {value.define} " if value.define else ""
    lines = [f"{inner}{key} {write(item, depth + 1)}" for key, item in value.fields.items()]
    return f"{name}{value.kind} {{" + "".join(lines) + end + "}"


def comment(lines: str) -> str:
    """Return text as comment lines."""
    return "".join(f"# {line}".rstrip() + "\n" for line in lines.splitlines())


EXTERN = "<extern>"
"""Controller that Webots waits for: a program that is started by hand."""

FARTHEST = 3.1
"""Largest distance of a stop from the standing pose [rad], less than π."""


def proto_name(robot: str) -> str:
    """Return a robot's name in the form of a PROTO's: `saturn_lite` is `SaturnLite`."""
    words = re.findall(r"[A-Za-z0-9]+", robot)
    return "Robot" * (not words or words[0][0].isdigit()) + "".join(word[0].upper() + word[1:] for word in words)


def solid_name(robot: Robot, number: int) -> str:
    """Return the name of a link's solid: the link's name, or one like it that the plugin can look up."""
    name = robot.links[number].name
    clean = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return name if clean == name and not name[:1].isdigit() else f"link{number}_{clean}"


def friction_fields(robot: Robot) -> dict[str, list[int]]:
    """Return the PROTO's fields for dry friction, `hipFriction`, each with the numbers of its joints.

    They are the joints of one kind; where the torque limits of a kind differ, each joint has a field of its own, for a
    level of friction is a fraction of that limit.
    """
    limits = robot.joint_values("torque_limit")
    fields: dict[str, list[int]] = {}
    for number, joint in enumerate(robot.joints):
        alike = np.ptp(limits[robot.joints_of(joint.kind)]) == 0
        kind = proto_name(joint.kind)
        name = kind[0].lower() + kind[1:] if alike else proto_name(joint.name)
        fields.setdefault(f"{name}Friction", []).append(number)
    return fields


def stops(joint: Joint) -> tuple[float, float]:
    """Return `minStop` and `maxStop` [rad]: the joint's limits, counted from its standing angle."""
    return (
        max(joint.lower - joint.default_position, -FARTHEST),
        min(joint.upper - joint.default_position, FARTHEST),
    )


def write_proto(robot: Robot, contract: Contract) -> str:
    """Return the text of the PROTO.

    robot: shape, masses, limits; contract: viscous friction of the joints, in the order of `robot.joint_names`.
    """
    interface: dict[str, tuple[str, str]] = {
        "translation": ("SFVec3f", write((0.0, 0.0, robot.standing_height))),
        "rotation": ("SFRotation", "0 0 1 0"),
        "name": ("SFString", text(robot.name)),
        "controller": ("SFString", text(EXTERN)),
        **{name: ("SFFloat", "0") for name in friction_fields(robot)},
    }
    fields = "".join(f"  field {kind:<10} {name:<14} {value}\n" for name, (kind, value) in interface.items())
    held = f", {len(robot.held)} more are held and rigid" if robot.held else ""
    about = comment(
        f"{robot.name}: {robot.mass:g} kg, {robot.num_joints} joints{held}. Angles count from the standing pose.\n"
        "Dry friction of the joints [N m] is a field for each kind of joint; it acts under torque control alone.\n"
        "Rotor inertia is in the physics plugin. Written by `stiction export --to webots`. NOT RUN in Webots."
    )
    body = write(_robot(robot, contract), 1)
    return f"{HEADER}\n{about}\nPROTO {proto_name(robot.name)} [\n{fields}]\n{{\n  {body}\n}}\n"


def _robot(robot: Robot, contract: Contract) -> Node:
    """Return the base with its links and sensors."""
    devices: list[Value] = [
        Node("InertialUnit", {"name": IMU}),
        Node("Gyro", {"name": GYRO}),
        Node("GPS", {"name": GPS}),
        Node("Receiver", {"name": RECEIVER, "channel": CHANNEL}),
    ]
    seen, touched = _shapes(robot.base.shapes)
    return Node(
        "Robot",
        {
            "translation": Is("translation"),
            "rotation": Is("rotation"),
            "children": [*seen, *devices, *_hung(robot, contract, -1)],
            "name": Is("name"),
            **touched,
            "physics": _physics(robot.base),
            "controller": Is("controller"),
        },
    )


def _hung(robot: Robot, contract: Contract, parent: int) -> list[Value]:
    """Return the hinges on a link, or on the base (-1), each with all that hangs on it."""
    return [_hinge(robot, contract, number) for number, link in enumerate(robot.links) if link.parent == parent]


def _hinge(robot: Robot, contract: Contract, number: int) -> Node:
    """Return a joint with motor, sensor and link; the motor has the joint's name, the sensor that and `SENSOR`."""
    joint, link, name = robot.joints[number], robot.links[number], solid_name(robot, number)
    low, high = stops(joint)
    friction = next(field for field, numbers in friction_fields(robot).items() if number in numbers)
    parameters: dict[str, Value] = {
        "axis": link.axis,
        "anchor": link.origin,
        "dampingConstant": contract.damping[number],
        "minStop": low,
        "maxStop": high,
        "staticFriction": Is(friction),
    }
    feet = [shape for foot in robot.feet if foot.link == number for shape in foot.shapes]
    seen, touched = _shapes([*feet, *link.shapes])
    solid: dict[str, Value] = {
        "translation": link.origin,
        "rotation": (*link.axis, joint.default_position),
        "children": [*seen, *_hung(robot, contract, number)],
        "name": name,
        **touched,
        "physics": _physics(link),
    }
    motor = Node("RotationalMotor", {"name": joint.name, "maxTorque": joint.torque_limit, "sound": ""})
    return Node(
        "HingeJoint",
        {
            "jointParameters": Node("HingeJointParameters", parameters),
            "device": [motor, Node("PositionSensor", {"name": joint.name + SENSOR})],
            "endPoint": Node("Solid", solid, define=name),
        },
    )


def _physics(body: Body) -> Node:
    """Return mass, centre of mass and inertia of a body."""
    return Node(
        "Physics",
        {
            "density": -1,
            "mass": body.mass,
            "centerOfMass": [body.com],
            "inertiaMatrix": [body.inertia[:3], body.inertia[3:]],
        },
    )


def _shapes(shapes: Sequence[Shape]) -> tuple[list[Value], dict[str, Value]]:
    """Return the visible parts of a body, and the colliding ones as a field: empty where nothing collides."""
    seen: list[Value] = []
    for shape in shapes:
        paint = Node("PBRAppearance", {"baseColor": shape.color or PLAIN, "roughness": 0.8, "metalness": 0})
        seen.append(_placed(shape, Node("Shape", {"appearance": paint, "geometry": geometry(shape)})))
    solid: list[Value] = [_placed(shape, geometry(shape)) for shape in shapes if shape.contact != "nothing"]
    # A boundingObject is a single node: several shapes have to be a group.
    if len(solid) > 1:
        return seen, {"boundingObject": Node("Group", {"children": solid})}
    return seen, {"boundingObject": solid[0]} if solid else {}


def geometry(shape: Shape) -> Node:
    """Return the geometry of a shape about its own middle."""
    a, b, c = shape.size
    if shape.kind == "sphere":
        return Node("Sphere", {"radius": a, "subdivision": 2})
    if shape.kind == "box":
        return Node("Box", {"size": (2 * a, 2 * b, 2 * c)})
    if shape.kind != "hull":
        return Node(shape.kind.capitalize(), {"height": 2 * b, "radius": a})
    faces = outward(np.array(shape.vertices))
    return Node(
        "IndexedFaceSet",
        {
            "coord": Node("Coordinate", {"point": list(shape.vertices)}),
            "coordIndex": [(*face, -1) for face in faces.tolist()],
        },
    )


def _placed(shape: Shape, child: Node) -> Node:
    """Return a node where a shape is in the frame of its link."""
    fields: dict[str, Value] = {}
    if any(shape.position):
        fields["translation"] = shape.position
    # (-1, 0, 0, 0) is upright too, and has no axis.
    if any(shape.quaternion[1:]):
        turn, axis = shape.quaternion[0], np.array(shape.quaternion[1:])
        size = float(np.linalg.norm(axis))
        # By atan2: the arc cosine of w loses half of its digits at small turns.
        fields["rotation"] = vector([*(axis / size), 2.0 * np.arctan2(size, turn)])
    return Node("Pose", {**fields, "children": [child]}) if fields else child
