"""A robot as JSON, which travels with a run and its policy: complete, and read back with nothing but NumPy.

Whoever reads a file of somebody else's gets a robot or one sentence: every value has the type of its field, numbers are
finite, and there are at most `MOST_BYTES` of them.
"""

from __future__ import annotations

import json
import math
from dataclasses import MISSING, asdict, fields, is_dataclass
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from stiction.core.errors import RobotError
from stiction.robots.model import Robot

MOST_BYTES = 8 * 2**20
"""Size of the largest file that is read."""

VERSION = 1
"""Of the layout of the file."""


def write_robot(robot: Robot, path: Path) -> None:
    """Write a robot to a JSON file."""
    content = {"version": VERSION, **asdict(robot)}
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def read_robot(path: Path) -> Robot:
    """Return the robot of a JSON file.

    Raises `RobotError` naming the entry that is wrong.
    """
    try:
        size = path.stat().st_size
        if size > MOST_BYTES:
            raise RobotError(f"{path}: {size} bytes; at most {MOST_BYTES} are read")
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RobotError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise RobotError(f"{path}: is no JSON: {error}") from error
    if not isinstance(content, dict) or content.pop("version", None) != VERSION:
        raise RobotError(f"{path}: is no robot of version {VERSION}; write it with this version of stiction")
    return robot_from(content, str(path))


def robot_from(content: Any, where: str) -> Robot:
    """Return the robot of plain data, as `asdict` makes it; `where`: it came from, for messages.

    Raises `RobotError` naming the entry that is wrong.
    """
    robot = _as(Robot, content, where)
    assert isinstance(robot, Robot)
    return robot


def _as(kind: Any, value: Any, where: str) -> Any:
    """Return a value of JSON as the type of a field.

    Raises `RobotError` naming where it is another.
    """
    origin, inner = get_origin(kind), get_args(kind)
    if is_dataclass(kind):
        return _record(kind, value, where)
    if origin in (Union, UnionType):
        if value is None and type(None) in inner:
            return None
        return _as(next(item for item in inner if item is not type(None)), value, where)
    if origin is tuple:
        if not isinstance(value, list) or (inner[-1] is not Ellipsis and len(value) != len(inner)):
            raise RobotError(
                f"{where} is {str(value)[:60]}; expected a list"
                + ("" if inner[-1] is Ellipsis else f" of {len(inner)}")
            )
        kinds = [inner[0]] * len(value) if inner[-1] is Ellipsis else inner
        return tuple(
            _as(item, entry, f"{where}[{number}]")
            for number, (item, entry) in enumerate(zip(kinds, value, strict=True))
        )
    if origin is Literal:
        if value not in inner:
            raise RobotError(f"{where} is {value!r}; expected {', '.join(map(str, inner))}")
        return value
    if kind is float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise RobotError(f"{where} is {str(value)[:60]}; expected a finite number")
        return float(value)
    if isinstance(value, bool) or not isinstance(value, kind):
        raise RobotError(f"{where} is {str(value)[:60]!r}; expected {kind.__name__}")
    return value


def _record(kind: Any, value: Any, where: str) -> Any:
    """Return a mapping of JSON as a dataclass."""
    if not isinstance(value, dict):
        raise RobotError(f"{where} is {str(value)[:60]}; expected the fields of {kind.__name__}")
    hints = get_type_hints(kind)
    known = {item.name: item for item in fields(kind)}
    for name in value:
        if name not in known:
            raise RobotError(f"{where}: {kind.__name__} has no field {name!r}")
    for name, item in known.items():
        if name not in value and item.default is MISSING and item.default_factory is MISSING:
            raise RobotError(f"{where}: {name} of {kind.__name__} is missing")
    return kind(**{name: _as(hints[name], entry, f"{where}: {name}") for name, entry in value.items()})
