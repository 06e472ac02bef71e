"""Many robots in any engine behind the interface of the batched simulation, for training in it.

They are stepped one after the other, each in a separate world: a tenth of the speed of MuJoCo's batch, or less.
Differences from it:

* the motors' torque is computed from the state before a step and held over it, viscous gains too;
* an engine reports contact of a foot, not its force: `sensordata` has `TOUCHING`, or zero;
* after a reset, and after a checkpoint, the base has only the horizontal part of its velocity, so
  poses are restored, not the motion;
* the ground is flat, joints have no sensors, and nothing pushes them from outside.
"""

from __future__ import annotations

import copy
from dataclasses import replace

import mujoco
import numpy as np

from stiction.core.errors import EngineError
from stiction.core.rotation import matrix
from stiction.engines.catalog import make_engine
from stiction.engines.engine import TOUCH, BlownUp, Body, Engine, Pushable
from stiction.engines.ground import flat
from stiction.robots.mjcf import foot_geometries
from stiction.robots.model import DELAY_SAMPLES, Robot
from stiction.sim.native import STATE, Simulation

BASE_DOFS = 6
"""Degrees of freedom of the floating base, first in the velocity vector."""

RESULTS = ("qacc", "actuator_force", "sensordata")
"""Results of a step: accelerations by differences over it, torques of the motors, and the feet's contact."""

FIELDS = (
    *("dof_armature", "dof_damping", "dof_frictionloss", "actuator_gainprm", "actuator_biasprm", "actuator_delay"),
    *("body_mass", "body_ipos", "geom_friction"),
)
"""Fields of the model that may differ by robot."""

OUTSIDE = ("qfrc_applied", "xfrc_applied")
"""Torques and forces from outside, which these engines do not support."""


TOUCHING = 2 * TOUCH
"""Reading of the sensor of a foot in contact [N]."""


class EngineBatch(Simulation):
    """`Simulation` of robots in one of the engines of the catalogue; arrays have the names and shapes of MuJoCo's."""

    def __init__(self, engine: str, spec: Robot, model: mujoco.MjModel, num: int, threads: int = 1) -> None:
        """Make `num` robots, all in keyframe 0; `threads` is not used.

        `engine`: its name; `spec`: the robot; `model`: the same on flat ground, from `build_model`.

        Raises `StictionError`: the model has joint sensors, or the engine cannot be made.
        """
        if model.nsensordata != len(spec.feet):
            raise EngineError(f"robots in the engine {engine!r} have no joint sensors; use the engine 'mujoco'")
        self.engine, self.spec, self.model, self.num = engine, spec, model, num
        self._standing = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, self._standing, 0)
        mujoco.mj_forward(model, self._standing)
        self.time = np.zeros(num)
        names = (*(name for name in STATE if name != "time"), *RESULTS)
        self._arrays = {name: self._copies(getattr(self._standing, name)) for name in names}
        self._fields: dict[str, np.ndarray] = {}
        self._base = model.body("base").id
        self._foot = model.geom(foot_geometries(spec)[0]).id
        self._engines: list[Engine | None] = [None] * num
        self._built: list[np.ndarray | None] = [None] * num
        self._fresh, self._lost = np.ones(num, bool), np.zeros(num, bool)
        self._seen = {name: self._arrays[name].copy() for name in ("qpos", "qvel")}

    def _copies(self, values: np.ndarray) -> np.ndarray:
        """Return the same values for every robot, shape (num, ...)."""
        return np.repeat(np.asarray(values)[None], self.num, axis=0)

    def bind(self, name: str) -> np.ndarray:
        """Return the live array of a state, or of a result of a step, shape (num, ...)."""
        if name == "time":
            return self.time
        if name not in self._arrays:
            raise EngineError(
                f"robots in the engine {self.engine!r} have no {name!r}, only {', '.join(('time', *self._arrays))}; "
                "use the engine 'mujoco'"
            )
        return self._arrays[name]

    def expand(self, name: str) -> np.ndarray:
        """Return the live array of a model's field, shape (num, ...).

        Raises `StictionError` for a field without an effect.
        """
        if name not in FIELDS:
            raise EngineError(
                f"the model field {name!r} has no effect in the engine {self.engine!r}, only {', '.join(FIELDS)}; use "
                "the engine 'mujoco'"
            )
        if name not in self._fields:
            self._fields[name] = self._copies(getattr(self.model, name))
        return self._fields[name]

    def _value(self, name: str) -> np.ndarray:
        """Return a field of the model as `expand`, or the nominal one for all, shape (num, ...) or (1, ...)."""
        return self._fields.get(name, np.asarray(getattr(self.model, name))[None])

    def set_const(self, ids: np.ndarray) -> None:
        """Do nothing: a robot whose parameters have changed is rebuilt before its next step."""

    def reset(self, ids: np.ndarray) -> None:
        """Reset the robots `ids` to keyframe 0, with the results of a step as in MuJoCo."""
        self.time[ids] = self.model.key_time[0]
        for name, array in self._arrays.items():
            array[ids] = getattr(self._standing, name)
        self._fresh[ids], self._lost[ids] = True, False

    def step(self, nstep: int) -> np.ndarray:
        """Advance by `nstep` physics steps; return the ids of robots that blew up and were not reset since."""
        if any(self._arrays[name].any() for name in OUTSIDE):
            raise EngineError(
                f"the engine {self.engine!r} takes no forces from outside the joints; use the engine 'mujoco'"
            )
        self._place()
        for _ in range(nstep):
            self._advance()
        self.time += nstep * self.model.opt.timestep
        for name, values in self._seen.items():
            values[...] = self._arrays[name]
        return np.flatnonzero(self._lost)

    def _place(self) -> None:
        """Rebuild robots with changed parameters, place moved ones, and apply pending pushes."""
        qpos, qvel = self._arrays["qpos"], self._arrays["qvel"]
        numbers = self._numbers()
        moved = self._fresh | (qpos != self._seen["qpos"]).any(1)
        pushed = moved | (qvel != self._seen["qvel"]).any(1)
        for env in np.flatnonzero(~self._lost).tolist():
            built = self._built[env]
            new = built is None or not np.array_equal(built, numbers[env])
            if new:
                self._engines[env] = make_engine(self.engine, self._body(numbers[env]), flat(), self.model.opt.timestep)
                self._built[env] = numbers[env]
            engine = self._engines[env]
            assert engine is not None
            if new or moved[env]:
                engine.reset(qpos[env, 7:], qpos[env, :3], qpos[env, 3:7])
            if new or pushed[env]:
                # A robot that was placed is at rest and gets all of its velocity; else only what was written on top of
                # it.
                before = 0.0 if new or moved[env] else self._seen["qvel"][env, :2]
                velocity = qvel[env, :2] - before
                # A robot whose engine cannot push begins at rest.
                if isinstance(engine, Pushable) and velocity.any():
                    engine.push(velocity)
                self._read(env, engine)
        self._fresh[:] = False

    def _numbers(self) -> np.ndarray:
        """Return the parameters of the robots, shape (num, numbers)."""
        parts = (
            self._value("dof_armature")[:, BASE_DOFS:],
            self._value("dof_damping")[:, BASE_DOFS:],
            self._value("body_mass")[:, self._base, None],
            self._value("body_ipos")[:, self._base],
            self._value("geom_friction")[:, self._foot, :1],
        )
        return np.concatenate([np.broadcast_to(part, (self.num, part.shape[1])) for part in parts], axis=1)

    def _body(self, numbers: np.ndarray) -> Body:
        """Return a robot from its `_numbers`; as in MuJoCo, a payload adds mass to the trunk but no inertia."""
        joints, base = self.spec.num_joints, self.spec.base
        armature, damping, (mass, *com, friction) = np.split(numbers, (joints, 2 * joints))
        spec = replace(self.spec, base=replace(base, mass=float(mass)))
        shift = tuple((np.array(com) - base.com).tolist())
        return Body(spec, armature, damping, float(friction), shift)

    def _advance(self) -> None:
        """Take one physics step with every robot that has not blown up."""
        arrays = self._arrays
        torque, friction = self._torque(), np.broadcast_to(self._value("dof_frictionloss"), arrays["qvel"].shape)
        arrays["actuator_force"][:] = torque
        before = arrays["qvel"].copy()
        for env in np.flatnonzero(~self._lost).tolist():
            engine = self._engines[env]
            assert engine is not None
            try:
                engine.step(torque[env], friction[env, BASE_DOFS:])
            except BlownUp:
                self._lost[env] = True
            else:
                self._read(env, engine)
        arrays["qacc"][:] = (arrays["qvel"] - before) / self.model.opt.timestep

    def _torque(self) -> np.ndarray:
        """Return the torques of the motors [N m], shape (num, J), and advance the delay lines by a step."""
        arrays = self._arrays
        lines = arrays["history"].reshape(self.num, self.spec.num_joints, -1)[..., -DELAY_SAMPLES:]
        steps = np.rint(self._value("actuator_delay") / self.model.opt.timestep).astype(int)
        sent = np.concatenate((lines, arrays["ctrl"][..., None]), axis=2)
        # Last in a line is what is sent now; what was sent k steps ago lies k places before it.
        arrived = np.take_along_axis(sent, (DELAY_SAMPLES - np.broadcast_to(steps, sent.shape[:2]))[..., None], 2)
        lines[...] = sent[..., 1:]
        gain, bias = self._value("actuator_gainprm"), self._value("actuator_biasprm")
        position, velocity = arrays["qpos"][:, 7:], arrays["qvel"][:, BASE_DOFS:]
        torque = gain[..., 0] * arrived[..., 0] + bias[..., 0] + bias[..., 1] * position + bias[..., 2] * velocity
        low, high = self.model.actuator_forcerange.T
        return np.clip(torque, low, high)

    def _read(self, env: int, engine: Engine) -> None:
        """Copy the motion of one robot into the arrays."""
        motion, arrays = engine.motion(loads=False), self._arrays
        arrays["qpos"][env] = np.concatenate((motion.base_position, motion.base_quaternion, motion.joint_position))
        linear = matrix(motion.base_quaternion) @ motion.base_linear_velocity
        arrays["qvel"][env] = np.concatenate((linear, motion.base_angular_velocity, motion.joint_velocity))
        arrays["sensordata"][env] = np.where(motion.foot_contact, TOUCHING, 0.0)

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Restore the poses and delay lines of `state`; see the module for exceptions."""
        super().load_state(state)
        # The engines hold the motion of before: every robot is placed anew at the next step.
        self._fresh[:], self._lost[:] = True, False

    def materialize(self, env: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Return one robot as a MuJoCo model and data, to render, without derived fields."""
        model = copy.copy(self.model)
        for name, values in self._fields.items():
            getattr(model, name)[...] = values[env]
        data = mujoco.MjData(model)
        for name in STATE:
            if name != "time":
                getattr(data, name)[...] = self._arrays[name][env]
        data.time = self.time[env]
        return model, data
