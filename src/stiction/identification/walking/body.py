"""Rigid-body dynamics of a walking robot over a whole log, by MuJoCo, sample by sample.

The base stands at the world's origin, axes along the world's, without gravity: the base's acceleration enters as its
specific force, which is what an accelerometer reads, so gravity needs no orientation. Armature and joint friction are
not part of the links' efforts: they act on the joint's own equation alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np

from stiction.robots.mjcf import build_model
from stiction.robots.model import Body, Robot
from stiction.robots.shapes import Vector

AT_ORIGIN = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
"""Position and quaternion of the base."""

BASE_DOFS = 6
"""Velocities of the base, before those of the joints."""


@dataclass(frozen=True)
class BaseMotion:
    """How the base moves, T samples; vectors in the base frame, at the base's origin."""

    angular_velocity: np.ndarray
    """ω [rad/s], shape (T, 3)."""
    angular_acceleration: np.ndarray
    """ω' [rad/s²], shape (T, 3)."""
    specific_force: np.ndarray
    """Acceleration minus gravity [m/s²], shape (T, 3): (0, 0, 9.81) at rest."""


@dataclass(frozen=True)
class JointMotion:
    """How the joints move, in the order of the robot's joints, shape (T, J) each."""

    position: np.ndarray
    """θ [rad]."""
    velocity: np.ndarray
    """θ' [rad/s]."""
    acceleration: np.ndarray
    """θ'' [rad/s²]."""


@dataclass(frozen=True)
class LinkEffort:
    """What it takes to move the legs' links with all feet in the air."""

    torque: np.ndarray
    """Torque about each joint's axis [N m], shape (T, J)."""
    wrench: np.ndarray
    """Force [N] and moment about the base's origin [N m] by which the base holds the legs, shape (T, 6)."""


@cache
def _legs(spec: Robot) -> mujoco.MjModel:
    """Return the robot's links and rotors alone: a base without mass, no friction, no gravity, nothing to touch.

    Without rotors, hips on one line could turn against such a base at no cost, and the inertia matrix were singular.
    """
    model = build_model(spec)
    base = model.body("base").id
    model.body_mass[base], model.body_inertia[base] = 0.0, 0.0
    model.dof_damping[:] = model.dof_frictionloss[:] = 0.0
    model.opt.gravity[:] = 0.0
    disabled = mujoco.mjtDisableBit
    model.opt.disableflags |= disabled.mjDSBL_CONSTRAINT | disabled.mjDSBL_CONTACT | disabled.mjDSBL_ACTUATION
    # What MuJoCo derives from masses, it derives once: it must be told that they changed.
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def link_effort(spec: Robot, joints: JointMotion, base: BaseMotion) -> LinkEffort:
    """Return torques and wrench that move the legs' links as they move, their feet in the air."""
    model = _legs(spec)
    data = mujoco.MjData(model)
    count = len(joints.position)
    position = np.concatenate([np.tile(AT_ORIGIN, (count, 1)), joints.position], axis=1)
    velocity = np.concatenate([np.zeros((count, 3)), base.angular_velocity, joints.velocity], axis=1)
    acceleration = np.concatenate([base.specific_force, base.angular_acceleration, joints.acceleration], axis=1)
    effort = np.empty((count, model.nv))
    for sample in range(count):
        data.qpos, data.qvel, data.qacc = position[sample], velocity[sample], acceleration[sample]
        mujoco.mj_inverse(model, data)
        effort[sample] = data.qfrc_inverse
    # `mj_inverse` counts the rotors, which had to stay in the model.
    effort -= model.dof_armature * acceleration
    return LinkEffort(effort[:, BASE_DOFS:], effort[:, :BASE_DOFS])


def foot_positions(spec: Robot, position: np.ndarray) -> np.ndarray:
    """Return the middles of the feet in the base frame [m], shape (T, L, 3), at joint angles of shape (T, J)."""
    model = _legs(spec)
    data = mujoco.MjData(model)
    feet = [model.site(name).id for name in spec.foot_names]
    found = np.empty((len(position), len(feet), 3))
    data.qpos[:7] = AT_ORIGIN
    for sample, angles in enumerate(position):
        data.qpos[7:] = angles
        mujoco.mj_kinematics(model, data)
        found[sample] = data.site_xpos[feet]
    return found


@dataclass(frozen=True)
class Leg:
    """Joints between the base and feet: one foot, or several that share a joint."""

    feet: tuple[int, ...]
    """Numbers of its feet."""
    joints: tuple[int, ...]
    """Numbers of its joints, ascending."""


def legs(spec: Robot) -> tuple[Leg, ...]:
    """Return the legs of a robot: no two have a joint in common."""
    found: list[tuple[tuple[int, ...], set[int]]] = []
    for number, foot in enumerate(spec.feet):
        feet: tuple[int, ...] = (number,)
        joints = set(spec.chain(foot.link))
        for leg in [leg for leg in found if leg[1] & joints]:
            found.remove(leg)
            feet, joints = leg[0] + feet, leg[1] | joints
        found.append((feet, joints))
    return tuple(Leg(feet, tuple(sorted(joints))) for feet, joints in found)


def foot_jacobians(spec: Robot, position: np.ndarray) -> list[np.ndarray]:
    """Return J of the middle of each foot, by leg, v = J θ', shape (T, feet, 6, joints) of the leg.

    Rows: velocity x y z [m/s], rate of turn x y z [rad/s]. position: joint angles [rad], shape (T, J).
    """
    model = _legs(spec)
    data = mujoco.MjData(model)
    sites = [model.site(name).id for name in spec.foot_names]
    limbs = legs(spec)
    columns = [BASE_DOFS + np.array(leg.joints) for leg in limbs]
    found = [np.empty((len(position), len(leg.feet), 6, len(leg.joints))) for leg in limbs]
    whole = np.empty((6, model.nv))
    data.qpos[:7] = AT_ORIGIN
    for sample, angles in enumerate(position):
        data.qpos[7:] = angles
        mujoco.mj_kinematics(model, data)
        # A Jacobian needs the motion axes that this computes; positions alone do not.
        mujoco.mj_comPos(model, data)
        for leg, own, jacobian in zip(limbs, columns, found, strict=True):
            for index, foot in enumerate(leg.feet):
                mujoco.mj_jacSite(model, data, whole[:3], whole[3:], sites[foot])
                jacobian[sample, index] = whole[:, own]
    return found


def loaded_trunk(spec: Robot, payload: float = 0.0, centre: Vector | None = None) -> Body:
    """Return a robot's trunk with `payload` [kg] on it, its centre of mass at `centre` [m], by default its own.

    The payload is taken as spread like the trunk's own mass.
    """
    share = 1 + payload / spec.base.mass
    xx, yy, zz, xy, xz, yz = (share * value for value in spec.base.inertia)
    return Body(spec.base.mass + payload, spec.base.com if centre is None else centre, (xx, yy, zz, xy, xz, yz))


def trunk_wrench(trunk: Body, base: BaseMotion) -> np.ndarray:
    """Return force and moment about the base's origin that move the trunk as it moves, shape (T, 6)."""
    spin, arm, inertia = base.angular_velocity, np.array(trunk.com), trunk.inertia_matrix
    pull = base.specific_force + np.cross(base.angular_acceleration, arm) + np.cross(spin, np.cross(spin, arm))
    force = trunk.mass * pull
    moment = base.angular_acceleration @ inertia + np.cross(spin, spin @ inertia) + np.cross(arm, force)
    return np.concatenate([force, moment], axis=1)
