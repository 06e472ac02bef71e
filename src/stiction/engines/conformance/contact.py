"""The robot on the ground: its pose, which feet touch, the loads of its joints, and how it slides.

With locked joints it is a rigid table, whose pose on level ground and slopes and whose slide down a slope are known;
under its controllers it is compared with MuJoCo at small steps.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from stiction.core.rotation import UPRIGHT, about, angle_between, into_frame
from stiction.engines.conformance.rig import HELD, Act, Figure, drive, hold, still
from stiction.engines.engine import Body, Make, Motion
from stiction.engines.ground import Ground, course, sampled
from stiction.engines.mujoco_engine import MujocoEngine
from stiction.robots.model import GRAVITY, Robot
from stiction.robots.terrain import LANDING, RAMP
from stiction.robots.tree import SHANK_RADIUS, links

FINE = 5e-4
"""Timestep of the reference [s]."""

SECONDS = 1.0
"""How long the robot stands [s]."""

LANDED = 0.3
"""Time for the robot to settle before contacts count [s]."""

CARRIERS = 3
"""Fewest feet that carry a robot with locked joints."""

RAISED = (0.5, -0.8)
"""What bends thigh and knee of a leg that is lifted [rad]."""


def stand(make: Make, body: Body, timestep: float, act: Act, angles: np.ndarray) -> Motion:
    """Return the motion of a robot put down on the plane with these joint angles [rad], (J,)."""
    return drive(make, body, timestep, SECONDS, act, body.spec.standing_height, angles=angles)


@cache
def reference(spec: Robot) -> Motion:
    """Return the motion of MuJoCo at small steps under its controllers."""
    body, angles = Body.nominal(spec), spec.joint_values("default_position")
    return stand(MujocoEngine, body, FINE, hold(body, angles), angles)


def standing(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """A table of all legs, then the robot under its controllers."""
    body, angles = Body.nominal(spec), spec.joint_values("default_position")
    table = stand(make, body, timestep, still(body), angles)
    motion, truth = stand(make, body, timestep, hold(body, angles), angles), reference(spec)
    down = round(LANDED / timestep)
    apart = np.abs(motion.joint_position[-1] - truth.joint_position[-1]).max()
    force = motion.joint_force[-1].mean() / truth.joint_force[-1].mean() - 1.0
    return (
        Figure("height, joints locked", float(table.base_position[-1, 2] - spec.standing_height), "m", 3e-3),
        Figure("drift, joints locked", float(np.linalg.norm(table.base_position[-1, :2])), "m", 3e-3),
        Figure("creep of locked joints in 1 s", float(np.abs(table.joint_position[-1] - angles).max()), "rad", 5e-3),
        Figure("height, against MuJoCo", float(motion.base_position[-1, 2] - truth.base_position[-1, 2]), "m", 5e-3),
        Figure("tilt", angle_between(motion.base_quaternion[-1], UPRIGHT), "rad", 0.02),
        Figure("joint angles, against MuJoCo", float(apart), "rad", 0.03),
        Figure("mean force at the joints", float(force), "1", 0.05),
        Figure("feet that lose the ground", float((~motion.foot_contact[down:]).sum()), "1", 0.0),
    )


def foot_contact(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """A robot with locked joints on some of its feet, until each was lifted once: exactly the others touch."""
    wrong = 0
    for lifted, centre in _lifts(spec):
        angles = spec.joint_values("default_position").reshape(-1, 3)
        angles[lifted, 1:] += RAISED
        body = replace(Body.nominal(spec), base_com=centre)
        motion = stand(make, body, timestep, still(body), angles.ravel())
        wrong += int((motion.foot_contact[round(LANDED / timestep) :] == lifted).sum())
    return (Figure("feet that read wrong", float(wrong), "1", 0.0),)


def _lifts(spec: Robot) -> list[tuple[np.ndarray, tuple[float, float, float]]]:
    """Return which legs are lifted, bool, (legs,), and the trunk's centre of mass then [m], trial by trial.

    One contact group, then the other, where each can carry the robot; else, on four legs, one leg at a time, with the
    centre of mass shifted so that the weight is over the middle of the other feet.
    """
    groups = spec.groups()
    if min(np.bincount(groups)) >= CARRIERS:
        return [(groups != group, (0.0, 0.0, 0.0)) for group in (0, 1)]
    mounts, share = np.array([leg.mount for leg in spec.legs]), spec.base.mass / spec.mass
    lifts = []
    for lifted in np.eye(len(groups), dtype=bool):
        x, y, _ = (mounts[~lifted].mean(axis=0) - mounts.mean(axis=0)) / share
        lifts.append((lifted, (float(x), float(y), 0.0)))
    return lifts


def on_its_back(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """A robot that lies on its back rests on the box of its trunk, and no foot touches."""
    body = Body.nominal(spec)
    half = spec.base.size[2] / 2
    motion = drive(make, body, timestep, SECONDS, still(body), half + 0.01, about(0, np.pi))
    return (
        Figure("height of the trunk", float(motion.base_position[-1, 2] - half), "m", 3e-3),
        Figure("feet that read wrong", float(motion.foot_contact.sum()), "1", 0.0),
    )


STEP, ANGLE, CELL = 0.1, 0.2, 0.1
"""Height of a stair [m], angle of the slope [rad], cell of the height field [m]."""

TERRAIN_SECONDS = 1.0
"""How long the robot stands or slides [s]."""

SLIPPERY, STEEP = 0.2, 0.3
"""Friction of the feet [-] and angle [rad] of the slide."""

SLIDE = 0.5
"""Length of the slide [s]."""

BAR, SWING = (0.03, 0.1, 0.03), 0.5
"""Half sizes of the bar [m], and the angle of the shank from it at the start [rad]."""

COURSE = (3.0, 3.0)
"""Half the extent of the height field [m]."""


def terrain(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """A table on the landing of the stairs, on a slope made of boxes, and on the same slope as a height field."""
    stairs, slope = course("stairs", STEP), course("slope", ANGLE)
    figures = [
        _landing(make, spec, timestep, "landing of stairs", stairs),
        _landing(make, spec, timestep, "landing of a height field", sampled(stairs, COURSE, CELL)),
    ]
    for name, ground in (("slope", slope), ("slope of a height field", sampled(slope, COURSE, CELL))):
        figures += _slope(make, spec, timestep, name, ground)
    return tuple(figures)


def _landing(make: Make, spec: Robot, timestep: float, name: str, ground: Ground) -> Figure:
    """Return the height of a table on level ground above where it should be."""
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
    """Return how a table stands on a slope that is not too steep for its feet."""
    motion = _on_slope(make, spec, timestep, ground, ANGLE, 1.0, TERRAIN_SECONDS)
    place = motion.base_position[-1]
    return [
        Figure(f"height, {name}", float(place[2] - spec.standing_height), "m", 3e-3),
        Figure(f"tilt, {name}", angle_between(motion.base_quaternion[-1], about(1, -ANGLE)), "rad", 5e-3),
        Figure(f"creep down in 1 s, {name}", float(place[0]), "m", 0.02),
    ]


def foot_friction(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """A table that slides down a slope is accelerated by g (sin α - μ cos α), on boxes."""
    motion = _on_slope(make, spec, timestep, course("slope", STEEP), STEEP, SLIPPERY, SLIDE)
    steps = len(motion.base_position) - 1
    speed = -(motion.base_position[-1, 0] - motion.base_position[steps // 2, 0]) / ((steps - steps // 2) * timestep)
    # The mean over the second half is the speed in its middle.
    wanted = GRAVITY * (np.sin(STEEP) - SLIPPERY * np.cos(STEEP)) * 0.75 * SLIDE
    return (Figure("speed of the slide", float(speed / wanted - 1.0), "1", 0.05),)


def shank_contact(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """A shank that swings against a bar in the air, between knee and foot, stops there."""
    height, stop = 1.0, spec.thigh.standing + spec.shank.standing
    joint = links(spec)[-2].origin + links(spec)[-3].origin
    knee = joint + [0.0, 0.0, height] + spec.thigh_link.size[2] * _leaning(spec.thigh.standing)
    # The bar lies along the shank at the angle at which they meet, behind it.
    behind = np.array([-np.cos(stop), 0.0, np.sin(stop)])
    bar = knee + spec.shank_link.size[2] / 2 * _leaning(stop) + (BAR[2] + SHANK_RADIUS) * behind
    ground = Ground(np.array([BAR]), bar[None], about(1, stop + np.pi / 2)[None])
    angles = spec.joint_values("default_position")
    angles[-1] -= SWING
    torque, bound = np.zeros(spec.num_joints), np.full(spec.num_joints, HELD)
    torque[-1], bound[-1] = 1.0, 0.2
    body = Body.nominal(spec, fixed=True)
    act: Act = lambda number, motion: (torque, bound)  # noqa: E731
    motion = drive(make, body, timestep, TERRAIN_SECONDS, act, height, angles=angles, ground=ground)
    reached = motion.joint_position[-1, -1] - spec.shank.standing
    return (Figure("angle past the bar", float(reached), "rad", 0.02),)


def _leaning(angle: float) -> np.ndarray:
    """Return the direction in which a link hangs that is turned about y by an angle [rad]."""
    return np.array([-np.sin(angle), 0.0, -np.cos(angle)])
