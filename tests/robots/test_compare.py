"""A policy's robot against somebody's model of it: a sign, a limit, a mass that is not the same is named by joint."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot_files import MJCF, write
from stiction.core.errors import StictionError
from stiction.robots.catalog import find_robot
from stiction.robots.compare import check_against
from stiction.robots.load import load_robot
from stiction.robots.mjcf import build


@pytest.mark.parametrize("name", ["go1", "g1", "saturn_lite"])
def test_a_robot_agrees_with_its_own_model(name: str, tmp_path: Path) -> None:
    """Agrees with itself after it is written to a file and read again."""
    robot = find_robot(name)
    (tmp_path / "robot.xml").write_text(build(robot).to_xml())
    assert check_against(robot, tmp_path / "robot.xml") == robot.num_joints


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'name="FL_thigh_joint" axis="0 1 0"',
            'name="FL_thigh_joint" axis="0 -1 0"',
            "'FL_thigh_joint' turns the other",
        ),
        ('range="-2.8 -0.8"', 'range="-2.8 -1"', "'FL_calf_joint' has the limits -2.8 to -1"),
        ('mass="1"', 'mass="1.2"', "the link behind joint 'FL_thigh_joint' weighs 1.2 kg"),
        ('pos="0.2 0.05 0"', 'pos="0.22 0.05 0"', "'FL_hip_joint' is at"),
        ("FL_hip_joint", "FL_abad", "unknown joint 'FL_hip_joint'"),
    ],
)
def test_what_differs_is_named(old: str, new: str, message: str, tmp_path: Path) -> None:
    """One joint that turns the other way falls the robot in its first step, and looks like a bad policy."""
    robot = load_robot(write(tmp_path)).robot
    assert old in MJCF
    other = tmp_path / "other.xml"
    other.write_text(MJCF.replace(old, new) if old == "FL_hip_joint" else MJCF.replace(old, new, 1))
    with pytest.raises(StictionError, match=message):
        check_against(robot, other)
