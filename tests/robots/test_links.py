"""Links as data: the robot that other engines build is the one that MuJoCo builds."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.robots.build import build_model
from stiction.robots.catalog import find_robot
from stiction.robots.links import foot_position, links


@pytest.mark.parametrize("name", ["saturn_lite", "go1"])
def test_links_are_those_of_the_mujoco_model(name: str) -> None:
    """Another tree would be another robot, and the difference between engines ours."""
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
