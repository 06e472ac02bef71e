"""URDF: `<dynamics damping= friction=>`. It has no rotor inertia, and no difference between rest and motion.

Parsers that build a tree forget quotes, order and white space. Here expat only says where each tag stands, and the
bytes of a few start tags are edited. Document types and entities are rejected: no robot needs them, and they let a file
read others or grow without bound.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.parsers import expat

from stiction.core.errors import FileError
from stiction.core.files import read_bounded
from stiction.exchange.physics import Conversion, JointPhysics, check_axis, headline, known, notes_of, one_line

LARGEST = 16_000_000
"""Largest model [B]; meshes are files of their own."""

DEEPEST = 256
"""Deepest nesting of elements."""

Edit = tuple[int, int, bytes]
"""Start, end, and new bytes between them."""


@dataclass(frozen=True)
class Tag:
    """Element, with the byte offset of its start tag."""

    name: str
    """Name, such as `joint`."""
    attributes: dict[str, str]
    """Attributes, as the parser gives them."""
    start: int
    """Offset of its `<` [bytes]."""
    end: int
    """Offset after the `>` of the start tag [bytes]."""
    parent: int | None
    """Index of the element around it; None for the root."""
    inside: frozenset[str]
    """Names of all the elements around it."""


@dataclass(frozen=True)
class Markup:
    """Document with its elements, in the order of their start tags."""

    data: bytes
    """Bytes of the document."""
    tags: tuple[Tag, ...]
    """Elements of the document; the root is the first."""
    closes: dict[int, int]
    """Index of an element that does not close itself -> offset of its end tag [bytes]."""

    def ancestors(self, tag: Tag) -> list[Tag]:
        """Return the elements that hold `tag`, the nearest first."""
        around = []
        while tag.parent is not None:
            tag = self.tags[tag.parent]
            around.append(tag)
        return around

    def set_attributes(self, tag: Tag, values: dict[str, str]) -> Edit:
        """Return the edit that sets attributes of a tag, see `set_attributes`."""
        return tag.start, tag.end, set_attributes(self.data[tag.start : tag.end], values)

    def edited(self, edits: list[Edit], notes: list[str]) -> str:
        """Return the document with `edits` made, and `notes` in a comment after the root's start tag."""
        root = self.tags[0].end
        return edited(self.data, [*edits, (root, root, ("\n" + xml_comment(notes).rstrip("\n")).encode())])


def edited(data: bytes, edits: list[Edit]) -> str:
    """Return UTF-8 data as text with some stretches of bytes replaced; they must not overlap."""
    pieces, at = [], 0
    for start, end, new in sorted(edits):
        pieces += [data[at:start], new]
        at = end
    return b"".join([*pieces, data[at:]]).decode("utf-8")


def read_model(path: Path) -> bytes:
    """Return the bytes of a model; raise `StictionError` if it cannot be read, or is too large to be one."""
    return read_bounded(path, "a model's XML, meshes apart", FileError, LARGEST)


def parse_markup(data: bytes, where: str) -> Markup:
    """Return every element of a document; where: name in messages.

    Raises `StictionError` for a file that is not well-formed UTF-8 XML, and for document types and entities.
    """
    tags: list[Tag] = []
    closes: dict[int, int] = {}
    open_tags: list[int] = []
    parser = expat.ParserCreate("utf-8")

    def refuse(*_: Any) -> None:
        raise FileError(f"{where}: declares a document type or entities, which is refused; remove the declaration")

    def declared(_version: str, encoding: str | None, _standalone: int) -> None:
        # The parser takes all for UTF-8, whatever is declared: other letters would become wrong ones.
        if encoding is not None and encoding.lower() not in ("utf-8", "us-ascii", "ascii"):
            raise FileError(f"{where}: is encoded as {encoding}; save it as UTF-8")

    def opened(name: str, attributes: dict[str, str]) -> None:
        start, parent = parser.CurrentByteIndex, open_tags[-1] if open_tags else None
        if len(open_tags) >= DEEPEST:
            raise FileError(f"{where}: more than {DEEPEST} elements within each other; expected a robot")
        inside = frozenset() if parent is None else tags[parent].inside | {tags[parent].name}
        tags.append(Tag(name, attributes, start, _tag_end(data, start), parent, inside))
        open_tags.append(len(tags) - 1)

    def closed(_name: str) -> None:
        index = open_tags.pop()
        if data[tags[index].end - 2 : tags[index].end] != b"/>":
            closes[index] = parser.CurrentByteIndex

    # Expat calls back while it reads: what is declared is refused before it can be expanded.
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    parser.XmlDeclHandler = declared
    parser.StartElementHandler = opened
    parser.EndElementHandler = closed
    try:
        data.decode("utf-8")
        parser.Parse(data, True)
    except (UnicodeDecodeError, expat.ExpatError) as error:
        raise FileError(f"{where}: not well-formed XML in UTF-8 ({str(error)[:120]})") from error
    return Markup(data, tuple(tags), closes)


def set_attributes(tag: bytes, values: dict[str, str]) -> bytes:
    """Return a start tag with attributes replaced where they stand, and appended where they do not.

    Values must not need escaping: numbers do not.
    """
    waiting = dict(values)
    pieces, at = [], 0
    last = _NAME.match(tag).end()  # type: ignore[union-attr]
    for match in _ATTRIBUTE.finditer(tag, last):
        last = match.end()
        new = waiting.pop(match["name"].decode("utf-8"), None)
        if new is not None:
            pieces += [tag[at : match.start("value")], b'"' + new.encode() + b'"']
            at = match.end()
    appended = "".join(f' {name}="{value}"' for name, value in waiting.items()).encode()
    return b"".join([*pieces, tag[at:last], appended, tag[last:]])


def xml_comment(lines: list[str]) -> str:
    """Return lines as one XML comment; a text that would end it early is broken up."""
    text = "\n".join(f"  {line}" for line in lines)
    # Again and again: of three hyphens one replacement leaves two.
    while "--" in text:
        text = text.replace("--", "- -")
    return f"<!--\n{text}\n-->\n"


_NAME = re.compile(rb"<[^\s/>]+")
_ATTRIBUTE = re.compile(rb"""(?P<name>[^\s=<>/"']+)\s*=\s*(?P<value>"[^"]*"|'[^']*')""")
_QUOTED_OR_END = re.compile(rb""""[^"]*"|'[^']*'|>""")


def _tag_end(data: bytes, start: int) -> int:
    """Return the offset after the `>` that ends the start tag at `start`; a `>` within quotes does not."""
    for match in _QUOTED_OR_END.finditer(data, start):
        if match[0] == b">":
            return match.end()
    return len(data)


TYPES = {"rotary": ("revolute", "continuous"), "linear": ("prismatic",)}
"""Kind of axis -> joint types that fit it."""


def urdf_snippet(joints: list[JointPhysics]) -> Conversion:
    """Return a `<dynamics>` element for each joint."""
    notes = _notes(joints)
    # A name that does not end a comment.
    names = {joint.name: one_line(joint.name).replace("--", "- -").replace(">", "?") for joint in joints}
    lines = [f"<!-- {names[joint.name]} -->\n{_dynamics(joint).decode()}" for joint in joints if _values(joint)]
    told = [headline(joints, rotor=False)]
    return Conversion.of(xml_comment(told) + "\n".join(lines) + "\n", joints, notes, told)


def urdf_joints(markup: Markup) -> dict[str, Tag]:
    """Return the joints of a robot; raise `StictionError` for a file that is not a URDF."""
    if markup.tags[0].name != "robot":
        raise FileError(f"the model's root is <{markup.tags[0].name}>; expected <robot> (a URDF; expand xacro first)")
    return {
        tag.attributes["name"]: tag
        for tag in markup.tags
        if tag.name == "joint" and tag.parent == 0 and "name" in tag.attributes
    }


def patch_urdf(markup: Markup, joints: list[JointPhysics]) -> Conversion:
    """Return the robot with damping and friction of `joints` set, and a comment after the root tag.

    An existing `<dynamics>` is changed, else one is put last in the joint. Everything else stays as it was. Raises
    `StictionError` for a joint type that does not fit the record's axis.
    """
    tree, notes = urdf_joints(markup), _notes(joints)
    edits: list[Edit] = []
    for joint in joints:
        tag = tree[joint.name]
        check_axis(joint, tag.attributes.get("type", ""), TYPES[joint.record.axis])
        if _values(joint):
            edits.append(_edit(markup, tag, joint))
    told = [headline(joints, rotor=False)]
    return Conversion.of(markup.edited(edits, told), joints, notes, told)


def _edit(markup: Markup, tag: Tag, joint: JointPhysics) -> Edit:
    """Return the change of one joint."""
    index = markup.tags.index(tag)
    dynamics = next((item for item in markup.tags if item.name == "dynamics" and item.parent == index), None)
    if dynamics is not None:
        return markup.set_attributes(dynamics, _values(joint))
    close = markup.closes.get(index)
    if close is None:
        raise FileError(f"joint {joint.name!r} is empty: it has neither parent nor child; expected a whole URDF")
    # Indented as its neighbours, where the end tag stands in a line of its own.
    line = markup.data[markup.data.rfind(b"\n", 0, close) + 1 : close]
    indent = line if not line.strip() else b""
    return close, close, b"  " + _dynamics(joint) + b"\n" + indent


def _values(joint: JointPhysics) -> dict[str, str]:
    """Return the attributes of `<dynamics>`."""
    return known(damping=joint.damping, friction=joint.friction)


def _dynamics(joint: JointPhysics) -> bytes:
    """Return a new `<dynamics>`."""
    return set_attributes(b"<dynamics/>", _values(joint))


def _notes(joints: list[JointPhysics]) -> list[str]:
    """Return notes on the limits of URDF, then on the values left out of each joint."""
    return notes_of(
        joints,
        "MuJoCo reads damping and friction from a URDF, with default solver settings under which the joint creeps "
        "below its friction: better --to mujoco. SAPIEN's loader drops the friction. Measure what yours does with it",
        rotor="URDF has no rotor inertia, give it to the simulator by its own means",
    )
