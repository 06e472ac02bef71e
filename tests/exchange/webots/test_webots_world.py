"""The exported worlds: contacts, rates, friction, and the stairs of the training's courses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bundles import make_contract
from stiction.exchange.webots.proto import proto_name, write_proto
from stiction.exchange.webots.world import joint_friction, write_world
from stiction.robots.catalog import find_robot
from stiction.robots.shapes import reach
from stiction.robots.terrain import REACH, stair_height
from webots_files import Read, read_world
from webots_kinematics import place


def world(
    tmp_path: Path, robot: str = "saturn_lite", level: float = 0.2, step_height: float = 0.0, **contract
) -> list[Read]:
    """Write a robot's PROTO and a world, and read the world's nodes back."""
    spec, contract = find_robot(robot), make_contract(robot, **contract)
    for folder in ("protos", "worlds"):
        (tmp_path / folder).mkdir(exist_ok=True)
    (tmp_path / f"protos/{proto_name(robot)}.proto").write_text(write_proto(spec, contract))
    text = write_world(spec, contract.physics_timestep, joint_friction(spec, level), step_height)
    (tmp_path / "worlds/world.wbt").write_text(text)
    return read_world(tmp_path / "worlds/world.wbt")


def only(nodes: list[Read], kind: str) -> Read:
    """Return the one node of a type at the top of a world."""
    (node,) = [node for node in nodes if node.kind == kind]
    return node


def test_contacts_do_not_bounce_and_the_step_is_that_of_training(tmp_path: Path) -> None:
    """Feet do not bounce (Webots' default is 0.5), and the step is the contract's."""
    info = only(world(tmp_path, physics_timestep=0.004, control_period=0.016), "WorldInfo")
    assert (info["basicTimeStep"], info["physics"]) == (4.0, "rotor_inertia")
    (contact,) = info["contactProperties"]
    assert (contact["bounce"], contact["coulombFriction"]) == (0.0, [1.0])
    assert "material1" not in contact.fields  # of any two surfaces: no solid names another material
    assert info["physicsDisableLinearThreshold"] == info["physicsDisableAngularThreshold"] == 0.0


@pytest.mark.parametrize(
    ("name", "step_height"), [("saturn_lite", 0.0), ("saturn_lite", 0.12), ("go2", 0.0), ("g1", 0.1)]
)
def test_the_robot_stands_on_its_feet_before_the_stairs(tmp_path: Path, name: str, step_height: float) -> None:
    """The robot starts standing before the stairs, under the name known to the plugin."""
    nodes = world(tmp_path, name, step_height=step_height)
    robot, spec = only(nodes, "Robot"), find_robot(name)
    assert (robot.define, robot["controller"]) == ("ROBOT", "<extern>")
    assert only(nodes, "Viewpoint")["follow"] == robot["name"]
    assert robot["translation"][0] == (0.0 if step_height == 0.0 else -(REACH + 0.7))
    links, down = place(robot, {}), np.array([0.0, 0.0, -1.0])
    for foot in spec.feet:
        link = links[spec.links[foot.link].name]
        low = link.origin[2] - max(reach(shape, down @ link.rotation) for shape in foot.shapes)
        assert low == pytest.approx(0.0, abs=1e-12 if name == "saturn_lite" else 1e-6)


def boxes(nodes: list[Read]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return middles and half sizes of the boxes that nothing moves [m]."""
    solids = [node for node in nodes if node.kind == "Solid"]
    assert all("physics" not in node.fields and "rotation" not in node.fields for node in solids)
    shapes = [node["children"][0]["geometry"]["size"] for node in solids]
    assert [node["boundingObject"]["size"] for node in solids] == shapes  # what is seen is what collides
    return [(np.array(node["translation"]), np.array(size) / 2) for node, size in zip(solids, shapes, strict=True)]


@pytest.mark.parametrize("step_height", [0.0, 0.1, 0.2])
def test_the_ground_has_the_heights_of_the_course(tmp_path: Path, step_height: float) -> None:
    """The heights of the stairs are the course's."""
    points = np.random.default_rng(0).uniform(-4, 4, (1, 2000, 2))
    top = np.full(points.shape[1], -np.inf)
    for middle, half in boxes(world(tmp_path, step_height=step_height)):
        inside = (np.abs(points[0] - middle[:2]) <= half[:2]).all(-1)
        top = np.maximum(top, np.where(inside, middle[2] + half[2], -np.inf))
    np.testing.assert_allclose(top, stair_height(points, np.array([[step_height]]))[0], atol=1e-12)
    assert np.unique(np.round(top, 9)).size == (7 if step_height else 1)
