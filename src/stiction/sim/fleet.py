"""Fleet: copies of one robot on one clock, with named views, per-robot joint physics and dry friction.

Training and evaluation drive robots through this one class, so that a policy meets the same joints in both. NumPy only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import mujoco
import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.core.rotation import about, into_frames, yaws
from stiction.joints.friction import Law, Signal
from stiction.robots.mjcf import SOLVERS, build_model, foot_geometries, standing_inertia
from stiction.robots.model import DELAY_SAMPLES, Robot, leans_too_far, too_low
from stiction.robots.physics import EXACT, SMALLEST_YIELD, PhysicsCfg
from stiction.robots.terrain import Terrain
from stiction.sim.native import NativeSimulation, Simulation

BASE_DOFS = 6
"""Degrees of freedom of the floating base, first in the velocity vector."""

CONTACT_FORCE = 1.0
"""Minimum load of a foot in contact [N]."""

HELD = 1e6
"""Inertia added to clamped joints, see `Fleet.clamp` [kg or kg m²]; the load on them still shows in their motion."""


class Fleet:
    """Fleet of `num_envs` robots of one kind, each with its joints, masses, ground friction and, if wanted, terrain.

    All arrays are float64 and live: `friction`, `damping`, `armature` are written by the caller and act from the next
    step (armature and masses after `set_const`). Functions in `before_step` are called with the fleet before every
    physics step, those in `after_step` after it, with the ids of robots that blew up in it, those in `after_reset` with
    reset ids. `ground` [m] is written by the caller except on flat ground. `torque`, `foot_force`, `joint_load` lag one
    step.
    """

    def __init__(
        self,
        spec: Robot,
        num_envs: int,
        timestep: float = 0.005,
        decimation: int = 4,
        threads: int = 1,
        backend: Callable[[mujoco.MjModel, int, int], Simulation] = NativeSimulation,
        terrain: Terrain | None = None,
        joint_sensors: bool = False,
        physics: PhysicsCfg = EXACT,
    ) -> None:
        """Build the robots in their standing pose, without dry friction.

        `decimation`: physics steps of `timestep` [s] in one control period; `backend`: function that makes the
        simulation from model, number and threads; `terrain`: courses of the robots; `joint_sensors`: measure
        `joint_load`.
        """
        if num_envs < 1 or decimation < 1 or not 0 < timestep <= 0.02:
            raise ConfigurationError(
                f"fleet of {num_envs} robots, physics step {timestep} s, decimation {decimation}: "
                "expected at least one robot, one step, and a step of at most 0.02 s"
            )
        self.spec, self.num_envs, self.timestep, self.decimation = spec, num_envs, timestep, decimation
        self.terrain = Terrain(np.zeros(num_envs)) if terrain is None else terrain
        self.model = build_model(spec, timestep, self.terrain.boxes, joint_sensors, physics)
        self.simulation = simulation = backend(self.model, num_envs, threads)
        joints = slice(BASE_DOFS, None)
        self.qpos, self.qvel = simulation.bind("qpos"), simulation.bind("qvel")
        self.base_position = self.qpos[:, :3]
        self.base_quaternion = self.qpos[:, 3:7]
        self.base_angular_velocity = self.qvel[:, 3:6]
        self.joint_position = self.qpos[:, 7:]
        self.joint_velocity = self.qvel[:, joints]
        self.joint_acceleration = simulation.bind("qacc")[:, joints]
        self.torque = simulation.bind("actuator_force")
        sensors, feet = simulation.bind("sensordata"), len(spec.feet)
        self.foot_force, self._joint_wrench = sensors[:, :feet], sensors[:, feet:]
        self._stiffness = physics.stiffness if physics.plastic else None
        if self._stiffness is None:
            self.friction = simulation.expand("dof_frictionloss")[:, joints]
        else:
            # Each joint has a yielding spring, see `robots.physics`; `plastic` is the angle at which it is slack.
            self._slack = simulation.bind("plastic")
            # The free joint of the base comes first, and has no spring.
            self._yield = simulation.expand("jnt_springyield")[:, -self._slack.shape[1] :]
            self.friction = np.zeros_like(self._slack)
        self.damping = simulation.expand("dof_damping")[:, joints]
        self.armature = simulation.expand("dof_armature")[:, joints]
        self._gain = simulation.expand("actuator_gainprm")
        self._bias = simulation.expand("actuator_biasprm")
        self.delay = simulation.expand("actuator_delay")
        self._delayed_targets = simulation.bind("history").reshape(num_envs, spec.num_joints, -1)[..., -DELAY_SAMPLES:]
        self._bind_base_and_feet()
        self.nominal_kp = spec.joint_values("kp")
        self.nominal_kd = spec.joint_values("kd")
        self.standing = spec.joint_values("default_position")
        self.torque_limit = spec.joint_values("torque_limit")
        self.targets = simulation.bind("ctrl")
        self.friction[:] = 0.0
        self.blown_up = np.zeros(num_envs, np.int64)
        self.ground = np.zeros(num_envs)
        self.before_step: list[Callable[[Fleet], None]] = []
        self.after_step: list[Callable[[Fleet, np.ndarray], None]] = []
        self.after_reset: list[Callable[[np.ndarray], None]] = []
        self._by_torque, self._disturbed = False, False
        self.reset(np.arange(num_envs))

    def _bind_base_and_feet(self) -> None:
        """Expand the base's mass and centre of mass, and the feet's friction on the ground."""
        base = self.model.body("base").id
        self._feet = np.array([self.model.geom(name).id for name in foot_geometries(self.spec)])
        self.base_mass = self.simulation.expand("body_mass")[:, base]
        self.base_com = self.simulation.expand("body_ipos")[:, base]
        self._geom_friction = self.simulation.expand("geom_friction")
        boxes = [self.model.geom(f"obstacle{number}").id for number in range(len(self.terrain.boxes))]
        self._boxes = slice(boxes[0], boxes[-1] + 1) if boxes else None
        if self._boxes is not None:
            self._geom_position = self.simulation.expand("geom_pos")[:, self._boxes]
            self._geom_quaternion = self.simulation.expand("geom_quat")[:, self._boxes]

    @property
    def control_period(self) -> float:
        """Time between two actions [s]."""
        return self.timestep * self.decimation

    @property
    def base_linear_velocity(self) -> np.ndarray:
        """Velocity of the base's origin in the base frame [m/s], shape (N, 3); a copy."""
        return into_frames(self.base_quaternion, self.qvel[:, :3])

    @property
    def yaw(self) -> np.ndarray:
        """Heading of the base in the world [rad], shape (N,); a copy."""
        return yaws(self.base_quaternion)

    @property
    def foot_contact(self) -> np.ndarray:
        """True for each foot that carries load, shape (N, legs); a copy."""
        return self.foot_force > CONTACT_FORCE

    @property
    def joint_load(self) -> np.ndarray:
        """Force [N] and torque about its link's centre of mass [N m] of each joint, link frame, (N, joints, 2, 3)."""
        return self._joint_wrench.reshape(self.num_envs, -1, 2, 3)

    def set_ground_friction(self, value: np.ndarray, ids: np.ndarray | slice = slice(None)) -> None:
        """Set the sliding friction coefficient between feet and ground, shape (len(ids),) or a number."""
        rows = np.arange(self.num_envs)[ids]
        self._geom_friction[rows[:, None], self._feet, 0] = np.broadcast_to(value, rows.shape)[:, None]

    def set_contact_time(self, value: np.ndarray, ids: np.ndarray | slice = slice(None)) -> None:
        """Set the time constant of the contact of feet and ground [s], shape (len(ids),) or a number."""
        rows = np.arange(self.num_envs)[ids]
        softness = self.simulation.expand("geom_solref")
        softness[rows[:, None], self._feet, 0] = np.broadcast_to(value, rows.shape)[:, None]

    def set_gains(self, kp: np.ndarray, kd: np.ndarray, ids: np.ndarray | slice = slice(None)) -> None:
        """Set the controllers: torque = kp (target - q) - kd q', clipped to the limit; (len(ids), joints)."""
        if self._by_torque:
            raise ValueError("the joints are driven by torque; they have no gains")
        self._gain[ids, :, 0] = kp
        self._bias[ids, :, 1] = -np.asarray(kp)
        self._bias[ids, :, 2] = -np.asarray(kd)

    def drive_by_torque(self) -> np.ndarray:
        """Make the actuators motors, without gains and delay; return their torques [N m], (N, joints), to be written.

        A function in `before_step` turns `targets` into them; they are clipped to the limits.
        """
        command = self.targets
        self.targets = command.copy()
        self.set_gains(np.zeros_like(command), np.zeros_like(command))
        self._gain[:, :, 0] = 1.0
        self.delay[:] = 0.0
        self._by_torque = True
        return command

    def set_targets(self, targets: np.ndarray) -> None:
        """Set the joint targets of every robot [rad], shape (N, joints)."""
        self.targets[...] = targets

    def set_const(self, ids: np.ndarray) -> None:
        """Make changes of mass, centre of mass and armature take effect in the robots `ids`."""
        self.simulation.set_const(ids)

    def push(self, velocity: np.ndarray, ids: np.ndarray) -> None:
        """Add `velocity` [m/s] to the base's horizontal velocity in the world, shape (len(ids), 2)."""
        self.qvel[ids, :2] += velocity

    def disturb(self, force: np.ndarray | None = None, torque: np.ndarray | None = None) -> None:
        """Push every robot throughout the next control period.

        `force`: on the base's centre of mass, in the world [N], (N, 3); `torque`: on each joint in addition to its
        motor's [N m], (N, joints). Omitted values stay unchanged.
        """
        if force is not None:
            self.simulation.bind("xfrc_applied")[:, self.model.body("base").id, :3] = force
        if torque is not None:
            self.simulation.bind("qfrc_applied")[:, BASE_DOFS:] = torque
        self._disturbed = True

    def _clear_disturbances(self) -> None:
        """Set the forces and torques of `disturb` to zero."""
        self.simulation.bind("xfrc_applied")[:, self.model.body("base").id, :3] = 0.0
        self.simulation.bind("qfrc_applied")[:, BASE_DOFS:] = 0.0
        self._disturbed = False

    def step(self) -> np.ndarray:
        """Advance one control period; return the ids of robots that blew up, reset to standing and counted."""
        if self.before_step or self.after_step:
            unstable = np.zeros(self.num_envs, bool)
            for _ in range(self.decimation):
                unstable[self.substep()] = True
            blown_up = np.flatnonzero(unstable)
        else:
            self._write_friction()
            blown_up = self.simulation.step(self.decimation)
        if len(blown_up):
            self.blown_up[blown_up] += 1
            self.reset(blown_up)
        if self._disturbed:
            self._clear_disturbances()
        return blown_up

    def substep(self) -> np.ndarray:
        """Take one physics step; return the ids of robots that blew up, for the caller to reset."""
        for act in self.before_step:
            act(self)
        self._write_friction()
        blown_up = self.simulation.step(1)
        for look in self.after_step:
            look(self, blown_up)
        return blown_up

    def _write_friction(self) -> None:
        """Write `friction` as the bounds of the sliders, if any."""
        if self._stiffness is not None:
            np.maximum(self.friction / self._stiffness, SMALLEST_YIELD, out=self._yield)

    def use_rows(self) -> None:
        """Hold the joints by rows of the solver from now on, in place of sliders."""
        if self._stiffness is None:
            return
        rows = self.simulation.expand("dof_frictionloss")[:, BASE_DOFS:]
        rows[:] = self.friction
        self.friction, self._stiffness = rows, None
        self.simulation.expand("jnt_stiffness")[:] = 0.0
        self.simulation.expand("opt.solver")[:] = int(SOLVERS[EXACT.solver_name])
        self.simulation.expand("opt.iterations")[:] = EXACT.solver_iterations

    def place_terrain(self, ids: np.ndarray, difficulty: np.ndarray, uniform: np.ndarray) -> None:
        """Make new courses for the robots `ids`; see `Terrain.place`."""
        self.terrain.place(ids, difficulty, uniform)
        self.show_terrain(ids)

    def show_terrain(self, ids: np.ndarray) -> None:
        """Move the boxes of the robots `ids` to their courses."""
        if self._boxes is not None:
            self._geom_position[ids] = self.terrain.position[ids]
            self._geom_quaternion[ids] = self.terrain.quaternion[ids]

    def ground_around(self, points: np.ndarray) -> np.ndarray:
        """Return the height of the ground [m] at points in the frame of base and heading, (P, 2); (N, P)."""
        yaw = self.yaw[:, None]
        cosine, sine = np.cos(yaw), np.sin(yaw)
        forward, left = points.T
        around = np.empty((self.num_envs, len(points), 2))
        around[..., 0] = self.base_position[:, :1] + (cosine * forward - sine * left)
        around[..., 1] = self.base_position[:, 1:2] + (sine * forward + cosine * left)
        return self.terrain.height(around)

    def reset(
        self,
        ids: np.ndarray,
        joint_position: np.ndarray | None = None,
        heading: np.ndarray | None = None,
        velocity: np.ndarray | None = None,
        position: np.ndarray | None = None,
    ) -> None:
        """Stand the robots `ids` on level ground at the origin, or at `position` [m], delay lines filled.

        `joint_position` [rad], `heading` [rad]; `velocity`: of the base, linear in the world and angular in the base
        frame.
        """
        if not len(ids):
            return
        # A delay line is empty at first, and a motor at its end would pull towards angle 0 in what is derived here.
        delay = self.delay[ids].copy()
        self.delay[ids] = 0.0
        self.simulation.reset(ids)
        self.delay[ids] = delay
        self.targets[ids] = self.standing
        # A delayed motor would else first be given the targets of the episode before.
        self._delayed_targets[ids] = self.standing[:, None]
        if joint_position is not None:
            self.joint_position[ids] = joint_position
        if position is not None:
            self.base_position[ids, :2] = position
        if heading is not None:
            self.base_quaternion[ids] = about(2, heading)
        if velocity is not None:
            self.qvel[ids, :6] = velocity
        if self._stiffness is not None:
            # Springs are slack where the joints were put; elsewhere they would begin under load.
            self._slack[ids] = self.joint_position[ids]
        for forget in self.after_reset:
            forget(ids)

    def fallen(self) -> np.ndarray:
        """Return whether each robot has fallen or is about to, shape (N,)."""
        height = self.base_position[:, 2] - self.ground
        return leans_too_far(self.base_quaternion) | too_low(height, self.spec.standing_height)

    def set_gravity(self, gravity: tuple[float, float, float]) -> None:
        """Set gravity [m/s²] for every robot: zero for a bench test, tilted to test the terrain."""
        self.simulation.expand("opt.gravity")[:] = gravity

    def clamp(self, held: np.ndarray, base: Sequence[int] = ()) -> None:
        """Clamp the joints in `held`, (N, joints) bool, and degrees of freedom of the base, 0 to 5, by huge
        inertias.
        """
        # The tolerance is relative to the mean inertia: the solver would stop far from the solution.
        self.simulation.expand("opt.tolerance")[:] = 0.0
        self.armature[held] = HELD
        self.simulation.expand("dof_armature")[:, list(base)] = HELD
        self.set_const(np.arange(self.num_envs))

    def link_inertia(self) -> np.ndarray:
        """Return the inertia of the links at each joint, standing, all others held [kg m²], (joints,)."""
        return np.diag(standing_inertia(self.model))[BASE_DOFS:] - self.model.dof_armature[BASE_DOFS:]

    def stale_constants(self, env: int) -> float:
        """Return the largest relative error of the constants derived from masses and inertias."""
        used, fresh = (self.simulation.materialize(env)[0] for _ in range(2))
        mujoco.mj_setConst(fresh, mujoco.MjData(fresh))
        names = ("body_subtreemass", "body_invweight0", "dof_invweight0", "actuator_acc0")
        pairs = ((np.ravel(getattr(used, name)), np.ravel(getattr(fresh, name))) for name in names)
        return max(float(np.max(np.abs(a - b) / np.maximum(np.abs(b), 1e-9), initial=0.0)) for a, b in pairs)

    def data(self, env: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Return one robot as a separate model and data, positions computed, to render or inspect."""
        model, data = self.simulation.materialize(env)
        mujoco.mj_forward(model, data)
        return model, data


def load_size(load: np.ndarray) -> np.ndarray:
    """Return |F| + |T|, shape (N, joints), of `Fleet.joint_load`, shape (N, joints, 2, 3)."""
    return np.sqrt(np.square(load).sum(axis=-1)).sum(axis=-1)


SIGNALS: dict[Signal, Callable[[Fleet], np.ndarray]] = {
    "velocity": lambda fleet: fleet.joint_velocity,
    "load": lambda fleet: load_size(fleet.joint_load),
    "torque": lambda fleet: fleet.torque,
}
"""Inputs of friction laws, shape (N, joints)."""


class JointFriction:
    """Dry friction of a fleet's joints under one law, or under several whose bounds add up: `Fleet.friction`.

    The bound is the law's level, a torque [N m] or a coefficient, (N, joints), times a factor of the law's inputs;
    motor torque and transmitted load act one physics step late. `load` counts contacts, unlike the joint friction of
    PhysX.
    """

    def __init__(self, fleet: Fleet, *laws: Law) -> None:
        """Start without friction. Raises `StictionError` for a load without sensors, or two sensed laws."""
        sensed = [number for number, law in enumerate(laws) if law.spec.sensed]
        if len(sensed) > 1:
            raise ConfigurationError(
                f"the friction laws {' and '.join(law.name for law in laws)} each read a sensor; give one of them"
            )
        for law in laws:
            if law.spec.loaded and not fleet.joint_load.size:
                raise ConfigurationError(
                    f"the friction law {law.name!r} needs a fleet with joint sensors; make it with joint_sensors"
                )
        self.fleet, self.laws = fleet, laws
        self.levels = [np.zeros_like(fleet.friction) for _ in laws]
        self._bounds = [np.zeros_like(fleet.friction) for _ in laws]
        self.numbers = [
            {name: np.full_like(fleet.friction, value) for name, value in law.numbers.items()} for law in laws
        ]
        """Numbers of each law, of every joint, by name, each (N, joints)."""
        self._sensed = sensed[0] if sensed else None
        self._restored: np.ndarray | None = None
        self._fresh = np.ones(fleet.num_envs, bool)
        fleet.friction[:] = 0.0
        if any(law.spec.reads for law in laws):
            fleet.before_step.append(self.act)
            fleet.after_reset.append(self.forget)

    def set_level(
        self,
        *levels: np.ndarray,
        ids: np.ndarray | slice = slice(None),
        numbers: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        """Set the level of each law for the robots `ids`, shape (len(ids), joints), and update their bounds.

        numbers: of the laws, by name, where robots differ in them, (len(ids), joints) or (len(ids), 1); unchanged by
        default.
        """
        for level, values in zip(self.levels, levels, strict=True):
            level[ids] = values
        for law in self.numbers:
            for name, values in (numbers or {}).items():
                if name in law:
                    law[name][ids] = values
        self.forget(ids)

    def forget(self, ids: np.ndarray | slice) -> None:
        """Set the bounds of the robots `ids`, which were just reset, from their present state."""
        for law, level, bound in zip(self.laws, self.levels, self._bounds, strict=True):
            now = level[ids] * self.factor(law, ids)
            # Of a robot that blew up nothing is known before its reset.
            bound[ids] = np.where(np.isfinite(now), now, bound[ids])
        self._fresh[ids] = True
        self.fleet.friction[ids] = sum(bound[ids] for bound in self._bounds)

    def act(self, fleet: Fleet) -> None:
        """Write the bounds of the coming step; those of a robot that blew up stay until its reset."""
        for number, (law, level, last) in enumerate(zip(self.laws, self.levels, self._bounds, strict=True)):
            # In the first step from a checkpoint the sensors have measured nothing; what they had is in the checkpoint.
            known = self._restored is not None and number == self._sensed
            bound = level * (self._restored if known else self.factor(law))
            if law.spec.smoothing:
                smoothing = np.where(self._fresh, 0.0, law.spec.smoothing)[:, None]
                bound = smoothing * last + (1.0 - smoothing) * bound
            np.copyto(last, bound, where=np.isfinite(bound))
        self._restored = None
        self._fresh[:] = False
        fleet.friction[:] = sum(self._bounds)

    def factor(self, law: Law, ids: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Return the present factor of the level of one law, shape (len(ids), joints), or one number."""
        numbers = {name: values[ids] for name, values in self.numbers[self.laws.index(law)].items()}
        return np.asarray(law.factor(**{name: SIGNALS[name](self.fleet)[ids] for name in law.spec.reads}, **numbers))

    def state(self) -> dict[str, np.ndarray]:
        """Return the state of the next step that is neither in the simulation nor in `levels`.

        Empty for laws without inputs.
        """
        if not any(law.spec.reads for law in self.laws):
            return {}
        state = {"friction": self.fleet.friction.copy()}
        if self._sensed is not None:
            bound, measured = self._bounds[self._sensed], self.factor(self.laws[self._sensed])
            state |= {"bound": bound.copy(), "measured": measured.copy(), "fresh": self._fresh.copy()}
        return state

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Restore a `state`; the next step is then bit-identical."""
        self.forget(slice(None))
        if self._sensed is not None and state:
            self._bounds[self._sensed][:] = state["bound"]
            self._restored, self._fresh = state["measured"].copy(), state["fresh"].copy()
        # Older states are without it.
        self.fleet.friction[:] = state.get("friction", sum(self._bounds))
