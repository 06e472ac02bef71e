"""The robot on the ground: its pose, which feet touch, the loads of its joints, and how it slides.

With locked joints it is a rigid table, whose pose on level ground and slopes and whose slide down a slope are known;
under its controllers it is compared with MuJoCo at small steps.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from stiction.core.rotation import UPRIGHT, about, angle_between, into_frame, quaternion_of
from stiction.engines.engine import Body, Make, Motion
from stiction.engines.ground import Ground, course
from stiction.engines.mujoco_engine import MujocoEngine
from stiction.robots.model import GRAVITY, Robot, foot_places, link_poses
from stiction.robots.shapes import bounds
from stiction.robots.terrain import LANDING, RAMP
from stiction_experiments.engines.conformance.rig import HELD, Act, Figure, drive, hold, on_stand, outermost, still

FINE = 5e-4
"""Timestep of the reference [s]."""

SECONDS = 1.0
"""How long the robot stands [s]."""

LANDED = 0.3
"""Time for the robot to settle before contacts count [s]."""

CARRIERS = 3
"""Fewest feet that carry a robot with locked joints."""

RAISED = 0.08
"""Height to which a foot is lifted [m]."""

SOLE = 0.02
"""Least half extent of a sole, forward and sideways [m], on which a robot with locked joints stands."""


def stand(make: Make, body: Body, timestep: float, act: Act, angles: np.ndarray) -> Motion:
    """Return the motion of a robot put down on the plane with these joint angles [rad], (J,)."""
    return drive(make, body, timestep, SECONDS, act, body.spec.standing_height, angles=angles)


@cache
def reference(spec: Robot) -> Motion:
    """Return the motion of MuJoCo at small steps under its controllers."""
    body, angles = Body.nominal(spec), spec.joint_values("default_position")
    return stand(MujocoEngine, body, FINE, hold(body, angles), angles)


def standing(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """A table of all legs, then the robot under its controllers, on which a biped does not stand."""
    body, angles = Body.nominal(spec), spec.joint_values("default_position")
    table = stand(make, body, timestep, still(body), angles)
    figures = (
        Figure("height, joints locked", float(table.base_position[-1, 2] - spec.standing_height), "m", 3e-3),
        Figure("drift, joints locked", float(np.linalg.norm(table.base_position[-1, :2])), "m", 3e-3),
        Figure("creep of locked joints in 1 s", float(np.abs(table.joint_position[-1] - angles).max()), "rad", 5e-3),
    )
    if len(spec.feet) <= CARRIERS:
        return figures
    motion, truth = stand(make, body, timestep, hold(body, angles), angles), reference(spec)
    down = round(LANDED / timestep)
    apart = np.abs(motion.joint_position[-1] - truth.joint_position[-1]).max()
    force = motion.joint_force[-1].mean() / truth.joint_force[-1].mean() - 1.0
    return (
        *figures,
        Figure("height, against MuJoCo", float(motion.base_position[-1, 2] - truth.base_position[-1, 2]), "m", 5e-3),
        Figure("tilt", angle_between(motion.base_quaternion[-1], UPRIGHT), "rad", 0.02),
        Figure("joint angles, against MuJoCo", float(apart), "rad", 0.03),
        Figure("mean force at the joints", float(force), "1", 0.05),
        Figure("feet that lose the ground", float((~motion.foot_contact[down:]).sum()), "1", 0.0),
    )


def foot_contact(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """A robot with locked joints on some of its feet, until each was lifted once: exactly the others touch."""
    wrong = 0
    for lifted, shift in _lifts(spec):
        body = replace(Body.nominal(spec), base_shift=shift)
        motion = stand(make, body, timestep, still(body), raised(spec, lifted))
        wrong += int((motion.foot_contact[round(LANDED / timestep) :] == lifted).sum())
    return (Figure("feet that read wrong", float(wrong), "1", 0.0),)


def raised(spec: Robot, lifted: np.ndarray) -> np.ndarray:
    """Return the standing pose with some feet lifted by `RAISED` [rad], shape (J,); `lifted`: bool, (feet,).

    Each leg follows the gradient of its foot's height, within its limits.
    """
    angles, slope = spec.joint_values("default_position"), 1e-6
    lower, upper = spec.joint_values("lower") + 0.02, spec.joint_values("upper") - 0.02
    for foot in np.flatnonzero(lifted):
        chain, start = spec.chain(spec.feet[foot].link), foot_places(spec, angles)[foot, 2]
        for _ in range(200):
            height = foot_places(spec, angles)[foot, 2]
            if height > start + RAISED:
                break
            gradient = np.zeros(len(angles))
            for joint in chain:
                moved = angles + slope * np.eye(len(angles))[joint]
                gradient[joint] = (foot_places(spec, moved)[foot, 2] - height) / slope
            angles = np.clip(angles + 0.05 * gradient / np.linalg.norm(gradient), lower, upper)
    return angles


def has_soles(spec: Robot) -> bool:
    """Return whether one foot carries a robot with locked joints: each has a sole, and none is a ball."""
    turn = link_poses(spec, spec.joint_values("default_position"))[1]
    extents = [np.subtract(*bounds(foot.shapes, turn[foot.link])[::-1]) / 2 for foot in spec.feet]
    balls = any(foot.is_ball for foot in spec.feet)
    return not balls and all(min(extent[:2]) >= SOLE for extent in extents)


def _lifts(spec: Robot) -> list[tuple[np.ndarray, tuple[float, float, float]]]:
    """Return which feet are lifted, bool, (feet,), and the shift of the trunk's centre of mass [m], trial by trial.

    One contact group, then the other, where each can carry the robot; else one foot at a time, with the centre of mass
    shifted so that the weight is over the middle of the other feet.
    """
    groups = spec.groups()
    if groups is not None and min(np.bincount(groups)) >= CARRIERS:
        return [(groups != group, (0.0, 0.0, 0.0)) for group in (0, 1)]
    lifts = []
    for lifted in np.eye(len(spec.feet), dtype=bool):
        angles = raised(spec, lifted)
        position, turn = link_poses(spec, angles)
        parts = [(spec.base.mass, np.array(spec.base.com))]
        parts += [
            (link.mass, position[number] + turn[number] @ np.array(link.com)) for number, link in enumerate(spec.links)
        ]
        centre = sum(mass * place for mass, place in parts) / spec.mass
        x, y, _ = (foot_places(spec, angles)[~lifted].mean(axis=0) - centre) * spec.mass / spec.base.mass
        lifts.append((lifted, (float(x), float(y), 0.0)))
    return lifts


def on_its_back(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """A robot that lies on its back rests on the box of its trunk, and no foot touches; a biped would not lie still."""
    if len(spec.feet) <= CARRIERS:
        return ()
    body = Body.nominal(spec)
    top = float(bounds(spec.base.shapes)[1][2])
    motion = drive(make, body, timestep, SECONDS, still(body), top + 0.01, about(0, np.pi))
    return (
        Figure("height of the trunk", float(motion.base_position[-1, 2] - top), "m", 3e-3),
        Figure("feet that read wrong", float(motion.foot_contact.sum()), "1", 0.0),
    )


STEP, ANGLE = 0.1, 0.2
"""Height of a stair [m], angle of the slope [rad]."""

TERRAIN_SECONDS = 1.0
"""How long the robot stands or slides [s]."""

SLIPPERY, STEEP = 0.2, 0.3
"""Friction of the feet [-] and angle [rad] of the slide."""

SLIDE = 0.5
"""Length of the slide [s]."""

BAR, SWING = (0.03, 0.1, 0.03), 0.5
"""Half sizes of the bar [m], and the angle of the shank from it at the start [rad]."""


def terrain(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """A table on the landing of stairs, and on a slope; a biped only on the landing."""
    figures = [_landing(make, spec, timestep, "landing of stairs", course("stairs", STEP))]
    if len(spec.feet) > CARRIERS:
        figures += _slope(make, spec, timestep, "slope", course("slope", ANGLE))
    return tuple(figures)


def _landing(make: Make, spec: Robot, timestep: float, name: str, ground: Ground) -> Figure:
    body = Body.nominal(spec)
    top = float(ground.height(np.zeros((1, 2)))[0]) + spec.standing_height
    motion = drive(make, body, timestep, TERRAIN_SECONDS, still(body), top, ground=ground)
    return Figure(f"height, {name}", float(motion.base_position[-1, 2] - top), "m", 3e-3)


def _on_slope(
    make: Make, spec: Robot, timestep: float, ground: Ground, angle: float, friction: float, seconds: float
) -> Motion:
    """Return the motion of a table on a slope, in the frame of the slope: x up, z normal to it, from its middle [m]."""
    body = replace(Body.nominal(spec), ground_friction=friction)
    turn = about(1, -angle)
    middle = np.array([-LANDING - RAMP / 2 * np.cos(angle), 0.0, RAMP / 2 * np.sin(angle)])
    away = np.array([-np.sin(angle), 0.0, np.cos(angle)])
    start = middle + spec.standing_height * away
    motion = drive(make, body, timestep, seconds, still(body), start, turn, ground=ground)
    return replace(motion, base_position=into_frame(turn, motion.base_position - middle))


def _slope(make: Make, spec: Robot, timestep: float, name: str, ground: Ground) -> list[Figure]:
    motion = _on_slope(make, spec, timestep, ground, ANGLE, 1.0, TERRAIN_SECONDS)
    place = motion.base_position[-1]
    return [
        Figure(f"height, {name}", float(place[2] - spec.standing_height), "m", 3e-3),
        Figure(f"tilt, {name}", angle_between(motion.base_quaternion[-1], about(1, -ANGLE)), "rad", 5e-3),
        Figure(f"creep down in 1 s, {name}", float(place[0]), "m", 0.02),
    ]


def foot_friction(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """A table that slides down a slope is accelerated by g (sin α - μ cos α), on boxes; a biped would fall over."""
    if len(spec.feet) <= CARRIERS:
        return ()
    motion = _on_slope(make, spec, timestep, course("slope", STEEP), STEEP, SLIPPERY, SLIDE)
    steps = len(motion.base_position) - 1
    speed = -(motion.base_position[-1, 0] - motion.base_position[steps // 2, 0]) / ((steps - steps // 2) * timestep)
    # The mean over the second half is the speed in its middle.
    wanted = GRAVITY * (np.sin(STEEP) - SLIPPERY * np.cos(STEEP)) * 0.75 * SLIDE
    return (Figure("speed of the slide", float(speed / wanted - 1.0), "1", 0.05),)


def shank_contact(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """An outermost link that swings against a bar in the air, in the middle of its capsule, stops there.

    Robots whose outermost link is no single capsule that catches on obstacles, straight from its joint, have no figure.
    """
    number, height = outermost(spec), 1.0 + spec.standing_height
    link, joint = spec.links[number], spec.joints[number]
    bones = [shape for shape in link.shapes if shape.contact == "obstacles"]
    if len(bones) != 1 or bones[0].kind != "capsule" or np.hypot(*bones[0].position[:2]) > 1e-9:
        return ()
    position, turn = link_poses(spec, spec.joint_values("default_position"))
    middle = turn[number] @ np.array(bones[0].position)
    along = middle / np.linalg.norm(middle)
    axis = turn[number] @ np.array(link.axis)
    # The bar lies across the link at the angle at which they meet, on the side to which a larger angle leads.
    ahead = np.cross(axis, along)
    bar = position[number] + [0.0, 0.0, height] + middle + (BAR[2] + bones[0].size[0]) * ahead
    ground = Ground(np.array([BAR]), bar[None], np.array(quaternion_of(np.column_stack((along, axis, -ahead))))[None])
    angles = spec.joint_values("default_position")
    angles[number] -= min(SWING, 0.8 * (joint.default_position - joint.lower))
    torque, bound = np.zeros(spec.num_joints), np.full(spec.num_joints, HELD)
    torque[number], bound[number] = 1.0, 0.2
    body = on_stand(spec)
    act: Act = lambda step, motion: (torque, bound)  # noqa: E731
    motion = drive(make, body, timestep, TERRAIN_SECONDS, act, height, angles=angles, ground=ground)
    return (
        Figure("angle past the bar", float(motion.joint_position[-1, number] - joint.default_position), "rad", 0.02),
    )
