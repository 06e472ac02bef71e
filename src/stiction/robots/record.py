"""A robot as JSON, which travels with a run and its policy: complete, and read back with nothing but NumPy.

Whoever reads a file of somebody else's gets a robot or one sentence: every value has the type of its field, numbers are
finite, and there are at most `MOST_BYTES` of them.
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
"""Size of the largest file that is read."""

VERSION = 1
"""Of the layout of the file."""


@dataclass(frozen=True)
class Origin:
    """Where one value of a robot came from."""

    subject: str
    """Joint, or part of the robot."""
    field: str
    value: str
    source: str
    """`file`, `robot.yaml`, or the rule."""


@dataclass(frozen=True)
class Derived:
    """A robot, and what is known of how it came about."""

    robot: Robot
    origins: tuple[Origin, ...] = ()
    notes: tuple[str, ...] = ()
    """What was left out, mended or not believed, a sentence each."""


def write_robot(robot: Robot, path: Path) -> None:
    """Write a robot to a JSON file."""
    content = {"version": VERSION, **asdict(robot)}
    write_text(path, json.dumps(content, indent=1) + "\n")


def read_robot(path: Path) -> Robot:
    """Return the robot of a JSON file.

    Raises `RobotError` naming the entry that is wrong.
    """
    text = read_bounded(path, "a robot", RobotError, MOST_BYTES)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RobotError(f"{path}: is no JSON: {error}") from error
    if not isinstance(content, dict) or content.pop("version", None) != VERSION:
        raise RobotError(f"{path}: is no robot of version {VERSION}; write it with this version of stiction")
    return from_plain(Robot, content, str(path), RobotError)
