"""URDF: `<dynamics damping= friction=>`. It has no rotor inertia, and no difference between rest and motion."""

from __future__ import annotations

from stiction.formats.errors import StictionError
from stiction.identify.convert.markup import Edit, Markup, Tag, set_attributes, xml_comment
from stiction.identify.convert.physics import Conversion, JointPhysics, number, one_line, record_notes

TYPES = {"rotary": ("revolute", "continuous"), "linear": ("prismatic",)}
"""Kind of axis -> joint types that fit it."""


def urdf_snippet(joints: list[JointPhysics]) -> Conversion:
    """Return a `<dynamics>` element for each joint."""
    notes = _notes(joints)
    lines = [f"<!-- {_safe(joint.name)} -->\n<dynamics{_joined(joint)}/>" for joint in joints if _values(joint)]
    return Conversion(
        xml_comment(notes) + "\n".join(lines) + "\n", {joint.name: joint.recorded for joint in joints}, tuple(notes)
    )


def urdf_joints(markup: Markup) -> dict[str, Tag]:
    """Return the joints of a robot; raise `StictionError` for what is no URDF."""
    if markup.tags[0].name != "robot":
        raise StictionError(
            f"the model's root is <{markup.tags[0].name}>; expected <robot> (a URDF; expand xacro first)"
        )
    return {
        tag.attributes["name"]: tag
        for tag in markup.tags
        if tag.name == "joint" and tag.parent == 0 and "name" in tag.attributes
    }


def patch_urdf(markup: Markup, joints: list[JointPhysics]) -> Conversion:
    """Return the robot with damping and friction of `joints` set, and a comment after the root tag.

    A `<dynamics>` that is there is changed, else one is put last in the joint. Everything else stays as it was. Raises
    `StictionError` for a joint type that does not fit the record's axis.
    """
    tree, notes = urdf_joints(markup), _notes(joints)
    edits: list[Edit] = []
    for joint in joints:
        tag = tree[joint.name]
        kind = tag.attributes.get("type", "")
        if kind not in TYPES[joint.record.axis]:
            raise StictionError(
                f"joint {joint.name!r} is of type {kind or 'none'}, and the record {joint.recorded!r} of a "
                f"{joint.record.axis} axis; expected {' or '.join(TYPES[joint.record.axis])}"
            )
        if _values(joint):
            edits.append(_edit(markup, tag, joint))
    root = markup.tags[0].end
    edits.append((root, root, ("\n" + xml_comment(notes).rstrip("\n")).encode()))
    return Conversion(markup.edited(edits), {joint.name: joint.recorded for joint in joints}, tuple(notes))


def _edit(markup: Markup, tag: Tag, joint: JointPhysics) -> Edit:
    """Return the change of one joint."""
    index = markup.tags.index(tag)
    there = next((item for item in markup.tags if item.name == "dynamics" and item.parent == index), None)
    if there is not None:
        return there.start, there.end, set_attributes(markup.data[there.start : there.end], _values(joint))
    close = markup.closes.get(index)
    if close is None:
        raise StictionError(f"joint {joint.name!r} is empty: it has neither parent nor child; expected a whole URDF")
    line = markup.data[markup.data.rfind(b"\n", 0, close) + 1 : close]
    indent = line if not line.strip() else b""
    return close, close, b"  <dynamics" + _joined(joint).encode() + b"/>\n" + indent


def _values(joint: JointPhysics) -> dict[str, str]:
    """Return the attributes of `<dynamics>`."""
    known = {"damping": joint.damping, "friction": joint.friction}
    return {name: number(value) for name, value in known.items() if value is not None}


def _joined(joint: JointPhysics) -> str:
    """Return the attributes as text."""
    return "".join(f' {name}="{value}"' for name, value in _values(joint).items())


def _notes(joints: list[JointPhysics]) -> list[str]:
    """Say what URDF cannot hold, then what was left out of each joint."""
    notes = [
        "written by `stiction convert` from an identification",
        "MuJoCo reads damping and friction from a URDF, with default solver settings under which the joint creeps "
        "below its friction: better --to mujoco. SAPIEN's loader drops the friction. Measure what yours does with it",
    ]
    return notes + record_notes(joints, rotor="URDF has no rotor inertia, give it to the simulator by its own means")


def _safe(name: str) -> str:
    """Return a name that does not end a comment."""
    return one_line(name).replace("--", "- -").replace(">", "?")
