"""A fleet: many copies of one robot on one clock, with named views and per-robot joint physics. NumPy only.

Training and evaluation drive robots through this one class, so that a policy meets the same joints in both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.core.rotation import about, into_frames, yaws
from stiction.robots.mjcf import build_model, foot_geometries, standing_inertia
from stiction.robots.model import DELAY_SAMPLES, Robot, leans_too_far, too_low
from stiction.robots.physics import EXACT, SMALLEST_YIELD, PhysicsCfg
from stiction.robots.terrain import Terrain
from stiction.sim.native import NativeSimulation
from stiction.sim.protocol import Simulation

BASE_DOFS = 6
"""Degrees of freedom of the floating base, first in the velocity vector."""

CONTACT_FORCE = 1.0
"""Load above which a foot counts as standing [N]."""

HELD = 1e6
"""Inertia added to what is held, see `Fleet.clamp` [kg or kg m²]: what it takes is still read from its motion."""


class Fleet:
    """`num_envs` robots of one kind, each with its own joints, masses, ground friction and, if wanted, terrain.

    All arrays are float64 and live: `base_*`, `joint_*` and `torque` are what the simulation holds now; `friction`,
    `damping`, `armature` are written by the caller and act from the next step (armature, masses and centres of mass
    after `set_const`). Functions in `before_step` are called with the fleet before every physics step (friction that
    depends on load or speed, another motor than the PD law), those in `after_step` after it, with the ids of robots
    that blew up in it, those in `after_reset` with the ids of robots that were reset. `ground` is the height of the
    ground under each robot [m], written by the caller on other than flat ground. `torque`, `foot_force` and
    `joint_load` lag one physics step; right after a reset they are those of the standing
    pose.
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

        `timestep`: physics step [s]; `decimation`: physics steps in one control period; `backend`: makes the batched
        simulation from model, number and threads; `terrain`: courses of the robots, flat ground without;
        `joint_sensors`: measure `joint_load`; `physics`: how dry friction is simulated.
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
        """Whether each foot carries load, shape (N, legs); a copy."""
        return self.foot_force > CONTACT_FORCE

    @property
    def joint_load(self) -> np.ndarray:
        """Force [N] and torque [N m] that each joint transmits, shape (N, joints, 2, 3); with `joint_sensors` only.

        The torque is about the centre of mass of the link behind the joint; both in that link's frame.
        """
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

        They act from the next physics step, clipped to the limits. `targets` then do nothing by themselves: a function
        in `before_step` turns them into torques.
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
        """Push every robot throughout the next control period, and no longer, nor after a reset.

        `force`: on the base's centre of mass, in the world [N], shape (N, 3); `torque`: on each joint beside that of
        its motor and not limited by it [N m], shape (N, joints). What is not given is left as it was.
        """
        if force is not None:
            self.simulation.bind("xfrc_applied")[:, self.model.body("base").id, :3] = force
        if torque is not None:
            self.simulation.bind("qfrc_applied")[:, BASE_DOFS:] = torque
        self._disturbed = True

    def _calm(self) -> None:
        """Take away what `disturb` put on."""
        self.simulation.bind("xfrc_applied")[:, self.model.body("base").id, :3] = 0.0
        self.simulation.bind("qfrc_applied")[:, BASE_DOFS:] = 0.0
        self._disturbed = False

    def step(self) -> np.ndarray:
        """Advance one control period; return the ids of robots that blew up, ascending, reset to standing and counted.

        The caller ends their episode. The reset here keeps NaN from reaching any observation.
        """
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
            self._calm()
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
        """Make `friction` the bounds of the yielding springs, where there are any."""
        if self._stiffness is not None:
            np.maximum(self.friction / self._stiffness, SMALLEST_YIELD, out=self._yield)

    def place_terrain(self, ids: np.ndarray, difficulty: np.ndarray, uniform: np.ndarray) -> None:
        """Lay the courses of the robots `ids` out anew; see `Terrain.place`."""
        self.terrain.place(ids, difficulty, uniform)
        self.show_terrain(ids)

    def show_terrain(self, ids: np.ndarray) -> None:
        """Put the boxes of the robots `ids` where their courses have them."""
        if self._boxes is not None:
            self._geom_position[ids] = self.terrain.position[ids]
            self._geom_quaternion[ids] = self.terrain.quaternion[ids]

    def ground_around(self, points: np.ndarray) -> np.ndarray:
        """Return the height of the ground [m] at points given in the frame of base and heading, (P, 2); (N, P)."""
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
        """Stand the robots `ids` on level ground at the origin, delay lines filled with the standing pose.

        `joint_position`: (len(ids), joints) [rad]; `heading`: (len(ids),) [rad]; `velocity`: initial velocity of the
        base, (len(ids), 6), linear in the world and angular in the base frame; `position`: elsewhere than at the
        origin, (len(ids), 2) [m].
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
        """Return whether each robot lies or is about to, shape (N,)."""
        height = self.base_position[:, 2] - self.ground
        return leans_too_far(self.base_quaternion) | too_low(height, self.spec.standing_height)

    def set_gravity(self, gravity: tuple[float, float, float]) -> None:
        """Set gravity [m/s²] for every robot: off for a bench test, tilted to find a height."""
        self.simulation.expand("opt.gravity")[:] = gravity

    def clamp(self, held: np.ndarray, base: Sequence[int] = ()) -> None:
        """Hold the joints marked in `held`, (N, joints) bool, by a huge inertia, `HELD`.

        base: degrees of freedom of the base that are held too: 0 to 2 linear, 3 to 5 angular.
        """
        # The tolerance is relative to the mean inertia: the solver would stop far from the solution.
        self.simulation.expand("opt.tolerance")[:] = 0.0
        self.armature[held] = HELD
        self.simulation.expand("dof_armature")[:, list(base)] = HELD
        self.set_const(np.arange(self.num_envs))

    def link_inertia(self) -> np.ndarray:
        """Return the inertia that links put on each joint, standing, all others held [kg m²], (joints,)."""
        return np.diag(standing_inertia(self.model))[BASE_DOFS:] - self.model.dof_armature[BASE_DOFS:]

    def stale_constants(self, env: int) -> float:
        """Return the largest relative error of the constants derived from masses and inertias."""
        used, fresh = (self.simulation.materialize(env)[0] for _ in range(2))
        mujoco.mj_setConst(fresh, mujoco.MjData(fresh))
        names = ("body_subtreemass", "body_invweight0", "dof_invweight0", "actuator_acc0")
        pairs = ((np.ravel(getattr(used, name)), np.ravel(getattr(fresh, name))) for name in names)
        return max(float(np.max(np.abs(a - b) / np.maximum(np.abs(b), 1e-9), initial=0.0)) for a, b in pairs)

    def data(self, env: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Return one robot as a model and data of its own, positions computed, to render or inspect."""
        model, data = self.simulation.materialize(env)
        mujoco.mj_forward(model, data)
        return model, data
