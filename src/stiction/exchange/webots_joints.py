"""Webots: `staticFriction` and `dampingConstant` of a `HingeJointParameters`.

Webots' `staticFriction` has no effect while a motor is under position or velocity control; under torque control it is
Coulomb friction (https://github.com/cyberbotics/webots/issues/2483). Webots has no rotor inertia.

Not a parser of the language: braces make nodes, the word before a brace is a node's type, and text within quotes,
comments and templates (`%< ... >%`) is passed over.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from stiction.core.errors import FileError
from stiction.exchange.physics import Conversion, JointPhysics, headline, known, notes_of, one_line
from stiction.exchange.urdf import Edit, edited

_TOKEN = re.compile(rb'#[^\n]*|"(?:\\.|[^"\\])*"|%<|[{}\[\]]|"|[^\s,{}\[\]"#%]+|%', re.DOTALL)


@dataclass
class Node:
    """Node, such as `HingeJointParameters { ... }`."""

    kind: str
    """Type of the node."""
    start: int
    """Offset after its `{` [bytes]."""
    parent: int | None
    """Index of the node around it."""
    words: list[tuple[str, int, int]] = field(default_factory=list)
    """Words and quoted strings of the node, without those of nodes within it: text, start and end [bytes]."""

    def value(self, name: str) -> tuple[str, int, int] | None:
        """Return the word after the field `name`; None where the node has no such field."""
        texts = [text for text, _, _ in self.words]
        at = texts.index(name) + 1 if name in texts else len(texts)
        return self.words[at] if at < len(texts) else None


def parse_nodes(data: bytes, where: str) -> list[Node]:
    """Return every node, in the order of their braces; where: name in messages.

    Raises `StictionError` for a file that is not UTF-8, and for quotes, braces or templates that do not close.
    """
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise FileError(f"{where}: not UTF-8 ({error.reason}); expected a PROTO or a world") from error
    nodes: list[Node] = []
    inside: list[int] = []
    word, at = "", 0
    while (match := _TOKEN.search(data, at)) is not None:
        at, token = match.end(), match[0]
        if token == b"%<":
            at = data.find(b">%", at) + 2
            # Where there is none, find gives -1, and 2 were added.
            if at == 1:
                raise FileError(f"{where}: a template %< does not close; expected a PROTO or a world")
        elif token == b"{":
            nodes.append(Node(word, at, inside[-1] if inside else None))
            inside.append(len(nodes) - 1)
        elif token == b"}":
            if not inside:
                raise FileError(f"{where}: a brace closes that never opened; expected a PROTO or a world")
            inside.pop()
        elif token == b'"':
            raise FileError(f"{where}: a quote does not close; expected a PROTO or a world")
        elif token not in (b"[", b"]", b"%") and not token.startswith(b"#"):
            word = token.decode("utf-8")
            if inside:
                nodes[inside[-1]].words.append((word, match.start(), match.end()))
    if inside:
        raise FileError(f"{where}: a brace does not close; expected a PROTO or a world")
    return nodes


def webots_snippet(joints: list[JointPhysics]) -> Conversion:
    """Return `jointParameters` fields, one a joint, for a PROTO or a world; raise `StictionError` for a linear axis."""
    notes = _notes(joints)
    notes.append("add the fields to each joint's own HingeJointParameters, beside its axis and anchor")
    told = [headline(joints, rotor=False)]
    lines = [f"# {note}" for note in told]
    for joint in joints:
        fields = [f"  {name} {value}" for name, value in _fields(joint).items()]
        lines += [f"# {one_line(joint.name)}", "jointParameters HingeJointParameters {", *fields, "}"]
    return Conversion.of("\n".join(lines) + "\n", joints, notes, told)


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
        # The white space before the node's first field, so that a new one stands as that one does.
        space = body[: len(body) - len(body.lstrip())] or b" "
        added = b""
        for name, value in _fields(joint).items():
            existing = node.value(name)
            if existing is None:
                added += space + f"{name} {value}".encode()
            elif existing[0] == "IS":
                raise FileError(f"joint {joint.name!r}: {name} is bound to a parameter of the PROTO; set it there")
            else:
                edits.append((existing[1], existing[2], value.encode()))
        edits.append((node.start, node.start, added))
    # The first line says what the file is, and has to stay the first.
    first = data.find(b"\n") + 1
    told = [headline(joints, rotor=False)]
    edits.append((first, first, f"# {told[0]}\n".encode()))
    return Conversion.of(edited(data, edits), joints, notes, told)


def _fields(joint: JointPhysics) -> dict[str, str]:
    """Return the known values of a joint by Webots' fields; reject a linear axis."""
    if joint.record.axis == "linear":
        raise FileError(f"record {joint.recorded!r} is of a linear axis; HingeJointParameters are for rotary ones")
    return known(staticFriction=joint.friction, dampingConstant=joint.damping)


def _notes(joints: list[JointPhysics]) -> list[str]:
    """Return notes on the control under which this acts, then on the values left out of each joint."""
    return notes_of(
        joints,
        "staticFriction acts only under torque control (setTorque); under position or velocity control Webots ignores "
        "it: let the controller run its own PD at every basicTimeStep and set torques",
        rotor="Webots has no rotor inertia, a physics plugin could add it",
    )
