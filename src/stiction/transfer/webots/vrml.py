"""Writes nodes in the language of Webots' worlds and PROTOs, VRML with Webots' own node types.

A field holds one value or a list of values; which, is the node type's business. Here a tuple of numbers is one value
(a vector, a rotation, a colour), a list is a list of values. Numbers are written with the digits that read back
exactly. Source of the language: docs/reference/proto-definition.md and the node types in resources/nodes of
https://github.com/cyberbotics/webots, R2023b.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

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
