"""Robot as JSON, stored with a run and its policy: complete, and readable with NumPy alone.

Reading a file gives a robot or an error of one sentence: every value has the type of its field, numbers are finite, and
the file has at most `MOST_BYTES`.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from stiction.core.decode import from_plain
from stiction.core.errors import RobotError
from stiction.core.files import read_bounded, write_text
from stiction.robots.model import Robot

MOST_BYTES = 8 * 2**20
"""Maximum size of a file [B]."""

VERSION = 1
"""Version of the layout of the file."""


@dataclass(frozen=True)
class Origin:
    """Origin of one value of a robot."""

    subject: str
    """Joint, or part of the robot."""
    field: str
    value: str
    source: str
    """`file`, `robot.yaml`, or the rule."""


@dataclass(frozen=True)
class Derived:
    """Robot, and the origins of its values."""

    robot: Robot
    origins: tuple[Origin, ...] = ()
    notes: tuple[str, ...] = ()
    """Omissions, corrections and rejected values, a sentence each."""


def write_robot(robot: Robot, path: Path) -> None:
    """Write a robot to a JSON file."""
    content = {"version": VERSION, **asdict(robot)}
    write_text(path, json.dumps(content, indent=1) + "\n")


def read_robot(path: Path) -> Robot:
    """Return the robot of a JSON file.

    Raises `RobotError` naming the invalid entry.
    """
    text = read_bounded(path, "a robot", RobotError, MOST_BYTES)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RobotError(f"{path}: is not JSON: {error}") from error
    if not isinstance(content, dict) or content.pop("version", None) != VERSION:
        raise RobotError(f"{path}: is not a robot of version {VERSION}; write it with this version of stiction")
    return from_plain(Robot, content, str(path), RobotError)
