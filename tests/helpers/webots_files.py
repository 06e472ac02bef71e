"""A strict reader of Webots' worlds and PROTOs, for the node types that are used here.

Stricter than Webots, which skips what it does not know: an unknown node, field or type of value, a field given twice
and a PROTO that was not declared are errors. Node types and their fields as in resources/nodes of
https://github.com/cyberbotics/webots, R2023b.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

HEADER = "#VRML_SIM R2023b utf8"

TOKEN = re.compile(r'#[^\n]*|"(?:\\["\\]|[^"\\\n])*"|[{}\[\]]|[^\s{}\[\]"#,]+|\S')

NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?(e-?[0-9]+)?")

SIZES = {"SFFloat": 1, "SFInt32": 1, "SFVec2f": 2, "SFVec3f": 3, "SFColor": 3, "SFRotation": 4}
"""Type of numbers -> how many make one value."""

POSE = {"translation": "SFVec3f", "rotation": "SFRotation", "children": "MFNode"}

SOLID = POSE | {"name": "SFString", "boundingObject": "SFNode", "physics": "SFNode", "contactMaterial": "SFString"}

NODES: dict[str, dict[str, str]] = {
    "WorldInfo": dict.fromkeys(("title", "physics"), "SFString")
    | dict.fromkeys(("basicTimeStep", "physicsDisableLinearThreshold", "physicsDisableAngularThreshold"), "SFFloat")
    | {"contactProperties": "MFNode"},
    "ContactProperties": {"coulombFriction": "MFFloat", "bounce": "SFFloat"}
    | dict.fromkeys(("material1", "material2", "bumpSound", "rollSound", "slideSound"), "SFString"),
    "Viewpoint": {"orientation": "SFRotation", "position": "SFVec3f", "follow": "SFString"},
    "Background": {"skyColor": "MFColor"},
    "DirectionalLight": {"direction": "SFVec3f", "intensity": "SFFloat", "castShadows": "SFBool"},
    "Pose": POSE,
    "Group": {"children": "MFNode"},
    "Solid": SOLID,
    "Robot": SOLID | {"controller": "SFString", "selfCollision": "SFBool", "supervisor": "SFBool"},
    "InertialUnit": SOLID,
    "Gyro": SOLID,
    "GPS": SOLID,
    "Receiver": SOLID | {"channel": "SFInt32"},
    "HingeJoint": {"jointParameters": "SFNode", "device": "MFNode", "endPoint": "SFNode"},
    "HingeJointParameters": {"axis": "SFVec3f", "anchor": "SFVec3f"}
    | dict.fromkeys(("position", "minStop", "maxStop", "dampingConstant", "staticFriction"), "SFFloat"),
    "RotationalMotor": {"name": "SFString", "maxTorque": "SFFloat", "sound": "SFString"},
    "PositionSensor": {"name": "SFString"},
    "Physics": {"density": "SFFloat", "mass": "SFFloat", "centerOfMass": "MFVec3f", "inertiaMatrix": "MFVec3f"},
    "Shape": {"appearance": "SFNode", "geometry": "SFNode"},
    "PBRAppearance": {"baseColor": "SFColor", "roughness": "SFFloat", "metalness": "SFFloat"},
    "Box": {"size": "SFVec3f"},
    "Sphere": {"radius": "SFFloat", "subdivision": "SFInt32"},
    "Capsule": {"height": "SFFloat", "radius": "SFFloat"},
    "Cylinder": {"height": "SFFloat", "radius": "SFFloat"},
    "IndexedFaceSet": {"coord": "SFNode", "coordIndex": "MFInt32"},
    "Coordinate": {"point": "MFVec3f"},
}
"""Type of node -> field -> type of its value."""

GEOMETRY = {"Box", "Sphere", "Capsule", "Cylinder", "IndexedFaceSet"}

HOLDS = {
    "contactProperties": {"ContactProperties"},
    "jointParameters": {"HingeJointParameters"},
    "device": {"RotationalMotor", "PositionSensor"},
    "endPoint": {"Solid"},
    "physics": {"Physics"},
    "appearance": {"PBRAppearance"},
    "geometry": GEOMETRY,
    "coord": {"Coordinate"},
    "boundingObject": GEOMETRY | {"Group", "Pose"},
    "children": {"Solid", "HingeJoint", "Shape", "Pose", "InertialUnit", "Gyro", "GPS", "Receiver"} | GEOMETRY,
}
"""Field -> types of node that it may hold."""


class WebotsSyntaxError(Exception):
    """Syntax that Webots rejects or silently skips."""


@dataclass
class Read:
    """A node that was read."""

    kind: str
    define: str
    fields: dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Any:
        """Return the value of a field."""
        return self.fields[name]

    def every(self, kind: str) -> list[Read]:
        """Return the nodes of one type in this one, itself among them, in the order of the file."""
        nodes = [self] if self.kind == kind else []
        for value in self.fields.values():
            for item in value if isinstance(value, list) else [value]:
                nodes += item.every(kind) if isinstance(item, Read) else []
        return nodes


@dataclass(frozen=True)
class Bound:
    """A value that the interface of the PROTO gives."""

    name: str


@dataclass
class Proto:
    """A PROTO: its interface, field -> type and default, and its body."""

    name: str
    interface: dict[str, tuple[str, Any]]
    body: Read

    def instance(self, node: Read) -> Read:
        """Return the body with the fields of an instance in place."""
        values = {name: default for name, (_, default) in self.interface.items()} | node.fields
        made = _filled(self.body, values)
        made.define = node.define
        return made


def _filled(value: Any, values: dict[str, Any]) -> Any:
    """Return a copy of a value with every `IS` replaced."""
    if isinstance(value, Bound):
        return values[value.name]
    if isinstance(value, list):
        return [_filled(item, values) for item in value]
    if isinstance(value, Read):
        return Read(value.kind, value.define, {name: _filled(item, values) for name, item in value.fields.items()})
    return value


class Reader:
    """Reads one file, token by token."""

    def __init__(self, text: str, protos: dict[str, Proto] | None = None) -> None:
        """Check the first line."""
        if text.split("\n", 1)[0] != HEADER:
            raise WebotsSyntaxError(f"the first line is {text.split(chr(10), 1)[0]!r}")
        self.tokens = [token for token in TOKEN.findall(text) if not token.startswith("#")]
        self.at = 0
        self.protos = {} if protos is None else protos
        self.interface: dict[str, tuple[str, Any]] = {}

    def next(self, *expected: str) -> str:
        """Return the next token, one of those expected if any are named."""
        if self.at == len(self.tokens):
            raise WebotsSyntaxError("the file ends too soon")
        token = self.tokens[self.at]
        if expected and token not in expected:
            raise WebotsSyntaxError(f"{token!r} where {' or '.join(expected)} was expected")
        self.at += 1
        return token

    def peek(self) -> str | None:
        """Return the next token without taking it, None at the end."""
        return self.tokens[self.at] if self.at < len(self.tokens) else None

    def string(self) -> str:
        """Return a quoted string."""
        token = self.next()
        if not (len(token) > 1 and token.startswith('"')):
            raise WebotsSyntaxError(f"{token!r} where a string was expected")
        return token[1:-1].replace('\\"', '"').replace("\\\\", "\\")

    def single(self, kind: str, name: str) -> Any:
        """Return one value of a type."""
        if kind == "SFString":
            return self.string()
        if kind == "SFBool":
            return self.next("TRUE", "FALSE") == "TRUE"
        if kind == "SFNode":
            return self.node(HOLDS[name])
        numbers = [self.next() for _ in range(SIZES[kind])]
        wrong = [token for token in numbers if not NUMBER.fullmatch(token) or (kind == "SFInt32" and "." in token)]
        if wrong:
            raise WebotsSyntaxError(f"{wrong[0]!r} where a number of {name}, {kind}, was expected")
        values = tuple(float(token) for token in numbers)
        return values[0] if SIZES[kind] == 1 else values

    def value(self, kind: str, name: str) -> Any:
        """Return the value of a field: one, a list, or an `IS` of the same type."""
        if self.peek() == "IS":
            self.next()
            bound = self.next()
            if bound not in self.interface or self.interface[bound][0] != kind:
                raise WebotsSyntaxError(f"{name} IS {bound}: no such field of type {kind} in the interface")
            return Bound(bound)
        if not kind.startswith("MF"):
            return self.single(kind, name)
        self.next("[")
        items = []
        while self.peek() != "]":
            items.append(self.single("SF" + kind[2:], name))
        self.next("]")
        return items

    def node(self, allowed: set[str] | None = None) -> Read:
        """Return the next node."""
        kind, define = self.next(), ""
        if kind == "DEF":
            define, kind = self.next(), self.next()
        types = {name: kind for name, (kind, _) in self.protos[kind].interface.items()} if kind in self.protos else None
        types = NODES.get(kind) if types is None else types
        if types is None or (allowed is not None and kind not in allowed):
            raise WebotsSyntaxError(f"the node {kind} is unknown here, or not declared")
        read = Read(kind, define)
        self.next("{")
        while (name := self.next()) != "}":
            if name not in types or name in read.fields:
                raise WebotsSyntaxError(f"{kind} has no field {name!r}, or it is given twice")
            read.fields[name] = self.value(types[name], name)
        return read


def read_proto(path: Path) -> Proto:
    """Read a PROTO; its name must be that of its file."""
    reader = Reader(path.read_text())
    reader.next("PROTO")
    name = reader.next()
    if name != path.stem:
        raise WebotsSyntaxError(f"the file {path.name} has the PROTO {name}")
    reader.next("[")
    while reader.next("field", "]") == "field":
        kind, field_name = reader.next(), reader.next()
        reader.interface[field_name] = kind, reader.single(kind, field_name)
    reader.next("{")
    body = reader.node()
    reader.next("}")
    if reader.peek() is not None:
        raise WebotsSyntaxError(f"{reader.peek()!r} after the end")
    return Proto(name, reader.interface, body)


def read_world(path: Path) -> list[Read]:
    """Read a world with its PROTOs in place; return its nodes."""
    reader = Reader(path.read_text())
    while reader.peek() == "EXTERNPROTO":
        reader.next()
        proto = read_proto(path.parent / reader.string())
        reader.protos[proto.name] = proto
    nodes = []
    while reader.peek() is not None:
        node = reader.node()
        nodes.append(reader.protos[node.kind].instance(node) if node.kind in reader.protos else node)
    return nodes
