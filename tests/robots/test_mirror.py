"""The mirror map of a robot: which joint is whose image, found in the links and checked in MuJoCo's kinematics."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.robots.catalog import find_robot
from stiction.robots.mirror import POSITION, match_links, robot_mirror
from stiction.robots.mjcf import build_model
from stiction.robots.model import Link, Robot

ROBOTS = ["saturn_lite", "go1", "go2", "g1"]


def test_left_legs_mirror_right_ones() -> None:
    """Names say L or R, the map never reads them; these hips turn about opposite axes: no angle changes its sign."""
    robot = find_robot("saturn_lite")
    mirror = robot_mirror(robot)
    other = [robot.joint_names[number] for number in mirror.joints]
    swap = {"L": "R", "R": "L"}
    assert other == [joint[0] + swap[joint[1]] + joint[2:] for joint in robot.joint_names]
    assert mirror.feet.tolist() == [1, 0, 3, 2, 5, 4]
    assert (mirror.sign == 1.0).all()


def test_the_makers_hips_change_their_sign() -> None:
    """All hips of a Go1 turn about +x: what opens a left leg closes a right one. On G1 roll and yaw do so."""
    mirror = robot_mirror(find_robot("go1"))
    assert mirror.sign.tolist() == [-1.0, 1.0, 1.0] * 4
    assert mirror.joints.tolist() == [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]
    legs = robot_mirror(find_robot("g1"))
    assert legs.sign.tolist() == [1.0, -1.0, -1.0, 1.0, 1.0, -1.0] * 2


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
    # Machines are built symmetric to a tenth of a millimetre, in their drawings too.
    np.testing.assert_allclose(image.geom_xpos[feet], data.geom_xpos[feet][mirror.feet] * POSITION, atol=2e-4)
    bodies = np.array([model.body(link.name).id for link in robot.links])
    np.testing.assert_allclose(image.xipos[bodies], data.xipos[bodies][mirror.joints] * POSITION, atol=3e-3)


def two_hips(axis: tuple[float, float, float]) -> list[Link]:
    """A left hip about +x and a right one about `axis`, nothing else."""
    left = Link(
        1.0, (0.0, 0.05, 0.0), (1.0, 1.0, 1.0, 0.1, 0.0, 0.2), name="left", origin=(0.2, 0.1, 0), axis=(1, 0, 0)
    )
    inertia = (1.0, 1.0, 1.0, -0.1, 0.0, -0.2)
    right = replace(left, name="right", origin=(0.2, -0.1, 0), axis=axis, com=(0.0, -0.05, 0.0), inertia=inertia)
    return [left, right]


@pytest.mark.parametrize(
    "change",
    [
        {"mass": 1.1},
        {"com": (0.0, 0.05, 0.0)},
        {"inertia": (1.0, 1.0, 2.0, -0.1, 0.0, -0.2)},
        {"origin": (0.2, -0.11, 0.0)},
        {"axis": (0.0, 1.0, 0.0)},
    ],
    ids=lambda change: next(iter(change)),
)
def test_a_link_unlike_its_image_is_named(change: dict) -> None:
    """A heavier right leg would be mirrored into a robot that there is not."""
    left, right = two_hips((-1.0, 0.0, 0.0))
    with pytest.raises(StictionError, match="joint 'L' at"):
        match_links([left, replace(right, **change)], ("L", "R"))


def test_what_was_said_is_verified() -> None:
    """A mirror that was written down swaps wrong joints as easily as a wrong sign does."""
    robot = find_robot("go1")
    swapped = ("FL_hip_joint", "FL_thigh_joint", "FL_calf_joint", "FR_hip_joint", "FR_thigh_joint", "FR_calf_joint")
    images = (
        *swapped,
        "RL_hip_joint",
        "RL_thigh_joint",
        "RL_calf_joint",
        "RR_hip_joint",
        "RR_thigh_joint",
        "RR_calf_joint",
    )
    mirror = robot_mirror(replace(robot, mirror_names=images))
    assert mirror.joints.tolist() == robot_mirror(robot).joints.tolist()
    with pytest.raises(StictionError, match=r"joint 'FR_hip_joint' .* 0 joints named 'RL_hip_joint'"):
        robot_mirror(replace(robot, mirror_names=("RL_hip_joint", *images[1:])))
    with pytest.raises(StictionError, match="says mirror: none"):
        robot_mirror(replace(robot, mirror_names=()))


@pytest.mark.parametrize("field", ["kp", "kd", "torque_limit", "action_scale"])
def test_values_are_mirrored_up_to_their_rounding(field: str) -> None:
    """4 in 100,000, as 0.50002 for 0.5, or as gains that follow from rounded inertias; not two per cent."""
    go1 = find_robot("go1")

    def altered(factor: float) -> Robot:
        first = go1.joints[0]
        return replace(go1, joints=(replace(first, **{field: factor * getattr(first, field)}), *go1.joints[1:]))

    assert robot_mirror(altered(1.00004)).joints.tolist() == robot_mirror(altered(1.005)).joints.tolist()
    with pytest.raises(StictionError, match=field):
        robot_mirror(altered(1.02))
