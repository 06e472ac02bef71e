"""One joint against the exact solution: dry friction that holds, breaks away and brakes by Coulomb's law.

The robot is bolted to a stand and turned so that the axis of its outermost joint is vertical: no weight acts on it. All
other joints are locked. The link is a rigid body on a hinge, I q'' + B q' = τ − friction, and `stiction.joints` has its
motion in closed form, stick and slip included.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stiction.core.rotation import UPRIGHT, about, about_vector
from stiction.engines.engine import Make, Motion
from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Joint, Trajectory, simulate
from stiction.robots.model import Robot, link_poses
from stiction_experiments.engines.conformance.rig import HELD, Figure, drive, on_stand, outermost, test_friction

Pair = tuple[float, float]
"""Torque and bound of friction [N m]."""

PROFILE = ((0.0, 0.9), (1.0, 0.9), (1.5, 1.4), (1.8, 1.4), (1.81, 0.0), (2.6, 0.0))
"""Torque over friction [-] at times [s], straight between: held, broken away at 1.1 s, driven, let go, at rest."""

DRIVEN, LET_GO, END = 1.0, 1.8, 2.6
"""Times in the profile [s]."""

MOVED = 1e-3
"""A joint that has moved this far has broken away [rad]."""

AT_REST = 1e-3
"""Speed under which a joint is at rest [rad/s]."""

AGAINST = 5.0
"""Torque with which a joint is driven against its limit [N m]."""

SLOW, AMPLITUDE, LEVEL = 0.5, 0.3, 0.1
"""Frequency [Hz] and largest amplitude [rad] of the controlled joint's target, friction over its torque limit."""


def hinge_inertia(spec: Robot) -> float:
    """Return the inertia of the outermost link about its joint, rotor included [kg m²]."""
    number = outermost(spec)
    link, axis = spec.links[number], np.array(spec.links[number].axis)
    lever = np.linalg.norm(np.cross(axis, link.com))
    return float(spec.joints[number].armature + axis @ link.inertia_matrix @ axis + link.mass * lever**2)


def upended(spec: Robot, angles: np.ndarray) -> np.ndarray:
    """Return the orientation of the base in which the axis of the outermost joint points up, shape (4,)."""
    number = outermost(spec)
    axis = link_poses(spec, angles)[1][number] @ np.array(spec.links[number].axis)
    turn = np.cross(axis, [0.0, 0.0, 1.0])
    if (length := np.linalg.norm(turn)) < 1e-9:
        return UPRIGHT if axis[2] > 0 else about(0, np.pi)
    return about_vector(turn / length, float(np.arccos(np.clip(axis[2], -1.0, 1.0))))


def inside(spec: Robot) -> float:
    """Return an angle of the outermost joint with room on both sides [rad]."""
    joint = spec.joints[outermost(spec)]
    return joint.lower + min(0.3, (joint.upper - joint.lower) / 4)


def fitted(spec: Robot, travel: float) -> float:
    """Return the share of torques and friction with which the outermost joint stays in its range, 1 where it does.

    travel: how far it moves with all of them [rad]; its motion is proportional to them.
    """
    room = spec.joints[outermost(spec)].upper - inside(spec)
    return min(1.0, 0.7 * room / abs(travel))


def exact(
    spec: Robot, gains: PDGains, friction: float, timestep: float, target: np.ndarray, load: np.ndarray
) -> Trajectory:
    """Return the outermost link's motion in closed form, from rest at the first target; all of shape (samples,)."""
    joint = Joint(hinge_inertia(spec), float(on_stand(spec).damping[outermost(spec)]), Coulomb(friction))
    return simulate(joint, gains, timestep, target, position=float(target[0]), load=load)


def _drive(
    make: Make, spec: Robot, timestep: float, start: float, joint: Callable[[int, float, float], Pair]
) -> Motion:
    """Return the motion of the outermost joint, under `joint(number, q, q')` -> torque and bound of friction [N m]."""
    angles, own = spec.joint_values("default_position"), outermost(spec)
    angles[own] = start
    torque, bound = np.zeros(spec.num_joints), np.full(spec.num_joints, HELD)

    def act(number: int, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        torque[own], bound[own] = joint(number, motion.joint_position[own], motion.joint_velocity[own])
        return torque, bound

    return drive(make, on_stand(spec), timestep, END, act, 2.0, upended(spec, angles), angles)


@dataclass(frozen=True)
class BreakAway:
    """A joint that is held, breaks away and comes to rest under `PROFILE`; arrays of shape (steps + 1,)."""

    friction: float
    """Its dry friction [N m]."""
    time: np.ndarray
    """[s]."""
    load: np.ndarray
    """Torque on the joint [N m]."""
    angle: np.ndarray
    speed: np.ndarray
    truth: Trajectory


def break_away(make: Make, spec: Robot, timestep: float) -> BreakAway:
    """Return the motion of a joint under `PROFILE` in an engine, and the exact one."""
    friction, start = test_friction(spec), inside(spec)
    times, levels = np.array(PROFILE).T
    steps = round(END / timestep)
    grid = np.arange(steps + 1) * timestep
    profile, still = np.interp(grid, times, levels), np.full(steps + 1, start)
    # No controller: kp must be positive, and is as good as none.
    whole = exact(spec, PDGains(1e-9, 0.0), friction, timestep, still, friction * profile)
    friction *= fitted(spec, float(whole.position[-1]) - start)
    # Torque is constant over a step: that of its middle gives a ramp its exact impulse.
    torque = friction * np.interp(grid[:-1] + timestep / 2, times, levels)
    motion = _drive(make, spec, timestep, start, lambda number, angle, speed: (torque[number], friction))
    load = friction * profile
    truth = exact(spec, PDGains(1e-9, 0.0), friction, timestep, still, load)
    return BreakAway(
        friction,
        grid,
        load,
        motion.joint_position[:, outermost(spec)],
        motion.joint_velocity[:, outermost(spec)],
        truth,
    )


def friction_of_one_joint(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """Hold, break away and decay of a joint under a known torque."""
    seen = break_away(make, spec, timestep)
    angle, speed, load, truth = seen.angle, seen.speed, seen.load, seen.truth
    steps, start = len(angle) - 1, float(truth.position[0])
    driven, let_go = round(DRIVEN / timestep), round(LET_GO / timestep)
    gone = [np.argmax(np.abs(path - path[driven]) > MOVED) for path in (angle, truth.position)]
    stopped = [steps - np.argmax(np.abs(path[::-1]) > AT_REST) for path in (speed, truth.velocity)]
    distance = truth.position[-1] - start
    return (
        Figure("creep in 1 s under 0.9 of the friction", float(angle[driven] - start), "rad", 1e-3),
        Figure("torque of break-away", float(load[gone[0]] / load[gone[1]] - 1.0), "1", 0.01),
        Figure("speed after break-away", float(speed[let_go] / truth.velocity[let_go] - 1.0), "1", 0.01),
        Figure("when it stops", float(stopped[0] - stopped[1]) * timestep, "s", 0.005),
        Figure("way until it stops", float((angle[-1] - truth.position[-1]) / distance), "1", 0.01),
        Figure("creep at rest", float(angle[-1] - angle[stopped[0]]), "rad", 1e-4),
    )


def changing_friction(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """A bound that is lowered for a while releases a joint under a constant torque, and stops it when it rises again.

    In between q' = (τ - f) / B (1 - exp(-B t / I)).
    """
    friction, damping = test_friction(spec), float(on_stand(spec).damping[outermost(spec)])
    rate = damping / hinge_inertia(spec)
    friction *= fitted(spec, 0.5 * friction / damping * (0.3 - (1.0 - np.exp(-rate * 0.3)) / rate) * 1.5)
    free = range(round(0.5 / timestep), round(0.8 / timestep))

    def loosened(number: int, angle: float, speed: float) -> Pair:
        return friction, 0.5 * friction if number in free else 4.0 * friction

    motion = _drive(make, spec, timestep, inside(spec), loosened)
    wanted = 0.5 * friction / damping * (1.0 - np.exp(-rate * 0.3))
    speed = motion.joint_velocity[:, outermost(spec)]
    return (
        Figure("speed before it is loosened", float(np.abs(speed[: free.start]).max()), "rad/s", 1e-3),
        Figure("speed when it is held again", float(speed[free.stop] / wanted - 1.0), "1", 0.01),
        Figure("speed at the end", float(speed[-1]), "rad/s", 1e-3),
    )


def joint_limit(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """A joint that is driven against the end of its range stays there."""
    joint = spec.joints[outermost(spec)]
    upper, away = joint.upper, min(0.5, (joint.upper - joint.lower) / 2)
    motion = _drive(make, spec, timestep, upper - away, lambda number, angle, speed: (AGAINST, 0.0))
    return (Figure("angle past the limit", float(motion.joint_position[-1, outermost(spec)] - upper), "rad", 0.03),)


def friction_under_control(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """Stick and slip of a joint that follows a slow sine under its controller, against the exact motion."""
    steps = round(END / timestep)
    joint = spec.joints[outermost(spec)]
    friction, gains = LEVEL * joint.torque_limit, PDGains(joint.kp, joint.kd)
    room = min(joint.default_position - joint.lower, joint.upper - joint.default_position)
    amplitude = min(AMPLITUDE, 0.8 * room)
    grid = np.arange(steps + 1) * timestep
    target = joint.default_position + amplitude * np.sin(2 * np.pi * SLOW * grid)
    truth = exact(spec, gains, friction, timestep, target, np.zeros(steps + 1))

    def controlled(number: int, angle: float, speed: float) -> Pair:
        return gains.kp * (target[number] - angle) - gains.kd * speed, friction

    motion = _drive(make, spec, timestep, float(target[0]), controlled)
    error = motion.joint_position[:, outermost(spec)] - truth.position
    return (Figure("controlled joint", float(np.abs(error).max() / amplitude), "1", 0.01),)
