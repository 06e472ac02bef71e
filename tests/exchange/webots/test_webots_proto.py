"""The exported robot is the robot: held against its `Robot`, and link by link against its MuJoCo model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bundles import make_contract
from stiction.exchange.webots.proto import FARTHEST, proto_name, stops, write_proto
from stiction.robots.catalog import find_robot
from stiction.robots.model import Robot
from stiction.robots.shapes import Shape
from webots_files import Bound, Read, read_proto
from webots_kinematics import place

mujoco = pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to compare the robots")

ROBOTS = ("saturn_lite", "go2", "g1")


def instance(tmp_path: Path, spec: Robot, **changes) -> Read:
    """Write the PROTO of a robot, read it back and return an instance of it with its defaults."""
    path = tmp_path / f"{proto_name(spec.name)}.proto"
    path.write_text(write_proto(spec, make_contract(spec.name, **changes)))
    proto = read_proto(path)
    return proto.instance(Read(proto.name, "ROBOT"))


def export(tmp_path: Path, name: str, **changes) -> Read:
    """Do so for a shipped robot."""
    return instance(tmp_path, find_robot(name), **changes)


def joints(robot: Read) -> dict[str, tuple[Read, dict[str, Read]]]:
    """Return name of the motor -> parameters of its hinge, and its devices by their types, in the file's order."""
    hinges = {}
    for hinge in robot.every("HingeJoint"):
        devices = {device.kind: device for device in hinge["device"]}
        hinges[devices["RotationalMotor"]["name"]] = hinge["jointParameters"], devices
    return hinges


@pytest.mark.parametrize("name", ROBOTS)
def test_joints_have_their_names_limits_and_damping(name: str, tmp_path: Path) -> None:
    """Every motor has its name, limits and damping."""
    spec = find_robot(name)
    damping = tuple(0.01 * (k + 1) for k in range(spec.num_joints))
    hinges = joints(export(tmp_path, name, damping=damping))
    assert tuple(hinges) == spec.joint_names
    for joint, (parameters, devices), b in zip(spec.joints, hinges.values(), damping, strict=True):
        assert devices["RotationalMotor"]["maxTorque"] == joint.torque_limit
        assert devices["PositionSensor"]["name"] == f"{joint.name}_sensor"
        assert parameters["dampingConstant"] == b
        assert -np.pi <= parameters["minStop"] <= 0 <= parameters["maxStop"] <= np.pi  # as jointparameters.md wants
        standing = joint.default_position
        assert parameters["minStop"] == pytest.approx(max(joint.lower - standing, -FARTHEST), abs=1e-12)
        assert parameters["maxStop"] == pytest.approx(min(joint.upper - standing, FARTHEST), abs=1e-12)
    moved = [joint.name for joint in spec.joints if FARTHEST in stops(joint)]
    assert moved == (["RR_thigh_joint", "RL_thigh_joint"] if name == "go2" else [])  # 4.5379 - 0.8 rad


FIELDS = {
    "saturn_lite": ["hipFriction", "thighFriction", "shankFriction"],
    "go2": ["hipFriction", "thighFriction", "calfFriction"],
    "g1": [f"{kind}Friction" for kind in ("hipPitch", "hipRoll", "hipYaw", "knee", "anklePitch", "ankleRoll")],
}
"""Fields of the joints of one leg."""


@pytest.mark.parametrize("name", ROBOTS)
def test_friction_is_a_field_for_each_kind_of_joint(name: str, tmp_path: Path) -> None:
    """The friction fields of a world act in the joints of their kind."""
    spec, fields = find_robot(name), FIELDS[name]
    path = tmp_path / f"{proto_name(name)}.proto"
    path.write_text(write_proto(spec, make_contract(name)))
    proto = read_proto(path)
    assert [field for field in proto.interface if field.endswith("Friction")] == fields
    bound = [parameters["staticFriction"] for parameters, _ in joints(proto.body).values()]
    assert bound == [Bound(field) for field in fields] * (spec.num_joints // len(fields))
    values = Read(proto.name, "", {field: float(k) for k, field in enumerate(fields)})
    torques = [parameters["staticFriction"] for parameters, _ in joints(proto.instance(values)).values()]
    assert torques == [float(k) for k in range(len(fields))] * (spec.num_joints // len(fields))


@pytest.mark.parametrize("name", ROBOTS)
def test_every_link_is_where_and_what_it_is_in_mujoco(name: str, tmp_path: Path) -> None:
    """Mass, centre, inertia and axes of every link are MuJoCo's, in bent poses too."""
    from stiction.robots.mjcf import build_model

    spec, robot = find_robot(name), export(tmp_path, name)
    model = build_model(spec)
    data = mujoco.MjData(model)
    generator = np.random.default_rng(0)
    for offset in (np.zeros(spec.num_joints), *generator.uniform(-0.5, 0.5, (3, spec.num_joints))):
        data.qpos[:] = model.key("standing").qpos
        data.qpos[7:] += offset
        mujoco.mj_forward(model, data)
        links = place(robot, dict(zip(spec.joint_names, offset, strict=True)))
        assert set(links) == {model.body(k).name for k in range(1, model.nbody)}
        for link, placed in links.items():
            body, physics = model.body(link), placed.solid["physics"]
            assert (physics["density"], physics["mass"]) == (-1.0, body.mass[0])
            turned = data.body(link).ximat.reshape(3, 3)
            np.testing.assert_allclose(placed.origin, data.body(link).xpos, atol=1e-12)
            np.testing.assert_allclose(placed.rotation, data.body(link).xmat.reshape(3, 3), atol=1e-12)
            np.testing.assert_allclose(placed.centre, data.body(link).xipos, atol=1e-12)
            np.testing.assert_allclose(placed.inertia, turned @ np.diag(body.inertia) @ turned.T, atol=1e-12)
    assert sum(node["mass"] for node in robot.every("Physics")) == pytest.approx(spec.mass)


def odd_shapes() -> Robot:
    """Return Saturn Lite with a rod askew and a painted wedge on one thigh, and a wedge as a foot."""
    spec, wedge = find_robot("saturn_lite"), ((0.0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0.1, 0.1, 0), (0, 0, 0.05))
    rod = Shape("cylinder", (0.02, 0.1, 0.0), (0.01, 0.0, -0.1), (0.8, 0.0, 0.6, 0.0), contact="obstacles")
    paint = Shape("hull", (0.0, 0.0, 0.0), (0.0, 0.05, 0.0), color=(0.1, 0.2, 0.3), vertices=wedge)
    links, feet = list(spec.links), list(spec.feet)
    links[1] = replace(links[1], shapes=(rod, paint))
    sole = Shape("hull", (0.0, 0.0, 0.0), (0.0, 0.0, -0.25), (0.6, 0.0, 0.0, 0.8), contact="ground", vertices=wedge)
    feet[1] = replace(feet[1], shapes=(sole,))
    return replace(spec, links=tuple(links), feet=tuple(feet))


def test_a_hull_is_triangles_that_look_outward(tmp_path: Path) -> None:
    """The triangles of a hull face outward, as ODE's contacts need.

    The volume within the triangles, from their signed tetrahedra: a pyramid of 0.1 x 0.1 m, 0.05 m high.
    """
    hulls = instance(tmp_path, odd_shapes()).every("IndexedFaceSet")
    assert len(hulls) == 3  # one only seen, one seen and touched
    for hull in hulls:
        points, index = np.array(hull["coord"]["point"]), np.array(hull["coordIndex"], int).reshape(-1, 4)
        assert (index[:, 3] == -1).all() and len(index) == 6
        a, b, c = (points[index[:, k]] for k in range(3))
        assert (a * np.cross(b, c)).sum() / 6 == pytest.approx(0.1 * 0.1 * 0.05 / 3)


@pytest.mark.parametrize("name", ROBOTS)
def test_names_are_unique_and_allowed(name: str, tmp_path: Path) -> None:
    """Names are unique and allowed."""
    robot = export(tmp_path, name)
    solids = [
        *robot.every("Solid"),
        *(node for kind in ("InertialUnit", "Gyro", "GPS", "Receiver") for node in robot.every(kind)),
    ]
    devices = [device["name"] for hinge in robot.every("HingeJoint") for device in hinge["device"]]
    names = [solid["name"] for solid in solids] + devices
    assert len(set(names)) == len(names)
    assert not [each for each in names if ":" in each]
    assert all(solid.define == solid["name"] for solid in robot.every("Solid"))


def test_a_link_of_any_name_can_be_found(tmp_path: Path) -> None:
    """The plugin finds a link whose name has a dot or a quote."""
    spec = find_robot("go2")
    names = {0: "leg.front", 1: "2nd", 2: 'a"}, {"b'}
    links = tuple(replace(link, name=names.get(k, link.name)) for k, link in enumerate(spec.links))
    solids = instance(tmp_path, replace(spec, links=links)).every("Solid")
    assert [solid.define for solid in solids][:4] == ["link0_leg_front", "link1_2nd", "link2_a______b", "FL_hip"]
