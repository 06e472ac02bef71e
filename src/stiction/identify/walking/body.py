"""Rigid-body dynamics of a walking robot over a whole log, by MuJoCo, sample by sample.

The base stands at the world's origin, axes along the world's, without gravity: the base's acceleration enters as its
specific force, which is what an accelerometer reads, so gravity needs no orientation. Armature and joint friction are
not part of the model: they act on the joint's own equation alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np

from stiction.robots.mjcf import build_model
from stiction.robots.model import JOINTS_PER_LEG, Robot, box_inertia

AT_ORIGIN = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
"""Position and quaternion of the base."""


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
    """Return the robot's links alone: a base without mass, no rotors, no friction, no gravity, nothing to touch."""
    model = build_model(spec)
    base = model.body("base").id
    model.body_mass[base], model.body_inertia[base] = 0.0, 0.0
    model.dof_armature[:] = model.dof_damping[:] = model.dof_frictionloss[:] = 0.0
    model.opt.gravity[:] = 0.0
    disabled = mujoco.mjtDisableBit
    model.opt.disableflags |= disabled.mjDSBL_CONSTRAINT | disabled.mjDSBL_CONTACT | disabled.mjDSBL_ACTUATION
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
    return LinkEffort(effort[:, 6:], effort[:, :6])


def foot_positions(spec: Robot, position: np.ndarray) -> np.ndarray:
    """Return the centres of the feet in the base frame [m], shape (T, L, 3), at joint angles of shape (T, J)."""
    model = _legs(spec)
    data = mujoco.MjData(model)
    feet = [model.site(f"{leg.name}_foot").id for leg in spec.legs]
    found = np.empty((len(position), len(feet), 3))
    data.qpos[:7] = AT_ORIGIN
    for sample, angles in enumerate(position):
        data.qpos[7:] = angles
        mujoco.mj_kinematics(model, data)
        found[sample] = data.site_xpos[feet]
    return found


def point_jacobians(spec: Robot, position: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return J of a point of each shank, v = J θ', shape (T, L, 3, 3): rows x y z, columns hip thigh shank.

    position: joint angles [rad], shape (T, J); points: where they are now, in the base frame [m], shape (T, L, 3).
    """
    model = _legs(spec)
    data = mujoco.MjData(model)
    shanks = [model.body(f"{leg.name}_shank_link").id for leg in spec.legs]
    found = np.empty((len(position), len(shanks), 3, JOINTS_PER_LEG))
    whole = np.empty((3, model.nv))
    data.qpos[:7] = AT_ORIGIN
    for sample, angles in enumerate(position):
        data.qpos[7:] = angles
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        for leg, shank in enumerate(shanks):
            mujoco.mj_jac(model, data, whole, None, points[sample, leg], shank)
            first = 6 + JOINTS_PER_LEG * leg
            found[sample, leg] = whole[:, first : first + JOINTS_PER_LEG]
    return found


@dataclass(frozen=True)
class Trunk:
    """The trunk with whatever it carries: what must be known before feet without force sensors tell anything."""

    mass: float
    """Mass [kg]."""
    centre: tuple[float, float, float]
    """Centre of mass in the base frame [m]."""
    inertia: tuple[float, float, float]
    """Principal moments about the centre of mass, along the base's axes [kg m²]."""

    @classmethod
    def of(cls, spec: Robot, payload: float = 0.0, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Trunk:
        """Return a robot's bare trunk, or with `payload` [kg] on it and its centre of mass at `centre` [m].

        The payload is taken as spread over the trunk's box.
        """
        mass = spec.base.mass + payload
        x, y, z = box_inertia(mass, spec.base.size)
        return cls(mass, centre, (float(x), float(y), float(z)))


def trunk_wrench(trunk: Trunk, base: BaseMotion) -> np.ndarray:
    """Return force and moment about the base's origin that move the trunk as it moves, shape (T, 6)."""
    spin, arm, inertia = base.angular_velocity, np.array(trunk.centre), np.array(trunk.inertia)
    pull = base.specific_force + np.cross(base.angular_acceleration, arm) + np.cross(spin, np.cross(spin, arm))
    force = trunk.mass * pull
    moment = inertia * base.angular_acceleration + np.cross(spin, inertia * spin) + np.cross(arm, force)
    return np.concatenate([force, moment], axis=1)
