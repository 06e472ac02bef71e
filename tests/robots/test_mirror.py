"""The mirror map of a robot: which joint is whose image, found in the links and checked in MuJoCo's kinematics."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.robots.box_legs import build_model
from stiction.robots.catalog import find_robot
from stiction.robots.mirror import POSITION, match_links, robot_mirror
from stiction.robots.model import LegSpec, RobotSpec
from stiction.robots.tree import Link, links

ROBOTS = ["saturn_lite", "go1"]


@pytest.mark.parametrize("name", ROBOTS)
def test_left_legs_mirror_right_ones(name: str) -> None:
    """Names say L or R, the map never reads them; hips turn about opposite axes, so that no angle changes its sign."""
    robot = find_robot(name)
    mirror = robot_mirror(robot)
    other = [robot.joint_names[number] for number in mirror.joints]
    swap = {"L": "R", "R": "L"}
    assert other == [joint[0] + swap[joint[1]] + joint[2:] for joint in robot.joint_names]
    assert [robot.foot_names[number] for number in mirror.feet] == [f"{other[3 * n][:2]}_foot" for n in mirror.feet ^ 1]
    assert (mirror.sign == 1.0).all()


@pytest.mark.parametrize("name", ROBOTS)
def test_kinematics_of_mirrored_angles_are_mirrored(name: str) -> None:
    """Feet and centres of all links lie where the mirror shows them, at angles far from the standing pose."""
    robot = find_robot(name)
    mirror, model = robot_mirror(robot), build_model(robot)
    data, image = mujoco.MjData(model), mujoco.MjData(model)
    generator = np.random.default_rng(0)
    data.qpos[7:] = generator.uniform(-1.0, 1.0, robot.num_joints)
    image.qpos[7:] = mirror.sign * data.qpos[7:][mirror.joints]
    for state in (data, image):
        state.qpos[:7] = [0, 0, 1, 1, 0, 0, 0]
        mujoco.mj_kinematics(model, state)
    feet = [model.geom(foot).id for foot in robot.foot_names]
    np.testing.assert_allclose(image.geom_xpos[feet], data.geom_xpos[feet][mirror.feet] * POSITION, atol=1e-12)
    bodies = np.array([model.body(link.name).id for link in links(robot)])
    np.testing.assert_allclose(image.xipos[bodies], data.xipos[bodies][mirror.joints] * POSITION, atol=1e-12)


def two_hips(axis: tuple[float, float, float]) -> list[Link]:
    """A left hip about +x and a right one about `axis`, nothing else."""
    left = Link("L", -1, np.array([0.2, 0.1, 0]), np.array([1.0, 0, 0]), 1.0, np.array([0, 0.05, 0]), np.ones(3))
    right = replace(
        left, joint="R", origin=left.origin * POSITION, axis=np.array(axis), com=np.array([0.0, -0.05, 0.0])
    )
    return [left, right]


@pytest.mark.parametrize(("axis", "sign"), [((-1.0, 0.0, 0.0), 1.0), ((1.0, 0.0, 0.0), -1.0)])
def test_the_sign_follows_the_axes(axis: tuple[float, float, float], sign: float) -> None:
    """Two hips that turn about the same axis open to the left and to the right under angles of opposite sign."""
    image, found = match_links(two_hips(axis))
    assert image.tolist() == [1, 0] and found.tolist() == [sign, sign]


@pytest.mark.parametrize(
    "change",
    [
        {"mass": 1.1},
        {"com": np.array([0.0, 0.05, 0.0])},
        {"inertia": np.array([1.0, 1.0, 1.1])},
        {"origin": np.array([0.2, -0.11, 0.0])},
        {"axis": np.array([0.0, 1.0, 0.0])},
    ],
    ids=lambda change: next(iter(change)),
)
def test_a_link_unlike_its_image_is_named(change: dict) -> None:
    """A heavier right leg would be mirrored into a robot that there is not."""
    left, right = two_hips((-1.0, 0.0, 0.0))
    with pytest.raises(StictionError, match="joint 'L' at"):
        match_links([left, replace(right, **change)])


def test_a_leg_without_a_partner_is_named() -> None:
    """Three legs have no mirror; which joint has none is what the user needs to know."""
    robot = find_robot("go1")
    with pytest.raises(StictionError, match=r"'go1' has no left-right mirror: joint 'RL_hip'.*--symmetry none"):
        robot_mirror(replace(robot, legs=robot.legs[:3]))


def test_angles_that_change_sign_need_ranges_that_do() -> None:
    """With hips about the same axis, a range of -0.4 to 0.8 is not its own mirror image."""
    from stiction.robots.mirror import _check_values

    robot = find_robot("saturn_lite")
    mirror = robot_mirror(robot)
    sign = np.where(np.arange(robot.num_joints) % 3 == 0, -1.0, 1.0)
    _check_values(robot, mirror.joints, sign)
    lopsided = replace(robot, hip=replace(robot.hip, lower=-0.4))
    with pytest.raises(StictionError, match=r"joint 'FL_hip' has lower -0.4, the mirror image of 'FR_hip' -0.8"):
        _check_values(lopsided, mirror.joints, sign)


def test_a_gait_that_is_not_its_own_mirror_is_refused() -> None:
    """r_trot of a mirrored walk would differ where one pair of legs shares a group and another does not."""

    def grouped(*groups: int) -> RobotSpec:
        robot = find_robot("go1")
        legs = tuple(LegSpec(leg.name, leg.mount, group) for leg, group in zip(robot.legs, groups, strict=True))
        return replace(robot, legs=legs)

    robot_mirror(grouped(0, 0, 1, 1))
    with pytest.raises(StictionError, match="foot 'RL_foot' and its mirror image"):
        robot_mirror(grouped(0, 0, 0, 1))
