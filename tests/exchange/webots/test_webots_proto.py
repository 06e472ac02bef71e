"""The exported robot is the robot: held against its `Robot`, and link by link against its MuJoCo model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bundles import make_contract
from stiction.exchange.webots.proto import FARTHEST, Node, _placed, friction_fields, proto_name, stops, write_proto
from stiction.exchange.webots_joints import webots_joints
from stiction.robots.catalog import find_robot
from stiction.robots.model import Robot
from stiction.robots.shapes import Shape
from webots_files import Bound, Read, read_proto
from webots_kinematics import Lying, Placed, place, seen, touched

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
    found = {}
    for hinge in robot.every("HingeJoint"):
        devices = {device.kind: device for device in hinge["device"]}
        found[devices["RotationalMotor"]["name"]] = hinge["jointParameters"], devices
    return found


@pytest.mark.parametrize("name", ROBOTS)
def test_joints_have_their_names_limits_and_damping(name: str, tmp_path: Path) -> None:
    """If this failed, the controller would not find a motor, or a knee would bend beyond its stop."""
    spec = find_robot(name)
    damping = tuple(0.01 * (k + 1) for k in range(spec.num_joints))
    found = joints(export(tmp_path, name, damping=damping))
    assert tuple(found) == spec.joint_names
    for joint, (parameters, devices), b in zip(spec.joints, found.values(), damping, strict=True):
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
    """If this failed, the friction that a world names would act in another joint, or in none."""
    spec, fields = find_robot(name), FIELDS[name]
    path = tmp_path / f"{proto_name(name)}.proto"
    path.write_text(write_proto(spec, make_contract(name)))
    proto = read_proto(path)
    assert [field for field in proto.interface if field.endswith("Friction")] == fields
    bound = [parameters["staticFriction"] for parameters, _ in joints(proto.body).values()]
    assert bound == [Bound(field) for field in fields] * (spec.num_joints // len(fields))
    given = Read(proto.name, "", {field: float(k) for k, field in enumerate(fields)})
    torques = [parameters["staticFriction"] for parameters, _ in joints(proto.instance(given)).values()]
    assert torques == [float(k) for k in range(len(fields))] * (spec.num_joints // len(fields))


def test_a_kind_whose_torque_limits_differ_has_a_field_for_each_joint() -> None:
    """If this failed, one number would be 20 % of one joint's limit and 10 % of another's."""
    spec = find_robot("go2")
    first = replace(spec.joints[0], torque_limit=2 * spec.joints[0].torque_limit)
    fields = friction_fields(replace(spec, joints=(first, *spec.joints[1:])))
    hips = {f"{leg}HipJointFriction": [3 * number] for number, leg in enumerate(("FR", "FL", "RR", "RL"))}
    assert fields == hips | {"thighFriction": [1, 4, 7, 10], "calfFriction": [2, 5, 8, 11]}


@pytest.mark.parametrize("name", ROBOTS)
def test_every_link_is_where_and_what_it_is_in_mujoco(name: str, tmp_path: Path) -> None:
    """If this failed, another robot would walk in Webots: mass, centre, inertia and axes, in bent poses too."""
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


KINDS = {"Sphere": "SPHERE", "Capsule": "CAPSULE", "Cylinder": "CYLINDER", "Box": "BOX", "IndexedFaceSet": "MESH"}
"""Webots' geometries, and MuJoCo's."""


def test_an_upright_shape_may_have_either_sign() -> None:
    """(-1, 0, 0, 0) turns nothing: its axis, nothing over nothing, was written as NaN."""
    shape = Shape("box", (0.1, 0.1, 0.1), quaternion=(-1.0, 0.0, 0.0, 0.0))
    child = Node("Group", {})
    assert _placed(shape, child) is child


def sizes(geometry: Read) -> list[float]:
    """Return what MuJoCo calls the size of a geometry [m]."""
    if geometry.kind == "Box":
        return [extent / 2 for extent in geometry["size"]]
    return [geometry["radius"], *([geometry["height"] / 2] if "height" in geometry.fields else [])]


def match(placed: Placed, parts: list[Lying], geoms: list[int], model, data) -> None:
    """Hold the geometries of a solid against those of a MuJoCo body, in any order: kind, size and pose in the world."""
    assert len(parts) == len(geoms)
    left = list(geoms)
    for part in parts:
        middle, axes = placed.origin + placed.rotation @ part.origin, placed.rotation @ part.rotation
        kind = int(getattr(mujoco.mjtGeom, f"mjGEOM_{KINDS[part.geometry.kind]}"))
        same = [geom for geom in left if model.geom_type[geom] == kind]
        geom = min(same, key=lambda geom: np.abs(data.geom_xpos[geom] - middle).max())
        left.remove(geom)
        where, turned = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
        if part.geometry.kind == "IndexedFaceSet":  # MuJoCo moves a mesh to its own middle and axes
            ours = middle + np.array(part.geometry["coord"]["point"]) @ axes.T
            first = model.mesh_vertadr[model.geom_dataid[geom]]
            theirs = where + model.mesh_vert[first : first + len(ours)] @ turned.T
            apart = np.linalg.norm(ours[:, None] - theirs[None], axis=-1)
            assert apart.min(axis=0).max() < 1e-6 and apart.min(axis=1).max() < 1e-6
        else:
            size = sizes(part.geometry)
            np.testing.assert_allclose(where, middle, atol=1e-12)
            np.testing.assert_allclose(turned, axes, atol=1e-12)
            np.testing.assert_allclose(model.geom_size[geom][: len(size)], size, atol=1e-12)


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


@pytest.mark.parametrize("spec", [*map(find_robot, ROBOTS), odd_shapes()], ids=[*ROBOTS, "odd"])
def test_what_is_seen_and_what_collides_are_those_of_mujoco(spec: Robot, tmp_path: Path) -> None:
    """If this failed, the robot would stand at another height, or hang with its thighs on the stairs."""
    from stiction.robots.mjcf import build_model

    model = build_model(spec)
    data = mujoco.MjData(model)
    data.qpos[:] = model.key("standing").qpos
    mujoco.mj_forward(model, data)
    links = place(instance(tmp_path, spec), {})
    for link, placed in links.items():
        geoms = np.flatnonzero(model.geom_bodyid == model.body(link).id)
        touch = geoms[model.geom_contype[geoms] | model.geom_conaffinity[geoms] != 0]
        match(placed, seen(placed.solid), geoms.tolist(), model, data)
        match(placed, touched(placed.solid), touch.tolist(), model, data)
        colors = sorted(paint["baseColor"] for paint in placed.solid.every("PBRAppearance")[: len(geoms)])
        np.testing.assert_allclose(colors, sorted(map(tuple, model.geom_rgba[geoms, :3].tolist())), atol=1e-7)


def test_a_hull_is_triangles_that_look_outward(tmp_path: Path) -> None:
    """If this failed, ODE would push a robot's sole into the ground: its contacts lie on the side that faces look to.

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
    """If this failed, the controller or the plugin would get another device or link than it asked for."""
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
    """If this failed, a maker's name with a dot or a quote would hide a link from the plugin, or break out of C."""
    spec = find_robot("go2")
    names = {0: "leg.front", 1: "2nd", 2: 'a"}, {"b'}
    links = tuple(replace(link, name=names.get(k, link.name)) for k, link in enumerate(spec.links))
    solids = instance(tmp_path, replace(spec, links=links)).every("Solid")
    assert [solid.define for solid in solids][:4] == ["link0_leg_front", "link1_2nd", "link2_a______b", "FL_hip"]


def test_convert_finds_the_joints_of_the_exported_robot() -> None:
    """If this failed, `stiction convert --to webots --model` could not read what `stiction export` wrote."""
    spec = find_robot("saturn_lite")
    data = write_proto(spec, make_contract()).encode()
    assert tuple(webots_joints(data, "SaturnLite.proto")) == spec.joint_names


@pytest.mark.parametrize(
    ("robot", "name"),
    [("saturn_lite", "SaturnLite"), ("go1", "Go1"), ("saturn_lite@kp=0.5", "SaturnLiteKp05"), ("3d", "Robot3d")],
)
def test_a_robots_name_becomes_that_of_a_proto(robot: str, name: str) -> None:
    """If this failed, Webots would refuse the PROTO: its name is an identifier, and that of its file."""
    assert proto_name(robot) == name
    spec = replace(find_robot("go1"), name=robot)
    assert f"\nPROTO {name} [" in write_proto(spec, make_contract("go1"))
