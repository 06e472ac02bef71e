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
        (("version",), 2, "no robot of version 1"),
        (("name",), 3, "name is '3'; expected text"),
        (("base", "mass"), "heavy", "base: mass is heavy; expected a finite number"),
        (("links", 0, "origin"), [1, 2], r"links\[0\]: origin is .* expected a list of 3"),
        (("joints", 1, "kp"), float("nan"), r"joints\[1\]: kp is nan"),
        (("joints", 1, "armature"), 0, "armature of joint"),
        (("links", 0, "parent"), 7, "comes before"),
        (("feet", 0, "shapes", 0, "kind"), "cone", "is 'cone'; expected sphere"),
        (("extra",), 1, "has no field 'extra'"),
        (("joints",), None, "joints is None"),
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


def test_what_is_missing_or_no_json_is_named(tmp_path: Path) -> None:
    """Half a file is none."""
    file = tmp_path / "robot.json"
    with pytest.raises(StictionError, match="cannot read"):
        read_robot(file)
    file.write_text('{"version": 1')
    with pytest.raises(StictionError, match="no JSON"):
        read_robot(file)
    file.write_text('{"version": 1}')
    with pytest.raises(StictionError, match="field 'name' is missing"):
        read_robot(file)
