"""Robots as checked data, and their MuJoCo models."""

from __future__ import annotations

import dataclasses
import sys
import types

import mujoco
import numpy as np
import pytest
from boxes import Leg

from stiction.core.errors import StictionError
from stiction.robots.catalog import find_robot, robot_names
from stiction.robots.mjcf import build_model
from stiction.robots.model import Robot, link_poses
from stiction.robots.shapes import Shape, bounds, reach


@pytest.mark.parametrize("name", robot_names())
def test_the_model_is_the_robot(name: str) -> None:
    """Order, tree, masses and motors: a swapped joint would train a policy for another robot."""
    robot = find_robot(name)
    model = build_model(robot)
    assert tuple(model.actuator(i).name for i in range(model.nu)) == robot.joint_names
    assert tuple(model.joint(i + 1).name for i in range(model.nu)) == robot.joint_names
    np.testing.assert_array_equal(model.dof_armature[6:], robot.joint_values("armature"))
    np.testing.assert_array_equal(model.dof_frictionloss[6:], robot.joint_values("frictionloss"))
    np.testing.assert_array_equal(model.jnt_range[1:, 0], robot.joint_values("lower"))
    np.testing.assert_array_equal(model.actuator_forcerange[:, 1], robot.joint_values("torque_limit"))
    assert model.body_mass.sum() == pytest.approx(robot.mass)
    for link in robot.links:
        body = model.body(link.name)
        parent = "base" if link.parent < 0 else robot.links[link.parent].name
        assert model.body(parent).id == body.parentid[0]
        np.testing.assert_allclose(body.pos, link.origin)
        np.testing.assert_allclose(body.ipos, link.com)
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, body.iquat)
        axes = axes.reshape(3, 3)
        np.testing.assert_allclose(axes @ np.diag(body.inertia) @ axes.T, link.inertia_matrix, atol=1e-12)


@pytest.mark.parametrize("name", robot_names())
def test_kinematics_without_mujoco_are_those_of_mujoco(name: str) -> None:
    """Standing height, mirror and contract rest on them."""
    robot = find_robot(name)
    model = build_model(robot)
    data = mujoco.MjData(model)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    data.qpos[7:] = np.random.default_rng(0).uniform(-1, 1, robot.num_joints)
    mujoco.mj_kinematics(model, data)
    position, rotation = link_poses(robot, data.qpos[7:])
    bodies = [model.body(link.name).id for link in robot.links]
    np.testing.assert_allclose(data.xpos[bodies], position, atol=1e-12)
    np.testing.assert_allclose(data.xmat[bodies].reshape(-1, 3, 3), rotation, atol=1e-12)


def test_mass_and_limits_of_saturn_lite_are_the_papers() -> None:
    """Tables I and III: every result in fractions of the torque limit rests on these."""
    robot = find_robot("saturn_lite")
    assert robot.mass == pytest.approx(32.0) and robot.num_joints == 18
    assert tuple(robot.joint_values("torque_limit")[:3]) == (25.0, 25.0, 45.0)
    shank = robot.joints[2]
    assert (shank.armature, shank.damping, shank.frictionloss) == (0.0145, 0.0704, 0.442)


def test_a_right_leg_by_hand() -> None:
    """FR of Saturn Lite: its hip turns about -x, its thigh begins 8 cm further out, its knee is 22 cm down."""
    hip, thigh, shank = find_robot("saturn_lite").links[3:6]
    assert [part.parent for part in (hip, thigh, shank)] == [-1, 3, 4]
    assert [part.name for part in (hip, thigh, shank)] == ["FR_hip_link", "FR_thigh_link", "FR_shank_link"]
    assert (hip.axis, thigh.axis) == ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    assert [part.origin for part in (hip, thigh, shank)] == [(0.31, -0.11, 0), (0, -0.08, 0), (0, 0, -0.22)]
    # 0.4 kg / 12 times squares of 0.035, 0.035 and 0.24 m, two at a time.
    np.testing.assert_allclose(shank.inertia[:3], [0.4 / 12 * 0.058825, 0.4 / 12 * 0.058825, 0.4 / 12 * 0.00245])


def test_a_robot_of_ones_own_touches_no_other_file(monkeypatch: pytest.MonkeyPatch) -> None:
    """Named as module:VARIABLE, an eight-legged robot is found and built."""
    import saturn_lite

    legs = [Leg(f"L{i}", (0.5 - 0.3 * i, 0.05, 0.0), i % 2) for i in range(4)]
    legs += [Leg(f"R{i}", (0.5 - 0.3 * i, -0.05, 0.0), 1 - i % 2) for i in range(4)]
    module = types.ModuleType("my_robots")
    module.SPIDER = dataclasses.replace(saturn_lite.BOXES, name="spider", legs=tuple(legs)).robot()
    module.spider = lambda: module.SPIDER
    module.spec = lambda: mujoco.MjSpec.from_string(PENDULUM)
    module.NOTHING = 3
    monkeypatch.setitem(sys.modules, "my_robots", module)
    assert build_model(find_robot("my_robots:SPIDER")).nu == 24
    assert find_robot("my_robots:spider") is module.SPIDER
    assert find_robot("my_robots:spec").joint_names == ("knee",)
    with pytest.raises(StictionError, match="expected a Robot"):
        find_robot("my_robots:NOTHING")


PENDULUM = """<mujoco><worldbody><body name="trunk"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<geom name="box" type="box" size=".1 .1 .1"/><body name="leg" pos="0 0 -.1"><joint name="knee" axis="0 1 0"
range="-1 1" armature=".01" actuatorfrcrange="-5 5"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 -.3"/></body>
</body></worldbody><compiler angle="radian"/></mujoco>"""


def test_a_variation_by_hand() -> None:
    """Gains kp times 4 and kd times 2 keep kd / (2 sqrt(kp J)); limits double; actions halve; everything else stays."""
    plain, varied = find_robot("go1"), find_robot("go1@kp=4,torque=2,action=.5")
    for name, factor in (("kp", 4.0), ("kd", 2.0), ("torque_limit", 2.0), ("action_scale", 0.5), ("armature", 1.0)):
        np.testing.assert_allclose(varied.joint_values(name), factor * plain.joint_values(name))
    assert varied.name == "go1@kp=4,torque=2,action=.5" and varied.base == plain.base


def altered(robot: Robot, **fields: float) -> Robot:
    """Return a robot whose first joint has other values."""
    return dataclasses.replace(robot, joints=(dataclasses.replace(robot.joints[0], **fields), *robot.joints[1:]))


def test_impossible_robots_are_refused() -> None:
    """A pose outside the limits, one contact group only, a motor without torque, two joints of one name."""
    go1 = find_robot("go1")
    with pytest.raises(StictionError, match="stands at 2 rad, outside"):
        altered(go1, default_position=2.0)
    with pytest.raises(StictionError, match="armature of joint 'FR_hip_joint' is 0"):
        altered(go1, armature=0.0)
    with pytest.raises(StictionError, match="group"):
        dataclasses.replace(go1, feet=tuple(dataclasses.replace(foot, group=0) for foot in go1.feet))
    with pytest.raises(StictionError, match="different names"):
        altered(go1, name="FL_hip_joint")
    with pytest.raises(StictionError, match="comes before"):
        dataclasses.replace(go1, links=(dataclasses.replace(go1.links[0], parent=5), *go1.links[1:]))


def test_reach_and_bounds_by_hand() -> None:
    """A capsule that lies along x reaches its half length and its radius; a box turned by 45° its half diagonal."""
    half = 2**-0.5
    lying = Shape("capsule", (0.1, 0.5, 0.0), (1.0, 0.0, 0.0), (half, 0.0, half, 0.0))
    assert reach(lying, np.array([1.0, 0.0, 0.0])) == pytest.approx(1.6)
    assert reach(lying, np.array([0.0, 0.0, -1.0])) == pytest.approx(0.1)
    turned = Shape("box", (0.1, 0.1, 0.3), quaternion=(np.cos(np.pi / 8), 0.0, 0.0, np.sin(np.pi / 8)))
    assert reach(turned, np.array([1.0, 0.0, 0.0])) == pytest.approx(0.1 * 2**0.5)
    hull = Shape("hull", (0.0, 0.0, 0.0), vertices=((0.0, 0.0, 0.0), (0.2, 0.0, 0.0), (0.0, 0.3, 0.0), (0.0, 0.0, 0.4)))
    low, high = bounds([lying, hull])
    np.testing.assert_allclose(low, [0.0, -0.1, -0.1], atol=1e-12)
    np.testing.assert_allclose(high, [1.6, 0.3, 0.4], atol=1e-12)
    disc = Shape("cylinder", (0.2, 0.05, 0.0))
    assert reach(disc, np.array([0.6, 0.0, 0.8])) == pytest.approx(0.2 * 0.6 + 0.05 * 0.8)
