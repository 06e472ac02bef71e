"""Test stand for randomised robots: one joint at a time in the air, the whole robot hanging or sliding.

Robots are randomised through the `Randomizer` of training; formulas use the draws and the specification alone. Where a
friction law reads the load, gravity is along the joint's axis; where it reads the motor's torque, the motor is at its
limit, against a torque from outside that balances it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
import torch

from stiction.joints.friction import Coulomb, Law
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Joint, simulate
from stiction.robots.model import GRAVITY, Robot
from stiction.sim.fleet import BASE_DOFS, HELD, Fleet
from stiction.task.config import TaskCfg
from stiction.task.randomization import Randomizer, nominal_joints
from stiction.task.task_fleet import HostFleet

STEP = 0.15
"""Maximum step of a joint's target on the stand [rad]."""

STEP_TORQUE = 0.8
"""Maximum requested torque of a step, over the motor's limit: saturation would hide the effect."""

BENCH_SECONDS = 0.3
"""Length of a run on the stand [s]."""

SETTLE = 20
"""Physics steps without torque of a hanging robot, and of a joint before its run."""

FREE = int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT)


class Stand:
    """Robot of a task on a stand, at the task's physics step."""

    def __init__(self, spec: Robot, cfg: TaskCfg) -> None:
        """Prepare the stand; `cfg`: the task; friction is nominally that of its level."""
        self.spec, self.cfg = spec, cfg
        self.steps = np.minimum(STEP, STEP_TORQUE * spec.joint_values("torque_limit") / spec.joint_values("kp"))

    def fleet(self, num: int, **draws: float | np.ndarray) -> tuple[Fleet, Randomizer]:
        """Return `num` robots, nominal but for `draws`."""
        cfg = self.cfg
        fleet = Fleet(self.spec, num, cfg.timestep, cfg.decimation, joint_sensors=cfg.friction.loaded)
        randomizer = Randomizer(
            HostFleet(fleet, cfg.friction.laws), cfg.randomization, cfg.friction, nominal_joints(fleet, cfg.friction)
        )
        for name in ("armature", "damping", "stiffness", "motor_strength", "ground_friction"):
            getattr(randomizer.draws, name)[:] = 1.0
        for name, value in draws.items():
            getattr(randomizer.draws, name)[:] = torch.as_tensor(value, dtype=torch.float32)
        randomizer.apply(torch.arange(num))
        return fleet, randomizer

    def joint_motion(self, **draws: float) -> np.ndarray:
        """Return each joint's angle after a step of its target, all other joints held, (joints, samples)."""
        joints = self.spec.num_joints
        fleet, _ = self.fleet(joints, **draws)
        fleet.set_gravity((0.0, 0.0, 0.0))
        fleet.base_position[:, 2] += 1.0
        fleet.simulation.expand("opt.disableflags")[:] |= FREE
        fleet.clamp(~np.eye(joints, dtype=bool), base=range(BASE_DOFS))
        all_robots = np.arange(joints)
        fleet.set_targets(fleet.standing + np.diag(self.steps))
        motion = [fleet.joint_position[all_robots, all_robots] - fleet.standing]
        for _ in range(round(BENCH_SECONDS / fleet.timestep)):
            fleet.substep()
            motion.append(fleet.joint_position[all_robots, all_robots] - fleet.standing)
        return np.array(motion).T

    def joint_formula(
        self,
        armature: float = 1.0,
        damping: float = 1.0,
        stiffness: float = 1.0,
        motor_strength: float = 1.0,
        action_delay: float = 0.0,
    ) -> np.ndarray:
        """Return the solution of I q'' + B q' = τ for the same step, (joints, samples)."""
        fleet = Fleet(self.spec, 1, self.cfg.timestep, self.cfg.decimation)
        # The reference joins its targets by straight lines: a finer grid makes the step a step.
        links, step = fleet.link_inertia(), fleet.timestep / FINE
        nominal = nominal_joints(fleet, self.cfg.friction)
        after = np.arange(round(BENCH_SECONDS / step) + 1) >= round(action_delay / step)
        motion = []
        for j in range(self.spec.num_joints):
            joint = Joint(
                inertia=links[j] + armature * nominal.armature[j],
                viscous=damping * nominal.damping[j],
                friction=Coulomb(0.0),
            )
            gains = PDGains(
                kp=stiffness * fleet.nominal_kp[j],
                kd=fleet.nominal_kd[j],
                torque_limit=fleet.torque_limit[j],
                strength=motor_strength,
            )
            motion.append(simulate(joint, gains, step, self.steps[j] * after).position[::FINE])
        return np.array(motion)

    def hanging(self, gravity: tuple[float, float, float], **draws: float | np.ndarray) -> np.ndarray:
        """Return force [N] and moment about the base's origin [N m] of gravity on a robot held by its base, (6,)."""
        fleet, _ = self.fleet(1, **draws)
        fleet.set_gravity(gravity)
        fleet.base_position[:, 2] += 1.0
        fleet.simulation.expand("opt.disableflags")[:] |= FREE
        fleet.clamp(np.ones((1, self.spec.num_joints), bool), base=range(BASE_DOFS))
        # A held base is a scale: its velocity is the impulse over a huge inertia.
        for _ in range(SETTLE):
            fleet.substep()
        return HELD * fleet.qvel[0, :BASE_DOFS] / (SETTLE * fleet.timestep)

    def settled(self, seconds: float, **draws: float) -> Fleet:
        """Return a robot after a while of standing, joints held and the trunk kept from turning."""
        fleet, _ = self.fleet(1, **draws)
        fleet.clamp(np.ones((1, self.spec.num_joints), bool), base=range(3, BASE_DOFS))
        for _ in range(round(seconds / fleet.control_period)):
            fleet.step()
        return fleet

    def sunk(self, **draws: float) -> float:
        """Return the depth of the feet in the ground [m]."""
        fleet = self.settled(1.0, **draws)
        return float(self.spec.standing_height - fleet.base_position[0, 2])

    def slide(self, **draws: float) -> float:
        """Return the deceleration [m/s²] of a robot that slides on its feet for half a second, kept from turning."""
        fleet = self.settled(0.5, **draws)
        half_second = round(0.5 / fleet.control_period)
        fleet.qvel[:, 0] = start = 3.0
        for _ in range(half_second):
            fleet.step()
        return float(start - fleet.qvel[0, 0]) / (half_second * fleet.control_period)


SECONDS = 0.2
"""Length of a run [s]."""

FINE = 10
"""Steps of a formula's integration per physics step."""

SHARES = np.linspace(0.9, 1.1, 11)
"""Torques of the search for the break-away, over the bound at rest."""

COAST = 0.8
"""Time after which the coasting joint would stop under the friction at rest, over the length of the run."""

HOLD, SLIDE = 0.9, 1.3
"""Torques of the runs below and above the bound, over the bound at rest."""


@dataclass(frozen=True)
class LoadedJoint:
    """Properties of each joint in a law's formula, arrays of shape (joints,)."""

    level: np.ndarray
    """Friction f_c [N m], or the coefficient."""
    inertia: np.ndarray
    """Inertia of rotor and links, all other joints held [kg m²]."""
    damping: np.ndarray
    """[N m s/rad]."""
    limit: np.ndarray
    """Torque limit of the motor [N m]."""
    mass: np.ndarray
    """Mass of all links behind the joint [kg]."""
    outer_inertia: np.ndarray
    """Inertia of those links about an axis through their centre of mass, parallel to the joint's [kg m²]."""
    axis: np.ndarray
    """Direction of the joint's axis, shape (joints, 3)."""
    arm: np.ndarray
    """Vector from the axis to the centre of mass of the links behind, across the axis [m], shape (joints, 3)."""
    lever: np.ndarray
    """Vector from the first link's centre of mass to that of all links behind [m], shape (joints, 3)."""


class FrictionBench:
    """Runs in one batch: for each joint a search of break-away, a run below the bound, one above, one coasting."""

    def __init__(self, stand: Stand, multiplier: float, coefficient: float = 0.0, **numbers: float) -> None:
        """Prepare robots with `multiplier` times their friction, or instead a `coefficient` of the load.

        numbers: drawn numbers of the law, by name.
        """
        law = stand.cfg.friction.joint_law
        self.stand, self.law = stand, Law("load") if coefficient else Law(law.name, **law.numbers | numbers)
        self.joints, self.runs = stand.spec.num_joints, len(SHARES) + 3
        self.joint = np.repeat(np.arange(self.joints), self.runs)
        self.robot = np.arange(len(self.joint))
        draws = {"load_coefficient": coefficient} if coefficient else {"friction": multiplier}
        self.fleet, randomizer = stand.fleet(len(self.joint), **draws, **numbers)
        level = np.full(self.joints, coefficient) if coefficient else multiplier * randomizer.nominal.frictionloss
        self.known = loaded_joints(self.fleet, level)
        share = np.array([*SHARES, HOLD, SLIDE, 0.0])
        self.net = (self.bound_at_rest()[:, None] * share).ravel()
        self.speed = np.zeros_like(self.net)
        coasting = np.s_[self.runs - 1 :: self.runs]
        self.speed[coasting] = COAST * SECONDS * self.bound_at_rest() / self.known.inertia

    def bound(self, speed: np.ndarray, acceleration: np.ndarray, joint: np.ndarray) -> np.ndarray:
        """Return the friction of the formula [N m] for entries of some `joint` [rad/s, rad/s²]."""
        known = self.known
        force, torque = transmitted(known, speed, acceleration, joint)
        load = np.linalg.norm(force, axis=1) + np.linalg.norm(torque, axis=1)
        return known.level[joint] * self.law.factor(velocity=speed, load=load, torque=known.limit[joint])

    def bound_at_rest(self) -> np.ndarray:
        """Return the maximum friction at rest [N m], shape (joints,)."""
        zero = np.zeros(self.joints)
        return self.bound(zero, zero, np.arange(self.joints))

    @cached_property
    def measured(self) -> np.ndarray:
        """Speed of every run after each physics step [rad/s], shape (runs, samples)."""
        fleet, joint, robot = self.fleet, self.joint, self.robot
        if self.law.spec.loaded:
            axis = fleet.data(0)[1].xaxis[1:]
            fleet.simulation.expand("opt.gravity")[:] = GRAVITY * axis[joint]
        else:
            fleet.set_gravity((0.0, 0.0, 0.0))
        fleet.base_position[:, 2] += 1.0
        fleet.simulation.expand("opt.disableflags")[:] |= FREE
        held = np.ones((len(robot), self.joints), bool)
        held[robot, joint] = False
        fleet.clamp(held, base=range(BASE_DOFS))
        outside = fleet.simulation.bind("qfrc_applied")
        motor = np.zeros(len(robot))
        if "torque" in self.law.spec.reads:
            motor = self.known.limit[joint]
            targets = np.tile(fleet.standing, (len(robot), 1))
            # So far away that the controller stays at its limit.
            targets[robot, joint] += 100.0
            fleet.set_targets(targets)
        else:
            fleet.set_gains(np.zeros_like(fleet.friction), np.zeros_like(fleet.friction))
        outside[robot, BASE_DOFS + joint] = -motor
        for _ in range(SETTLE):
            fleet.substep()
        outside[robot, BASE_DOFS + joint] = self.net - motor
        fleet.joint_velocity[robot, joint] = self.speed
        trace = []
        for _ in range(round(SECONDS / fleet.timestep)):
            fleet.substep()
            trace.append(fleet.joint_velocity[robot, joint].copy())
        return np.array(trace).T

    @cached_property
    def expected(self) -> np.ndarray:
        """The same speeds by the formula [rad/s], shape (runs, samples)."""
        return self._formula(1.0)

    @cached_property
    def free(self) -> np.ndarray:
        """The same without friction."""
        return self._formula(0.0)

    def _formula(self, friction: float) -> np.ndarray:
        """Integrate I q'' + B q' = net - f, f the law's times `friction`; return the speeds.

        Load is late and smoothed.
        """
        known, joint, step = self.known, self.joint, self.fleet.timestep / FINE
        smoothing = self.law.spec.smoothing
        inertia, damping = known.inertia[joint], known.damping[joint]
        speed, acceleration, trace = self.speed.copy(), np.zeros_like(self.speed), []
        late = self.bound_at_rest()[joint]
        bound = friction * late
        for count in range(round(SECONDS / step)):
            if not self.law.spec.loaded:
                bound = friction * self.bound(speed, acceleration, joint)
            elif count % FINE == 0:
                bound = smoothing * bound + (1.0 - smoothing) * friction * late
                late = self.bound(speed, acceleration, joint)
            push = self.net - damping * speed
            # Friction is what would stop the joint within the step, or its bound.
            acceleration = (push - np.clip(push + inertia * speed / step, -bound, bound)) / inertia
            speed = speed + step * acceleration
            if (count + 1) % FINE == 0:
                trace.append(speed)
        return np.array(trace).T

    def hold(self) -> np.ndarray:
        """Return 1 minus the angle crept below the bound over that without friction, shape (joints,)."""
        run = np.s_[len(SHARES) :: self.runs]
        return 1.0 - np.abs(self.measured[run]).sum(1) / self.free[run].sum(1)

    def break_away(self) -> np.ndarray:
        """Return the torque at which each joint starts to move over the formula's, shape (joints,)."""
        angle = self.measured.sum(1).reshape(self.joints, -1)[:, : len(SHARES)]
        expected = self.expected.sum(1).reshape(self.joints, -1)[:, : len(SHARES)]
        first = np.argmax(expected > 0.0, axis=1)
        moves = angle > 0.5 * expected[np.arange(self.joints), first][:, None]
        width = SHARES[1] - SHARES[0]
        begin = np.where(moves.any(1), SHARES[np.argmax(moves, axis=1)], SHARES[-1] + width)
        # The joint moved at this torque and not at the one before: break-away is taken in the middle.
        return begin - width / 2

    def slowed(self, coasting: bool) -> tuple[np.ndarray, np.ndarray]:
        """Return the effect of friction on the speed of the sliding or coasting run: measured, expected; (joints,
        T).
        """
        run = np.s_[self.runs - (1 if coasting else 2) :: self.runs]
        free = self.free[run]
        return self.measured[run] - free, self.expected[run] - free


def transmitted(
    known: LoadedJoint, speed: np.ndarray, acceleration: np.ndarray, joint: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return force [N] and torque about the first link's centre of mass [N m] on the links behind, shape (n, 3).

    M a_c = F + M g and L' = T - lever x F about their own centre of mass, without products of inertia.
    """
    axis, arm = known.axis[joint], known.arm[joint]
    turning = acceleration[:, None] * np.cross(axis, arm) - np.square(speed)[:, None] * arm
    force = known.mass[joint, None] * (turning - GRAVITY * axis)
    about_own = (known.outer_inertia[joint] * acceleration)[:, None] * axis
    return force, about_own + np.cross(known.lever[joint], force)


def loaded_joints(fleet: Fleet, level: np.ndarray) -> LoadedJoint:
    """Return the load of each joint with gravity along its axis, robot standing; `level`: shape (joints,)."""
    model, data = fleet.data(0)
    mujoco.mj_comPos(model, data)
    axis, bodies = data.xaxis[1:], model.jnt_bodyid[1:]
    mass, outer = model.body_subtreemass[bodies], data.subtree_com[bodies]
    arm = outer - data.xanchor[1:]
    arm = arm - np.sum(arm * axis, axis=1)[:, None] * axis
    links, spec = fleet.link_inertia(), fleet.spec
    return LoadedJoint(
        level=np.asarray(level, float),
        inertia=links + spec.joint_values("armature"),
        damping=spec.joint_values("damping"),
        limit=spec.joint_values("torque_limit"),
        mass=mass,
        outer_inertia=links - mass * np.sum(arm * arm, axis=1),
        axis=axis,
        arm=arm,
        lever=outer - data.xipos[bodies],
    )
