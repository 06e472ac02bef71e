"""One joint at a time under its law of friction: whether it holds, when it breaks away, how it slows down.

Joints hang in the air, the base and all other joints held. The robots come from the same `Randomizer` as in training.
What loads them is known: under `load`, gravity along the joint's own axis, which bends the joint and does not turn it;
under `effort`, the motor at its limit, against a torque from outside that balances it. Beside each motion stands the
one that the law's formula gives, from the specification alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from stiction.locomotion.stand import Stand
from stiction.sim.fleet import BASE_DOFS, Fleet
from stiction.sim.friction import LoadFriction, stribeck_bound

GRAVITY = 9.81
"""Along the joint's axis [m/s²]."""

SECONDS = 0.2
"""Length of a run [s]."""

SETTLE = 20
"""Physics steps before it in which nothing turns the joint."""

FREE = int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT)
"""A joint on the bench may turn as far as it likes."""

FINE = 10
"""Steps of the formula's integration in one physics step."""

SHARES = np.linspace(0.9, 1.1, 11)
"""Torques of the search for the break-away, over the bound at rest."""

COAST = 0.8
"""When the joint that coasts would come to rest if friction stayed as it is at rest, over the length of the run."""

HOLD, SLIDE = 0.9, 1.3
"""Torques of the runs below and above the bound, over the bound at rest."""


@dataclass(frozen=True)
class LoadedJoint:
    """What the law's formula knows of each joint, arrays of shape (joints,)."""

    level: np.ndarray
    """Friction f_c [N m], or the coefficient."""
    inertia: np.ndarray
    """Rotor and links, all other joints held [kg m²]."""
    damping: np.ndarray
    """[N m s/rad]."""
    limit: np.ndarray
    """Torque of the motor at its limit [N m]."""
    mass: np.ndarray
    """Of all links behind the joint [kg]."""
    inertia_behind: np.ndarray
    """Of those links about an axis through their centre of mass, parallel to the joint's [kg m²]."""
    axis: np.ndarray
    """Direction of the joint's axis, shape (joints, 3)."""
    arm: np.ndarray
    """From the axis to the centre of mass of the links behind, across the axis [m], shape (joints, 3)."""
    lever: np.ndarray
    """From the first link's centre of mass to that of all links behind [m], shape (joints, 3)."""


class FrictionBench:
    """All runs in one batch: for each joint the search, a run below the bound, one above it, and one that coasts."""

    def __init__(self, stand: Stand, multiplier: float) -> None:
        """Prepare robots whose friction is `multiplier` times the nominal one."""
        self.stand, self.law = stand, stand.cfg.friction.joint_law
        self.joints, self.runs = stand.spec.num_joints, len(SHARES) + 3
        self.joint = np.repeat(np.arange(self.joints), self.runs)
        self.robot = np.arange(len(self.joint))
        self.fleet, randomizer = stand.fleet(len(self.joint), friction=multiplier)
        self.known = loaded_joints(self.fleet, multiplier * randomizer.nominal.frictionloss)
        share = np.array([*SHARES, HOLD, SLIDE, 0.0])
        self.net = (self.bound_at_rest()[:, None] * share).ravel()
        self.speed = np.zeros_like(self.net)
        coasting = np.s_[self.runs - 1 :: self.runs]
        self.speed[coasting] = COAST * SECONDS * self.bound_at_rest() / self.known.inertia

    def bound(self, speed: np.ndarray, acceleration: np.ndarray, joint: np.ndarray) -> np.ndarray:
        """Return the friction that the formula gives [N m] for entries of some `joint` [rad/s, rad/s²]."""
        known, level = self.known, self.known.level[joint]
        if self.law.name == "stribeck":
            return stribeck_bound(level, self.law.static_ratio, self.law.stribeck_velocity, speed)
        if self.law.name == "effort":
            return level * known.limit[joint]
        if self.law.name == "load":
            force, torque = transmitted(known, speed, acceleration, joint)
            return level * (np.linalg.norm(force, axis=1) + np.linalg.norm(torque, axis=1))
        return level

    def bound_at_rest(self) -> np.ndarray:
        """Return the largest friction at rest [N m], shape (joints,)."""
        zero = np.zeros(self.joints)
        return self.bound(zero, zero, np.arange(self.joints))

    @cached_property
    def measured(self) -> np.ndarray:
        """Speed of every run after each physics step [rad/s], shape (runs, samples)."""
        fleet, joint, robot = self.fleet, self.joint, self.robot
        if self.law.name == "load":
            axis = fleet.data(0)[1].xaxis[1:]
            fleet.simulation.expand("opt.gravity")[:] = GRAVITY * axis[joint]
        else:
            fleet.set_gravity((0.0, 0.0, 0.0))
        fleet.base_position[:, 2] += 1.0
        fleet.simulation.expand("opt.disableflags")[:] |= FREE
        held = np.ones((len(robot), self.joints), bool)
        held[robot, joint] = False
        fleet.clamp(held, base=True)
        outside = fleet.simulation.bind("qfrc_applied")
        motor = np.zeros(len(robot))
        if self.law.name == "effort":
            motor = self.known.limit[joint]
            targets = np.tile(fleet.standing, (len(robot), 1))
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
        """Integrate I q'' + B q' = net - f, f the law's times `friction`.

        Of `load` f is the law's as the simulator has it: measured a physics step ago, part of the old one kept. Without
        that delay a joint that coasts would differ by 0.5 % at c = 0.12, by up to 16 % at 0.48.
        """
        known, joint, step = self.known, self.joint, self.fleet.timestep / FINE
        inertia, damping = known.inertia[joint], known.damping[joint]
        speed, acceleration, trace = self.speed.copy(), np.zeros_like(self.speed), []
        late = self.bound_at_rest()[joint]
        bound = friction * late
        for count in range(round(SECONDS / step)):
            if self.law.name != "load":
                bound = friction * self.bound(speed, acceleration, joint)
            elif count % FINE == 0:
                bound = LoadFriction.kept * bound + (1.0 - LoadFriction.kept) * friction * late
                late = self.bound(speed, acceleration, joint)
            push = self.net - damping * speed
            # Friction takes the whole of what moves the joint, or its bound.
            wanted = push + inertia * speed / step
            acceleration = (push - np.clip(wanted, -bound, bound)) / inertia
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
        return begin - width / 2

    def slowed(self, coasting: bool) -> tuple[np.ndarray, np.ndarray]:
        """Return what friction did to the speed of the run that slides or coasts: measured, expected; (joints, T)."""
        run = np.s_[self.runs - (1 if coasting else 2) :: self.runs]
        free = self.free[run]
        return self.measured[run] - free, self.expected[run] - free


def transmitted(
    known: LoadedJoint, speed: np.ndarray, acceleration: np.ndarray, joint: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return force [N] and torque about the first link's centre of mass [N m] on the links behind, shape (n, 3).

    M a_c = F + M g and L' = T - lever x F about their own centre of mass, which goes round the axis. The links'
    products of inertia are left out: they are thin, or lie in the plane of the motion.
    """
    axis, arm = known.axis[joint], known.arm[joint]
    turning = acceleration[:, None] * np.cross(axis, arm) - np.square(speed)[:, None] * arm
    force = known.mass[joint, None] * (turning - GRAVITY * axis)
    about_own = (known.inertia_behind[joint] * acceleration)[:, None] * axis
    return force, about_own + np.cross(known.lever[joint], force)


def loaded_joints(fleet: Fleet, level: np.ndarray) -> LoadedJoint:
    """Return what loads each joint where gravity is along its axis, robot standing; `level`: shape (joints,)."""
    model, data = fleet.data(0)
    mujoco.mj_comPos(model, data)
    axis, bodies = data.xaxis[1:], model.jnt_bodyid[1:]
    mass, behind = model.body_subtreemass[bodies], data.subtree_com[bodies]
    arm = behind - data.xanchor[1:]
    arm = arm - np.sum(arm * axis, axis=1)[:, None] * axis
    links, spec = fleet.link_inertia(), fleet.spec
    return LoadedJoint(
        level=np.asarray(level, float),
        inertia=links + spec.joint_values("armature"),
        damping=spec.joint_values("damping"),
        limit=spec.joint_values("torque_limit"),
        mass=mass,
        inertia_behind=links - mass * np.sum(arm * arm, axis=1),
        axis=axis,
        arm=arm,
        lever=behind - data.xipos[bodies],
    )
