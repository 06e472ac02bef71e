"""The whole robot in the air: masses, inertias, axes, joint order, and joint loads, against MuJoCo at small steps."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache

import numpy as np

from stiction.core.rotation import UPRIGHT, about_vector, angle_between, into_frame, matrix, small_turns
from stiction.engines.engine import Body, Make, Motion
from stiction.engines.ground import flat
from stiction.engines.mujoco_engine import MujocoEngine
from stiction.robots.model import GRAVITY, Link, Robot
from stiction.sim.fleet import Fleet
from stiction_experiments.engines.conformance.rig import Figure, drive, still, test_friction

FINE = 1e-4
"""Timestep of the reference [s]."""

SECONDS, HEIGHT = 0.4, 3.0
"""Length of a flight [s], and its initial height [m]."""

PUSH, BEAT, SPREAD = 0.015, 2.0, 0.5
"""Torque of every joint: amplitude, as an error of its controller [rad], frequency [Hz], phase between first and last
[rad]. All legs swing nearly together, so that the trunk turns, and no feet touch each other."""

OFF_CENTRE = (0.10, 0.05, 0.03)
"""Shift of the trunk's centre of mass [m], so that it is not the origin of the frame."""


def fly(make: Make, spec: Robot, timestep: float, friction: float, hold: float) -> Motion:
    """Return a flight, step by step; torques change every `hold` seconds, a multiple of the timestep."""
    body = replace(Body.nominal(spec), base_shift=OFF_CENTRE)
    phase, every = np.linspace(0.0, SPREAD, spec.num_joints), round(hold / timestep)
    pose = spec.joint_values("default_position")
    room = np.minimum(pose - spec.joint_values("lower"), spec.joint_values("upper") - pose)
    # A light joint would swing into its limits: half of the room is enough.
    inertia = spec.joint_values("armature") + Fleet(spec, 1).link_inertia()
    most = 0.5 * room * inertia * (2 * np.pi * BEAT) ** 2
    push, bound = np.minimum(PUSH * spec.joint_values("kp"), most), np.full(spec.num_joints, friction)

    def act(number: int, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        middle = (number // every + 0.5) * hold
        return push * np.cos(2 * np.pi * BEAT * middle + phase), bound

    return drive(make, body, timestep, SECONDS, act, HEIGHT)


@cache
def reference(spec: Robot, timestep: float, friction: float) -> Motion:
    """Return the flight in MuJoCo at small steps, every `timestep`, torques held over it."""
    motion = fly(MujocoEngine, spec, FINE, friction, timestep)
    every = round(timestep / FINE)
    return Motion(**{part.name: getattr(motion, part.name)[::every] for part in fields(Motion)})


def free_flight(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """Motion of joints and trunk, and joint loads, without and with dry friction."""
    truth, motion = reference(spec, timestep, 0.0), fly(make, spec, timestep, 0.0, timestep)
    friction = test_friction(spec)
    rubbed = fly(make, spec, timestep, friction, timestep).joint_position
    rubbed = rubbed - reference(spec, timestep, friction).joint_position
    turned = angle_between(motion.base_quaternion[-1], truth.base_quaternion[-1])
    # Forces belong to the step before, and the first ones to a fall that has only begun.
    loads = [getattr(motion, name)[2:] - getattr(truth, name)[2:] for name in ("joint_force", "joint_torque")]
    largest = [getattr(truth, name).max() for name in ("joint_force", "joint_torque")]
    return (
        Figure("joint angles", float(np.abs(motion.joint_position - truth.joint_position).max()), "rad", 0.02),
        Figure("joint angles, friction in every joint", float(np.abs(rubbed).max()), "rad", 0.02),
        Figure("place of the trunk", float(np.abs(motion.base_position - truth.base_position).max()), "m", 0.01),
        Figure("orientation of the trunk", turned, "rad", 0.01),
        Figure("force at the joints", float(np.abs(loads[0]).max() / largest[0]), "1", 0.03),
        Figure("torque at the joints", float(np.abs(loads[1]).max() / largest[1]), "1", 0.03),
        Figure("contacts in the air", float(motion.foot_contact.sum()), "feet", 0.0),
    )


def base_velocity(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """Velocities of the base against differences of its place and orientation: those of its frame, seen in it."""
    motion = fly(make, spec, timestep, 0.0, timestep)
    place, turn = motion.base_position, motion.base_quaternion
    moved = (place[2:] - place[:-2]) / (2 * timestep)
    seen = np.array([into_frame(q, v) for q, v in zip(turn[1:-1], moved, strict=True)])
    rate = small_turns(turn[:-2], turn[2:]) / (2 * timestep)
    # In a step gravity changes the velocity by this much; half of it is the difference's own error.
    fall = GRAVITY * timestep
    return (
        Figure("linear velocity", float(np.abs(seen - motion.base_linear_velocity[1:-1]).max()), "m/s", fall),
        Figure("angular velocity", float(np.abs(rate - motion.base_angular_velocity[1:-1]).max()), "rad/s", 0.05),
    )


def long_fall(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """A fall of 1.5 s: no drag, and no largest speed."""
    body = Body.nominal(spec)
    motion = drive(make, body, timestep, 1.5, still(body), 20.0)
    return (Figure("speed", float(-motion.base_linear_velocity[-1, 2] / (GRAVITY * 1.5) - 1.0), "1", 1e-3),)


def joint_order(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """Response of every joint and of the trunk to a torque at each joint, all legs at different angles."""
    angles = spec.joint_values("default_position") + np.random.default_rng(0).uniform(-0.15, 0.15, spec.num_joints)
    responses, wanted = (_responses(maker, spec, timestep, angles) for maker in (make, MujocoEngine))
    error = np.abs(responses - wanted).max(axis=0) / np.abs(wanted).max(axis=0)
    engine = make(Body.nominal(spec), flat(), timestep)
    engine.reset(angles, np.array([0.0, 0.0, HEIGHT]), UPRIGHT)
    joints = spec.num_joints
    return (
        Figure("angles after a reset", float(np.abs(engine.motion().joint_position - angles).max()), "rad", 1e-6),
        Figure("joints under a torque at each", float(error[:joints].max()), "1", 0.01),
        Figure("trunk under a torque at each joint", float(error[joints:].max()), "1", 0.01),
    )


def _responses(make: Make, spec: Robot, timestep: float, angles: np.ndarray) -> np.ndarray:
    """Return velocities of joints and trunk after a step of 1 N m at each joint, less those of the fall; (J, J + 6)."""
    body = replace(Body.nominal(spec), damping=np.zeros(spec.num_joints), base_shift=OFF_CENTRE)
    engine = make(body, flat(), timestep)
    rows = []
    for torque in (np.zeros(spec.num_joints), *np.eye(spec.num_joints)):
        engine.reset(angles, np.array([0.0, 0.0, HEIGHT]), UPRIGHT)
        engine.step(torque, np.zeros(spec.num_joints))
        motion = engine.motion()
        rows.append(np.concatenate((motion.joint_velocity, motion.base_linear_velocity, motion.base_angular_velocity)))
    return np.array(rows[1:]) - rows[0]


def hanging_legs(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """Loads of the joints of a robot on a stand: the weight behind each of them."""
    body = Body.nominal(spec, fixed=True)
    motion = drive(make, body, timestep, 0.2, still(body), HEIGHT)
    force, torque = hanging_weight(spec.links, spec.joint_values("default_position"))
    return (
        Figure("force", float(np.abs(motion.joint_force[-1] / force - 1.0).max()), "1", 0.01),
        Figure("torque", float(np.abs(motion.joint_torque[-1] - torque).max() / torque.max()), "1", 0.02),
    )


def hanging_weight(tree: tuple[Link, ...], angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return |F| [N] and |T| [N m] at joints with these angles, at rest, the base level; (J,) each.

    T is about the centre of mass of the link behind the joint.
    """
    frames: list[tuple[np.ndarray, np.ndarray]] = []
    for link, angle in zip(tree, angles, strict=True):
        turn, place = frames[link.parent] if link.parent >= 0 else (np.eye(3), np.zeros(3))
        frames.append((turn @ matrix(about_vector(np.array(link.axis), angle)), place + turn @ link.origin))
    centres = np.array([place + turn @ link.com for link, (turn, place) in zip(tree, frames, strict=True)])
    force, torque = np.zeros(len(tree)), np.zeros((len(tree), 3))
    for number, link in enumerate(tree):
        weight = np.array([0.0, 0.0, -GRAVITY * link.mass])
        carrier = number
        while carrier >= 0:
            force[carrier] -= weight[2]
            torque[carrier] += np.cross(centres[number] - centres[carrier], weight)
            carrier = tree[carrier].parent
    return force, np.linalg.norm(torque, axis=-1)
