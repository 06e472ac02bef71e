"""The robot of a `Robot` as a Webots PROTO, its joints as a policy's contract has them. Not run in Webots.

What stands where in Webots, and its source (docs/reference, and src/webots/nodes for what the documents leave out):

* The robot's x is forward, y left, z up, the world's z up (FLU and ENU, Webots' defaults since R2022a): as here.
* **Joint angles count from the standing pose.** `minStop` has to lie in [-π, 0] and `maxStop` in [0, π]
  (jointparameters.md), which the limits of a knee do not. So the links stand in the PROTO as in the standing pose, and
  the controller adds that pose to what the sensors say. ODE sees an angle modulo 2π, counted from the pose in which the
  joint was made: a stop beyond π would strike from the other side, and is moved to `FARTHEST`.
* `Physics`: density -1 means that the mass holds; `inertiaMatrix [ I11 I22 I33, I12 I13 I23 ]` is about the
  `centerOfMass` (physics.md). With mass, centre and matrix a body needs no `boundingObject` (WbPhysics.cpp,
  CUSTOM_INERTIA_MATRIX): hips and thighs touch nothing, as in MuJoCo.
* `staticFriction` is a bound of dry friction as soon as a torque is set (WbRotationalMotor.cpp, turnOffMotor: a motor
  with target speed 0 and that bound); under position and velocity control it does nothing
  (https://github.com/cyberbotics/webots/issues/2483). `dampingConstant` is B, taken implicitly (WbHingeJoint.cpp).
* There is no rotor inertia: the physics plugin adds it (`plugin.py`).

A field holds one value or a list of values; which, is the node type's business. Here a tuple of numbers is one value
(a vector, a rotation, a colour), a list is a list of values. Numbers are written with the digits that read back
exactly. Source of the language: docs/reference/proto-definition.md and the node types in resources/nodes of
https://github.com/cyberbotics/webots, R2023b.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from stiction.exchange.webots.controller import CHANNEL, GPS, GYRO, IMU, RECEIVER, SENSOR
from stiction.formats.contract import Contract
from stiction.robots.mjcf import FEET, SHANK, THIGH, TRUNK
from stiction.robots.model import JOINT_KINDS, JOINTS_PER_LEG, JointSpec, LegSpec, Robot, box_inertia
from stiction.robots.tree import SHANK_RADIUS, THIGH_RADIUS, Link, foot_position, links

HEADER = "#VRML_SIM R2023b utf8"
"""First line of a world and of a PROTO. R2023b: `Pose` nodes, and a launcher that gives a controller arguments."""

INDENT = "  "


@dataclass(frozen=True)
class Is:
    """The value of a field that the PROTO's interface gives: `staticFriction IS hipFriction`."""

    name: str
    """Field of the interface."""


@dataclass(frozen=True)
class Node:
    """A node: `DEF FL_hip_link Solid { ... }`."""

    kind: str
    """Its type: `Solid`."""
    fields: Mapping[str, Value] = field(default_factory=dict)
    """Field -> value, in the order in which they are written."""
    define: str = ""
    """Name by which a physics plugin finds it, none by default."""


Value = bool | int | float | str | tuple[float, ...] | Is | Node | list["Value"]
"""What a field can hold."""


def number(value: float) -> str:
    """Return a number with the digits that read back exactly, whole ones without a point."""
    exact = float(value) + 0.0  # -0.0 becomes 0.0
    return str(int(exact)) if exact.is_integer() and abs(exact) < 1e15 else repr(exact)


def vector(values: np.ndarray) -> tuple[float, ...]:
    """Return an array of numbers as one value of a field."""
    return tuple(np.asarray(values, float).tolist())


def text(value: str) -> str:
    """Return a string within quotes; what would end it is escaped, what cannot be printed is a blank."""
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
"""Controller that Webots waits for: a program that somebody starts by hand."""

FARTHEST = 3.1
"""Largest distance of a stop from the standing pose [rad], less than π."""


def proto_name(robot: str) -> str:
    """Return a robot's name as a PROTO may be called: `saturn_lite` is `SaturnLite`."""
    words = re.findall(r"[A-Za-z0-9]+", robot)
    return "Robot" * (not words or words[0][0].isdigit()) + "".join(word[0].upper() + word[1:] for word in words)


def friction_field(kind: str) -> str:
    """Return the PROTO's field for the dry friction of one kind of joint: `hipFriction`."""
    return f"{kind}Friction"


def stops(joint: JointSpec) -> tuple[float, float]:
    """Return `minStop` and `maxStop` [rad]: the joint's limits, counted from its standing angle."""
    return max(joint.lower - joint.standing, -FARTHEST), min(joint.upper - joint.standing, FARTHEST)


def write_proto(spec: Robot, contract: Contract) -> str:
    """Return the text of the PROTO.

    spec: shape, masses, limits; contract: viscous friction of the joints, in the order of `spec.joint_names`.
    """
    damping = dict(zip(spec.joint_names, contract.damping, strict=True))
    interface: dict[str, tuple[str, str]] = {
        "translation": ("SFVec3f", write((0.0, 0.0, spec.standing_height))),
        "rotation": ("SFRotation", "0 0 1 0"),
        "name": ("SFString", text(spec.name)),
        "controller": ("SFString", text(EXTERN)),
        **{friction_field(kind): ("SFFloat", "0") for kind in JOINT_KINDS},
    }
    fields = "".join(f"  field {kind:<10} {name:<14} {value}\n" for name, (kind, value) in interface.items())
    about = comment(
        f"{spec.name}: {spec.mass:g} kg, {spec.num_joints} joints. Angles count from the standing pose.\n"
        "Dry friction of the joints [N m] is a field for each kind of joint; it acts under torque control alone.\n"
        "Rotor inertia is in the physics plugin. Written by `stiction export --to webots`. NOT RUN in Webots."
    )
    return (
        f"{HEADER}\n{about}\nPROTO {proto_name(spec.name)} [\n{fields}]\n{{\n  {write(_robot(spec, damping), 1)}\n}}\n"
    )


def _robot(spec: Robot, damping: dict[str, float]) -> Node:
    """Return the trunk with its legs and sensors."""
    box = Node("Box", {"size": tuple(spec.base.size)})
    devices: list[Value] = [
        Node("InertialUnit", {"name": IMU}),
        Node("Gyro", {"name": GYRO}),
        Node("GPS", {"name": GPS}),
        Node("Receiver", {"name": RECEIVER, "channel": CHANNEL}),
    ]
    legs: list[Value] = [_hang(spec, damping, k) for k, link in enumerate(links(spec)) if link.parent < 0]
    return Node(
        "Robot",
        {
            "translation": Is("translation"),
            "rotation": Is("rotation"),
            "children": [_shape(box, TRUNK), *devices, *legs],
            "name": Is("name"),
            "boundingObject": box,
            "physics": _physics(spec.base.mass, np.zeros(3), box_inertia(spec.base.mass, spec.base.size)),
            "controller": Is("controller"),
        },
    )


def _hang(spec: Robot, damping: dict[str, float], number: int) -> Node:
    """Return the hinge of link `number` of the robot's tree, with all that hangs on it."""
    tree = links(spec)
    link, leg, kind = tree[number], spec.legs[number // JOINTS_PER_LEG], JOINT_KINDS[number % JOINTS_PER_LEG]
    joint: JointSpec = getattr(spec, kind)
    shapes, bounding = _shapes(spec, leg, link, kind)
    axis, anchor = vector(link.axis), vector(link.origin)
    solid: dict[str, Value] = {
        "translation": anchor,
        "rotation": (*axis, joint.standing),
        "children": [*shapes, *(_hang(spec, damping, k) for k, each in enumerate(tree) if each.parent == number)],
        "name": link.name,
    }
    if bounding is not None:
        solid["boundingObject"] = bounding
    solid["physics"] = _physics(link.mass, link.com, link.inertia)
    parameters: dict[str, Value] = {"axis": axis, "anchor": anchor, "dampingConstant": damping[link.joint]}
    return _hinge(link.joint, kind, joint, parameters, Node("Solid", solid, define=link.name))


def _shapes(spec: Robot, leg: LegSpec, link: Link, kind: str) -> tuple[list[Value], Node | None]:
    """Return what there is to see of a link, and what of it collides: of a shank its bone and its foot."""
    middle = vector(link.com)
    if kind == "thigh":
        return [_at(middle, _shape(_capsule(spec.thigh_link.size[2], THIGH_RADIUS), THIGH))], None
    if kind == "shank":
        foot = Node("Sphere", {"radius": spec.foot_radius, "subdivision": 2})
        bone, below = _capsule(spec.shank_link.size[2], SHANK_RADIUS), vector(foot_position(spec))
        seen: list[Value] = [_at(middle, _shape(bone, SHANK)), _at(below, _shape(foot, FEET[leg.group]))]
        return seen, Node("Group", {"children": [_at(below, foot), _at(middle, bone)]})
    return [], None


def _hinge(name: str, kind: str, joint: JointSpec, parameters: Mapping[str, Value], end: Node) -> Node:
    """Return a joint with motor and sensor; the motor has the joint's name, the sensor that and `SENSOR`."""
    low, high = stops(joint)
    limits: dict[str, Value] = {"minStop": low, "maxStop": high, "staticFriction": Is(friction_field(kind))}
    motor = Node("RotationalMotor", {"name": name, "maxTorque": joint.torque_limit, "sound": ""})
    return Node(
        "HingeJoint",
        {
            "jointParameters": Node("HingeJointParameters", {**parameters, **limits}),
            "device": [motor, Node("PositionSensor", {"name": name + SENSOR})],
            "endPoint": end,
        },
    )


def _physics(mass: float, centre: np.ndarray, inertia: np.ndarray) -> Node:
    """Return mass [kg] and principal moments [kg m²] about a centre of mass [m] in its link's frame, both (3,)."""
    return Node(
        "Physics",
        {
            "density": -1,
            "mass": mass,
            "centerOfMass": [vector(centre)],
            "inertiaMatrix": [vector(inertia), (0.0, 0.0, 0.0)],
        },
    )


def _capsule(length: float, radius: float) -> Node:
    """Return a capsule along z; `length` [m] counts without the caps, as MuJoCo's does."""
    return Node("Capsule", {"height": length, "radius": radius})


def _shape(geometry: Node, colour: tuple[float, ...]) -> Node:
    """Return something to look at."""
    return Node(
        "Shape",
        {
            "appearance": Node("PBRAppearance", {"baseColor": colour, "roughness": 0.8, "metalness": 0}),
            "geometry": geometry,
        },
    )


def _at(place: tuple[float, ...], child: Node) -> Node:
    """Return a node somewhere else in its parent's frame [m]."""
    return Node("Pose", {"translation": place, "children": [child]})
