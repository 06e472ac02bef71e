"""The exported robot is the robot: held against its `Robot`, and link by link against its MuJoCo model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bundles import make_contract
from stiction.exchange.webots.proto import FARTHEST, proto_name, stops, write_proto
from stiction.exchange.webots_joints import webots_joints
from stiction.robots.catalog import find_robot
from webots_files import Bound, Read, read_proto
from webots_kinematics import place

mujoco = pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to compare the robots")

ROBOTS = ("saturn_lite", "go1")


def export(tmp_path: Path, name: str, **changes) -> Read:
    """Write the PROTO of a robot, read it back and return an instance of it with its defaults."""
    spec, contract = find_robot(name), make_contract(name, **changes)
    path = tmp_path / f"{proto_name(name)}.proto"
    path.write_text(write_proto(spec, contract))
    proto = read_proto(path)
    return proto.instance(Read(proto.name, "ROBOT"))


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
    for (joint, (parameters, devices)), b in zip(found.items(), damping, strict=True):
        kind = getattr(spec, joint.split("_")[1])
        assert devices["RotationalMotor"]["maxTorque"] == kind.torque_limit
        assert devices["PositionSensor"]["name"] == f"{joint}_sensor"
        assert parameters["dampingConstant"] == b
        assert -np.pi <= parameters["minStop"] <= 0 <= parameters["maxStop"] <= np.pi  # as jointparameters.md wants
        assert parameters["minStop"] == pytest.approx(max(kind.lower - kind.standing, -FARTHEST), abs=1e-12)
        assert parameters["maxStop"] == pytest.approx(min(kind.upper - kind.standing, FARTHEST), abs=1e-12)
    moved = {joint for joint in ("hip", "thigh", "shank") if FARTHEST in stops(getattr(spec, joint))}
    assert moved == ({"thigh"} if name == "go1" else set())  # 4.5 - 0.9 rad is more than half a turn


@pytest.mark.parametrize("name", ROBOTS)
def test_friction_is_a_field_for_each_kind_of_joint(name: str, tmp_path: Path) -> None:
    """If this failed, the friction that a world names would act in another joint, or in none."""
    spec = find_robot(name)
    path = tmp_path / f"{proto_name(name)}.proto"
    path.write_text(write_proto(spec, make_contract(name)))
    proto = read_proto(path)
    for joint, (parameters, _) in joints(proto.body).items():
        assert parameters["staticFriction"] == Bound(f"{joint.split('_')[1]}Friction")
    given = Read(proto.name, "", {"hipFriction": 1.0, "thighFriction": 2.0, "shankFriction": 3.0})
    torques = [parameters["staticFriction"] for parameters, _ in joints(proto.instance(given)).values()]
    assert torques == [1.0, 2.0, 3.0] * len(spec.feet)


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


@pytest.mark.parametrize("name", ROBOTS)
def test_what_collides_is_what_collides_in_mujoco(name: str, tmp_path: Path) -> None:
    """If this failed, the robot would stand at another height, or hang with its thighs on the stairs."""
    from stiction.robots.mjcf import build_model

    spec, robot = find_robot(name), export(tmp_path, name)
    model = build_model(spec)
    colliding = {link: placed.solid.fields.get("boundingObject") for link, placed in place(robot, {}).items()}
    assert {link for link, shape in colliding.items() if shape} == {
        "base",
        *(f"{leg.name}_shank_link" for leg in spec.legs),
    }
    assert colliding["base"]["size"] == tuple(2 * model.geom("base").size)
    for leg in spec.legs:
        foot, bone = colliding[f"{leg.name}_shank_link"]["children"]
        (sphere,), (capsule,) = foot["children"], bone["children"]
        assert (sphere["radius"], foot["translation"]) == (
            model.geom(f"{leg.name}_foot").size[0],
            tuple(model.geom(f"{leg.name}_foot").pos),
        )
        geoms = [
            model.geom(k) for k in range(model.ngeom) if model.geom_bodyid[k] == model.body(f"{leg.name}_shank_link").id
        ]
        shank = next(geom for geom in geoms if geom.type[0] == mujoco.mjtGeom.mjGEOM_CAPSULE)
        np.testing.assert_allclose((capsule["radius"], capsule["height"] / 2), shank.size[:2], atol=1e-12)
        np.testing.assert_allclose(bone["translation"], shank.pos, atol=1e-12)


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
