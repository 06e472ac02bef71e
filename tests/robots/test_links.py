"""Links as data: the robot that other engines build is the one that MuJoCo builds."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.robots.box_legs import build_model
from stiction.robots.catalog import find_robot
from stiction.robots.tree import foot_position, links


def test_a_right_leg_by_hand() -> None:
    """FR of Saturn Lite: its hip turns about -x, its thigh begins 8 cm further out, its knee is 22 cm down."""
    hip, thigh, shank = links(find_robot("saturn_lite"))[3:6]
    assert [part.parent for part in (hip, thigh, shank)] == [-1, 3, 4]
    assert [part.name for part in (hip, thigh, shank)] == ["FR_hip_link", "FR_thigh_link", "FR_shank_link"]
    assert (hip.axis.tolist(), thigh.axis.tolist()) == ([-1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    assert [part.origin.tolist() for part in (hip, thigh, shank)] == [[0.31, -0.11, 0], [0, -0.08, 0], [0, 0, -0.22]]
    assert [part.com.tolist() for part in (hip, thigh, shank)] == [[0, -0.04, 0], [0, 0, -0.11], [0, 0, -0.12]]
    # 0.4 kg / 12 times squares of 0.035, 0.035 and 0.24 m, two at a time.
    np.testing.assert_allclose(shank.inertia, [0.4 / 12 * 0.058825, 0.4 / 12 * 0.058825, 0.4 / 12 * 0.00245])


def test_links_and_trunk_weigh_what_the_robot_does() -> None:
    """A leg left out would make another robot."""
    spec = find_robot("go1")
    assert len(links(spec)) == spec.num_joints
    assert abs(spec.base.mass + sum(link.mass for link in links(spec)) - 12.0) < 1e-12


@pytest.mark.parametrize("name", ["saturn_lite", "go1"])
def test_links_are_those_of_the_mujoco_model(name: str) -> None:
    """Another order or another parent in MuJoCo would be another robot there."""
    spec = find_robot(name)
    model = build_model(spec)
    assert tuple(link.joint for link in links(spec)) == spec.joint_names
    for number, link in enumerate(links(spec)):
        body, joint = model.body(link.name), model.joint(link.joint)
        assert joint.bodyid[0] == body.id
        above = "base" if link.parent < 0 else links(spec)[link.parent].name
        assert model.body(above).id == body.parentid[0] and link.parent < number
        np.testing.assert_allclose(link.origin, body.pos)
        np.testing.assert_allclose(link.axis, joint.axis)
        np.testing.assert_allclose(link.mass, body.mass[0])
        np.testing.assert_allclose(link.com, body.ipos)
        np.testing.assert_allclose(link.inertia, body.inertia)
        np.testing.assert_allclose(body.iquat, [1.0, 0.0, 0.0, 0.0])
    for foot in spec.foot_names:
        np.testing.assert_allclose(model.geom(foot).pos, foot_position(spec))
