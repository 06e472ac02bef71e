"""A robot as JSON: complete, and a file that was altered is named, not believed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from stiction.core.errors import StictionError
from stiction.robots.catalog import find_robot, robot_names
from stiction.robots.record import read_robot, write_robot


@pytest.mark.parametrize("name", robot_names())
def test_it_comes_back_to_the_last_digit(name: str, tmp_path: Path) -> None:
    """A policy is judged on the robot that it was trained for."""
    write_robot(find_robot(name), tmp_path / "robot.json")
    assert read_robot(tmp_path / "robot.json") == find_robot(name)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("version",), 2, "not a robot of version 1"),
        (("links", 0, "origin"), [1, 2], r"links\[0\]: origin is .* expected a list of 3"),
        (("joints", 1, "kp"), float("nan"), r"joints\[1\]: kp is nan"),
        (("joints", 1, "armature"), 0, "armature of joint"),
        (("links", 0, "parent"), 7, "comes before"),
        (("extra",), 1, "has no field 'extra'"),
    ],
)
def test_what_was_altered_is_named(path: tuple, value: object, message: str, tmp_path: Path) -> None:
    """A robot that cannot be would be simulated, or fail with a traceback far from here."""
    file = tmp_path / "robot.json"
    write_robot(find_robot("go1"), file)
    content = json.loads(file.read_text())
    inner = content
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    file.write_text(json.dumps(content))
    with pytest.raises(StictionError, match=message):
        read_robot(file)
