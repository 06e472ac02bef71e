"""Webots: `staticFriction` and `dampingConstant` of a `HingeJointParameters`.

Webots' `staticFriction` has no effect while a motor is under position or velocity control; under torque control it is
Coulomb friction (https://github.com/cyberbotics/webots/issues/2483). Webots has no rotor inertia.
"""

from __future__ import annotations

from stiction.formats.errors import StictionError
from stiction.identify.convert.markup import Edit, edited
from stiction.identify.convert.physics import Conversion, JointPhysics, number, one_line, record_notes
from stiction.identify.convert.vrml import Node, parse_nodes


def webots_snippet(joints: list[JointPhysics]) -> Conversion:
    """Return `jointParameters` fields, one a joint, for a PROTO or a world; raise `StictionError` for a linear axis."""
    notes = _notes(joints)
    notes.append("add the fields to each joint's own HingeJointParameters, beside its axis and anchor")
    lines = [f"# {note}" for note in notes]
    for joint in joints:
        fields = [f"  {name} {value}" for name, value in _fields(joint).items()]
        lines += [f"# {one_line(joint.name)}", "jointParameters HingeJointParameters {", *fields, "}"]
    return Conversion("\n".join(lines) + "\n", {joint.name: joint.recorded for joint in joints}, tuple(notes))


def webots_joints(data: bytes, where: str) -> dict[str, Node]:
    """Return name of the motor -> parameters of its hinge, for every hinge that has both.

    In Webots a joint has no name of its own; `urdf2webots` gives the motor the joint's.
    """
    nodes = parse_nodes(data, where)
    motors: dict[int, str] = {}
    parameters: dict[int, Node] = {}
    for node in nodes:
        if node.parent is None or nodes[node.parent].kind != "HingeJoint":
            continue
        name = node.value("name")
        if node.kind == "RotationalMotor" and name is not None and name[0].startswith('"'):
            motors[node.parent] = name[0][1:-1]
        elif node.kind == "HingeJointParameters":
            parameters[node.parent] = node
    return {motors[joint]: node for joint, node in parameters.items() if joint in motors}


def patch_webots(data: bytes, where: str, joints: list[JointPhysics]) -> Conversion:
    """Return a PROTO or a world with the fields of `joints` set, and comments after its first line; the rest as it was.

    Raises `StictionError` for a field that is bound to a parameter of the PROTO.
    """
    tree, notes = webots_joints(data, where), _notes(joints)
    edits: list[Edit] = []
    for joint in joints:
        node = tree[joint.name]
        body = data[node.start :]
        space = body[: len(body) - len(body.lstrip())] or b" "
        added = b""
        for name, value in _fields(joint).items():
            there = node.value(name)
            if there is None:
                added += space + f"{name} {value}".encode()
            elif there[0] == "IS":
                raise StictionError(f"joint {joint.name!r}: {name} is bound to a parameter of the PROTO; set it there")
            else:
                edits.append((there[1], there[2], value.encode()))
        edits.append((node.start, node.start, added))
    first = data.find(b"\n") + 1
    edits.append((first, first, "".join(f"# {note}\n" for note in notes).encode()))
    return Conversion(edited(data, edits), {joint.name: joint.recorded for joint in joints}, tuple(notes))


def _fields(joint: JointPhysics) -> dict[str, str]:
    """Return what is known of a joint as Webots calls it; refuse a linear axis."""
    if joint.record.axis == "linear":
        raise StictionError(f"record {joint.recorded!r} is of a linear axis; HingeJointParameters are for rotary ones")
    known = {"staticFriction": joint.friction, "dampingConstant": joint.damping}
    return {name: number(value) for name, value in known.items() if value is not None}


def _notes(joints: list[JointPhysics]) -> list[str]:
    """Say under which control this acts, then what was left out of each joint."""
    notes = [
        "written by `stiction convert` from an identification",
        "staticFriction acts only under torque control (setTorque); under position or velocity control Webots ignores "
        "it: let the controller run its own PD at every basicTimeStep and set torques",
    ]
    return notes + record_notes(joints, rotor="Webots has no rotor inertia, a physics plugin could add it")
