"""A shipped robot's name stands for its numbers; a robot of any name is one that can be built."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from stiction.core.errors import RobotError
from stiction.robots.catalog import find_robot, robot_names
from stiction.robots.model import Robot, with_standing_height
from stiction.robots.named import check_named, reordered

GO2 = find_robot("go2")


def with_vendor(**changes) -> Robot:
    """Return a Go2 with another protocol of its maker."""
    assert GO2.vendor is not None
    return replace(GO2, vendor=replace(GO2.vendor, **changes))


def with_joint(**changes) -> Robot:
    """Return a Go2 with another first joint."""
    return replace(GO2, joints=(replace(GO2.joints[0], **changes), *GO2.joints[1:]))


def with_link(**changes) -> Robot:
    """Return a Go2 with another first link."""
    return replace(GO2, links=(replace(GO2.links[0], **changes), *GO2.links[1:]))


@pytest.mark.parametrize("name", [*robot_names(), "go2@kp=0.5,torque=2"])
def test_a_shipped_robot_is_itself(name: str) -> None:
    """Accepts every shipped robot, varied ones too, and all their bodies are physical."""
    robot = find_robot(name)
    check_named(robot)
    assert robot.base.is_physical and all(link.is_physical for link in robot.links)


@pytest.mark.parametrize(
    ("robot", "field"),
    [
        (with_vendor(sign=(-1.0, *(1.0,) * 11)), "vendor.sign[0] -1, the shipped go2 has 1;"),
        (with_vendor(offset=(0.3, *(0.0,) * 11)), "vendor.offset[0] 0.3, the shipped go2 has 0;"),
        (with_vendor(order=GO2.joint_names[::-1]), "vendor.order[0]"),
        (replace(GO2, base=GO2.base.scaled(10)), "base.mass 69.21, the shipped go2 has 6.921"),
        (with_link(axis=(-1.0, 0.0, 0.0)), "links[0].axis[0] -1, the shipped go2 has 1;"),
        (with_joint(kp=41.0), "joints[0].kp 41, the shipped go2 has 40;"),
    ],
)
def test_other_numbers_need_another_name(robot: Robot, field: str) -> None:
    """Names the first field that differs; the same robot passes under another name."""
    with pytest.raises(RobotError) as caught:
        check_named(robot)
    assert f"got {field}" in str(caught.value) and "give the robot another name" in str(caught.value)
    check_named(replace(robot, name="my_go2"))


def test_a_policy_of_others_lowers_gains_and_raises_none() -> None:
    """Accepts another order of joints, another pose and lower gains; rejects a higher limit and another height."""
    # Of each leg knee last, legs from the rear on.
    turned = reordered(GO2, [*GO2.joint_names[6:], *GO2.joint_names[:6]])
    joints = tuple(replace(joint, kp=20.0, default_position=joint.default_position + 0.1) for joint in turned.joints)
    check_named(with_standing_height(replace(turned, joints=joints)), elsewhere=True)
    with pytest.raises(RobotError, match=r"torque_limit 24, the shipped go2 has at most 23.7"):
        check_named(with_joint(torque_limit=24.0), elsewhere=True)
    with pytest.raises(RobotError, match="standing_height"):
        check_named(replace(GO2, standing_height=2.0), elsewhere=True)


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: with_vendor(sign=(2.0, *(1.0,) * 11)), "expected different joints, and 1 or -1"),
        (lambda: with_vendor(sign=(1.0,) * 11), "expected different joints, and 1 or -1"),
        (lambda: with_vendor(order=(GO2.joint_names[0],) * 12), "expected different joints"),
        (lambda: with_vendor(order=("knee", *GO2.joint_names[1:])), "vendor.order is"),
        (lambda: with_vendor(offset=(7.0, *(0.0,) * 11)), "angles from -2π to 2π"),
        (lambda: with_link(axis=(2.0, 0.0, 0.0)), "expected unit length"),
        (lambda: replace(GO2, feet=(replace(GO2.feet[0], link=12), *GO2.feet[1:])), "belongs to no link"),
    ],
)
def test_no_robot_of_any_name_is_impossible(made: Callable[[], Robot], message: str) -> None:
    """Rejects protocols that map no angles, axes that are no directions, and feet on nothing."""
    with pytest.raises(RobotError, match=message):
        made()


def test_only_bodies_have_inertias() -> None:
    """By hand: 1, 1 and 1.9 kg m² are those of some body; 2.1 exceeds the sum of the others, -1 nothing has."""
    for moment, physical in ((1.9, True), (2.1, False), (-1.0, False), (0.0, False)):
        assert replace(GO2.base, inertia=(1.0, 1.0, moment, 0.0, 0.0, 0.0)).is_physical is physical
    # Off the diagonal: moments 1 - 0.9, 1 + 0.9 and 1.
    assert not replace(GO2.base, inertia=(1.0, 1.0, 1.0, 0.9, 0.0, 0.0)).scaled(1.0).is_physical
    assert not replace(GO2.base, mass=0.0).is_physical
