"""The drawing: who is where in the picture, in which colour, and what stands on the static page."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("viser", reason="the viewer needs the extra view")
pytest.importorskip("mjviser", reason="the viewer needs the extra view")

from stiction.robots.catalog import find_robot
from stiction.view.plots import reward_bars
from stiction.view.scene import COLORS, DIRECTION, FIELD_OF_VIEW, SLACK, RobotBodies, camera_distance, treadmill


def test_robots_that_fall_behind_stay_in_the_picture() -> None:
    """Differences up to the slack are drawn as they are, a robot 30 m behind at the slack."""
    places = np.array([[30.0, 0.0], [29.7, 0.1], [0.0, -5.0]])
    shown = treadmill(places, np.array([29.7, 0.1]))
    np.testing.assert_allclose(shown, [[0.3, -0.1], [0.0, 0.0], [-SLACK[0], -SLACK[1]]])


def test_the_camera_sees_every_corner_and_a_narrow_page_needs_more_distance() -> None:
    """Each corner of the box is within the field of view at the distance, one on its edge; by projection."""
    half = np.array([1.0, 2.0, 0.3])
    for aspect in (0.4, 1.0, 1.8):
        eye = camera_distance(half, aspect) * DIRECTION
        right = np.cross([0.0, 0.0, 1.0], DIRECTION)
        right, up = right / np.linalg.norm(right), np.cross(DIRECTION, right / np.linalg.norm(right))
        corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        depth = (eye - corners) @ DIRECTION
        angles = np.abs([np.arctan2(corners @ up, depth), np.arctan2(corners @ right, depth * aspect)])
        assert angles.max() == pytest.approx(FIELD_OF_VIEW / 2)
    assert camera_distance(half, 0.4) > 2 * camera_distance(half, 1.8)


def test_bodies_have_the_colours_of_their_policies() -> None:
    """The trunk of each robot has its policy's hue, and the robots stand where their states say."""
    spec = find_robot("saturn_lite")
    bodies = RobotBodies(spec, COLORS[:2])
    for name, color in (("base", COLORS[0]), ("1/base", COLORS[1])):
        rgb = bodies.model.geom(name).rgba[:3]
        np.testing.assert_allclose(rgb / rgb.max(), np.array(color) / max(color), atol=1e-6)
    joints = spec.joint_values("default_position")
    states = np.array([[1.0, 0.0, 0.4, 1, 0, 0, 0, *joints], [0.0, 2.0, 0.5, 1, 0, 0, 0, *joints]])
    places, _ = bodies.poses(states)
    for number, name in enumerate(("base", "1/base")):
        np.testing.assert_allclose(places[bodies.model.body(name).id], states[number, :3])


def test_reward_bars_are_in_proportion_and_escaped() -> None:
    """The largest term fills half of the row, a cost lies left of the middle, and names are no HTML."""
    html = reward_bars({"<b>": ("rgb(1, 2, 3)", {"track": 2.0, "torque": -0.5})}, "#222222")
    assert "width:50.0%;margin-left:50.0%" in html and "width:12.5%;margin-left:37.5%" in html
    assert "&lt;b&gt;" in html and "<b>:" not in html
