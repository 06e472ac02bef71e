"""The legs' dynamics in NumPy against MuJoCo's inverse dynamics of the same robot."""

import numpy as np
import pytest

from stiction.identify.walking.leg import (
    BaseMotion,
    LegMotion,
    Trunk,
    foot_position,
    leg_effort,
    point_jacobian,
    rotation_about,
    trunk_wrench,
)
from stiction.robots.catalog import find_robot

mujoco = pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is what this is compared with")


def random_state(name: str, seed: int):
    """Return a robot in a random state far above the ground, its accelerations, and the forces MuJoCo finds for it."""
    from stiction.robots.build import build_model

    spec, generator = find_robot(name), np.random.default_rng(seed)
    model = build_model(spec)
    model.body("base").ipos[:] = [0.03, -0.02, 0.05]
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    data.qpos[:3] = [0.3, -0.2, 5.0]
    quaternion = generator.normal(size=4)
    data.qpos[3:7] = quaternion / np.linalg.norm(quaternion)
    data.qpos[7:] = spec.joint_values("standing") + generator.uniform(-0.2, 0.2, spec.num_joints)
    data.qvel[:] = generator.normal(size=model.nv)
    mujoco.mj_forward(model, data)
    data.qacc[:] = 3 * generator.normal(size=model.nv)
    mujoco.mj_inverse(model, data)
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, data.qpos[3:7])
    to_base = rotation.reshape(3, 3).T
    base = BaseMotion(
        data.qvel[None, 3:6].copy(), data.qacc[None, 3:6].copy(), (to_base @ (data.qacc[:3] - model.opt.gravity))[None]
    )
    rigid = data.qfrc_inverse + data.qfrc_passive + data.qfrc_constraint - model.dof_armature * data.qacc
    return spec, model, data, to_base, base, rigid


@pytest.mark.parametrize(("name", "seed"), [("saturn_lite", 0), ("saturn_lite", 1), ("go1", 2)])
def test_torques_and_wrench_are_those_of_mujoco(name: str, seed: int) -> None:
    """Whatever the links need is taken off the motor's torque; an error here would be read as friction."""
    spec, model, data, to_base, base, rigid = random_state(name, seed)
    wrench = trunk_wrench(Trunk.of(spec, centre=tuple(model.body("base").ipos)), base)
    for number, leg in enumerate(spec.legs):
        joints = slice(3 * number, 3 * number + 3)
        parts = (data.qpos[7:], data.qvel[6:], data.qacc[6:])
        effort = leg_effort(spec, leg, LegMotion(*(part[None, joints] for part in parts)), base)
        np.testing.assert_allclose(effort.torque[0], rigid[6:][joints], atol=1e-9)
        wrench = wrench + effort.wrench
    np.testing.assert_allclose(wrench[0, :3], to_base @ rigid[:3], atol=1e-8)
    np.testing.assert_allclose(wrench[0, 3:], rigid[3:6], atol=1e-8)


def test_foot_and_its_jacobian_are_those_of_mujoco() -> None:
    """The Jacobian turns joint torques into the force on the ground."""
    spec, model, data, to_base, _, _ = random_state("saturn_lite", 3)
    for number, leg in enumerate(spec.legs):
        joints = slice(3 * number, 3 * number + 3)
        angles = data.qpos[None, 7:][:, joints]
        foot = foot_position(spec, leg, angles)
        place = data.geom(f"{leg.name}_foot").xpos
        np.testing.assert_allclose(foot[0], to_base @ (place - data.qpos[:3]), atol=1e-12)
        full = np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, full, None, place, model.body(f"{leg.name}_shank_link").id)
        expected = to_base @ full[:, 6:][:, joints]
        np.testing.assert_allclose(point_jacobian(spec, leg, angles, foot)[0], expected, atol=1e-12)


def test_a_rotation_by_hand() -> None:
    """A quarter turn about x takes y to z; about y it takes z to x."""
    np.testing.assert_allclose(rotation_about(0, np.array([np.pi / 2]))[0] @ [0, 1, 0], [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(rotation_about(1, np.array([np.pi / 2]))[0] @ [0, 0, 1], [1, 0, 0], atol=1e-15)
