"""Robot in MuJoCo: the model of the training, its joints moved by torques from outside.

Sensors lag the state by one step, as in the fleet; a foot's sensor also feels the other feet. Dry friction is the
solver's `frictionloss`, as stiff as in training (`robots.physics.FRICTION_D0`); its bound may change at every step.

Contacts are as soft as in training, 20 ms (`geom_solref`), softer than in the other engines; joint controllers are
outside, where the fleet has them inside and takes kd implicitly. For the effect of both see `results/engines`.
"""

from __future__ import annotations

import mujoco
import numpy as np

from stiction.core.rotation import UPRIGHT, into_frame
from stiction.engines.engine import TOUCH, Body, Motion, check_speed
from stiction.engines.ground import Ground
from stiction.robots.mjcf import build, foot_geometries
from stiction.robots.model import GRAVITY

# MuJoCo would write every instability to a file in the current folder and to the terminal; `step` raises instead.
mujoco.set_mju_user_warning(lambda message: None)


class MujocoEngine:
    """`Engine` on MuJoCo."""

    name = "mujoco"

    def __init__(self, body: Body, ground: Ground, timestep: float, contact_time: float | None = None) -> None:
        """Build the robot on its ground, the base at the origin.

        timestep: of the physics [s]; contact_time: time constant of contacts [s], by default as in training.
        """
        self.body, self.timestep = body, timestep
        self._legs, self._joints = len(body.spec.feet), body.spec.num_joints
        spec = build(body.spec, timestep, ground.half_sizes, joint_sensors=True)
        spec.option.gravity = [0.0, 0.0, -GRAVITY]
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
        base = spec.body("base")
        base.ipos = body.base_com
        if body.fixed:
            # The keyframe has the pose of a free base, and would not fit a model without one.
            spec.delete(spec.key("standing"))
            spec.delete(spec.joint("root"))
        self._model = model = spec.compile()
        self._data = mujoco.MjData(model)
        self._base = model.body("base").id
        self._free = 0 if body.fixed else 6
        model.dof_armature[self._free :], model.dof_damping[self._free :] = body.armature, body.damping
        model.dof_frictionloss[:] = 0.0
        model.geom_friction[[model.geom(name).id for name in foot_geometries(body.spec)], 0] = body.ground_friction
        for number, (place, turn) in enumerate(zip(ground.positions, ground.quaternions, strict=True)):
            box = model.geom(f"obstacle{number}").id
            model.geom_pos[box], model.geom_quat[box] = place, turn
        if contact_time is not None:
            model.geom_solref[:, 0] = contact_time
        mujoco.mj_setConst(model, self._data)
        # Views of MuJoCo's own memory: to ask for them takes as long as to read them.
        self._torque, self._bound = self._data.qfrc_applied[self._free :], model.dof_frictionloss[self._free :]
        self._position, self._speed, self._sensed = self._data.qpos, self._data.qvel, self._data.sensordata
        self.reset(body.spec.joint_values("default_position"), np.zeros(3), UPRIGHT)

    def reset(self, joint_position: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Place the robot at rest; see `Engine.reset`."""
        mujoco.mj_resetData(self._model, self._data)
        if self.body.fixed:
            self._model.body_pos[self._base], self._model.body_quat[self._base] = position, quaternion
            self._data.qpos[:] = joint_position
        else:
            self._data.qpos[:] = np.concatenate((position, quaternion, joint_position))

    def step(self, torque: np.ndarray, friction: np.ndarray) -> None:
        """Advance by one timestep; see `Engine.step`."""
        self._torque[:], self._bound[:] = torque, friction
        mujoco.mj_step(self._model, self._data)
        check_speed(self.name, self._speed)

    def push(self, velocity: np.ndarray) -> None:
        """Push the robot; see `Pushable.push`."""
        if not self.body.fixed:
            self._data.qvel[:2] += velocity

    def friction_torque(self) -> np.ndarray:
        """Return the forces of the solver's rows of dry friction; see `FrictionSensing`."""
        data, torque = self._data, np.zeros(self._joints)
        rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF
        torque[data.efc_id[rows] - self._free] = data.efc_force[rows]
        return torque

    def contact_forces(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the forces of the contacts with the ground; see `ContactSensing`."""
        forces, wrench = [], np.zeros(6)
        for number, contact in enumerate(self._data.contact):
            ground = self._model.geom_bodyid[contact.geom] == 0
            if ground.any():
                mujoco.mj_contactForce(self._model, self._data, number, wrench)
                # MuJoCo gives the force of the first geometry on the second, in the frame of the contact.
                sign = 1.0 if ground[0] else -1.0
                forces.append((contact.pos.copy(), sign * contact.frame.reshape(3, 3).T @ wrench[:3]))
        return forces

    def motion(self, loads: bool = True) -> Motion:
        """Return the present motion; see `Motion`."""
        angles, speeds = self._position, self._speed
        force, torque = self._transmitted() if loads else np.zeros((2, self._joints))
        if self.body.fixed:
            position, quaternion = self._model.body_pos[self._base].copy(), self._model.body_quat[self._base].copy()
            velocity, rate = np.zeros(3), np.zeros(3)
        else:
            position, quaternion = angles[:3].copy(), angles[3:7].copy()
            velocity, rate = into_frame(quaternion, speeds[:3]), speeds[3:6].copy()
        return Motion(
            base_position=position,
            base_quaternion=quaternion,
            base_linear_velocity=velocity,
            base_angular_velocity=rate,
            joint_position=angles[-self._joints :].copy(),
            joint_velocity=speeds[-self._joints :].copy(),
            foot_contact=self._sensed[: self._legs] >= TOUCH,
            joint_force=force,
            joint_torque=torque,
        )

    def _transmitted(self) -> np.ndarray:
        """Return |F| and |T| of every joint in the last step [N, N m], shape (2, J)."""
        wrench = np.moveaxis(self._sensed[self._legs :].reshape(self._joints, 2, 3), 1, 0)
        return np.sqrt(np.square(wrench).sum(-1))
