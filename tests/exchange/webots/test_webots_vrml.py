"""Writer and reader of Webots' language; the reader finds mistakes."""

from __future__ import annotations

from pathlib import Path

import pytest

from stiction.exchange.webots.proto import HEADER, Is, Node, write
from webots_files import WebotsSyntaxError, read_proto, read_world


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (True, "TRUE"),
        (3, "3"),
        (-0.0, "0"),
        (0.1 + 0.2, "0.30000000000000004"),
        (1e-05, "1e-05"),
        ((1.0, 0.0, -2.5), "1 0 -2.5"),
        ('a "b" \\', '"a \\"b\\" \\\\"'),
        (Is("hipFriction"), "IS hipFriction"),
        ([], "[ ]"),
        ([(1, 2), (3, 4)], "[\n  1 2\n  3 4\n]"),
        (Node("Box", {"size": (1, 2, 3)}), "Box {\n  size 1 2 3\n}"),
        (Node("Solid", {"children": [Node("Group")]}, "A"), "DEF A Solid {\n  children [\n    Group {\n    }\n  ]\n}"),
    ],
)
def test_values_are_written_as_webots_reads_them(value, text: str) -> None:
    """Values are written in the forms that Webots reads."""
    assert write(value) == text


def test_what_was_written_can_be_read(tmp_path: Path) -> None:
    """The reader accepts the writer's text."""
    box = Node("Box", {"size": (1.0, 2.0, 0.1)})
    solid = Node("Solid", {"translation": (0.0, 0.0, 1e-3), "name": 'the "box"', "boundingObject": box}, "BOX")
    (tmp_path / "a.wbt").write_text(f"{HEADER}\n# about\n{write(solid)}\n")
    (read,) = read_world(tmp_path / "a.wbt")
    assert (read.kind, read.define, read["name"]) == ("Solid", "BOX", 'the "box"')
    assert read["translation"] == (0.0, 0.0, 1e-3)
    assert read["boundingObject"]["size"] == (1.0, 2.0, 0.1)


def test_a_proto_is_read_with_its_interface(tmp_path: Path) -> None:
    """A PROTO is read with its interface; unbound fields are found."""
    text = f"{HEADER}\nPROTO Thing [\n  field SFFloat drag 2\n]\n{{\n  HingeJoint {{ jointParameters "
    text += "HingeJointParameters { staticFriction IS drag } }\n}\n"
    (tmp_path / "Thing.proto").write_text(text)
    proto = read_proto(tmp_path / "Thing.proto")
    assert proto.interface == {"drag": ("SFFloat", 2.0)}
    (tmp_path / "Thing.proto").write_text(text.replace("IS drag", "IS drags"))
    with pytest.raises(WebotsSyntaxError, match="drags"):
        read_proto(tmp_path / "Thing.proto")
