"""The ground: boxes and height fields where they were put, the feet's friction on them, and shanks that catch.

All robots here have locked joints: a rigid table, whose pose on a plane surface and whose slide down a slope are known.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stiction.robots.links import SHANK_RADIUS, links
from stiction.sim.terrain import LANDING, RAMP
from stiction.transfer.engines.checks.rig import HELD, Figure, Make, record, robot, still
from stiction.transfer.engines.engine import GRAVITY, Body, Motion
from stiction.transfer.engines.ground import Ground, course, sampled
from stiction.transfer.engines.rotation import UPRIGHT, about, angle_between, into_frame

STEP, ANGLE, CELL = 0.1, 0.2, 0.1
"""Height of a stair [m], angle of the slope [rad], cell of the height field [m]."""

SECONDS = 1.0
"""How long the robot stands or slides [s]."""

SLIPPERY, STEEP = 0.2, 0.3
"""Friction of the feet [-] and angle [rad] of the slide."""

SLIDE = 0.5
"""Length of the slide [s]."""

BAR, SWING = (0.03, 0.1, 0.03), 0.5
"""Half sizes of the bar [m], and the angle of the shank from it at the start [rad]."""

COURSE = (3.0, 3.0)
"""Half the extent of the height field [m]."""


def terrain(make: Make, timestep: float) -> tuple[Figure, ...]:
    """A table on the landing of the stairs, on a slope made of boxes, and on the same slope as a height field."""
    stairs, slope = course("stairs", STEP), course("slope", ANGLE)
    figures = [
        _landing(make, timestep, "landing of stairs", stairs),
        _landing(make, timestep, "landing of a height field", sampled(stairs, COURSE, CELL)),
    ]
    for name, ground in (("slope", slope), ("slope of a height field", sampled(slope, COURSE, CELL))):
        figures += _slope(make, timestep, name, ground)
    return tuple(figures)


def _landing(make: Make, timestep: float, name: str, ground: Ground) -> Figure:
    """Return the height of a table on level ground above where it should be."""
    spec = robot()
    body = Body.nominal(spec)
    engine = make(body, ground, timestep)
    top = float(ground.height(np.zeros((1, 2)))[0]) + spec.standing_height
    engine.reset(spec.joint_values("standing"), np.array([0.0, 0.0, top]), UPRIGHT)
    motion = record(engine, round(SECONDS / timestep), still(body))
    return Figure(f"height, {name}", float(motion.base_position[-1, 2] - top), "m", 3e-3)


def _on_slope(make: Make, timestep: float, ground: Ground, angle: float, friction: float, seconds: float) -> Motion:
    """Return a table on the way up a slope, in the frame of the slope: x up, z away from it, from its middle [m]."""
    spec = robot()
    body = replace(Body.nominal(spec), ground_friction=friction)
    engine = make(body, ground, timestep)
    # Nose up is a turn about -y.
    turn = about(1, -angle)
    middle = np.array([-LANDING - RAMP / 2 * np.cos(angle), 0.0, RAMP / 2 * np.sin(angle)])
    away = np.array([-np.sin(angle), 0.0, np.cos(angle)])
    engine.reset(spec.joint_values("standing"), middle + spec.standing_height * away, turn)
    motion = record(engine, round(seconds / timestep), still(body))
    return replace(motion, base_position=into_frame(turn, motion.base_position - middle))


def _slope(make: Make, timestep: float, name: str, ground: Ground) -> list[Figure]:
    """Return how a table stands on a slope that is not too steep for its feet."""
    motion = _on_slope(make, timestep, ground, ANGLE, 1.0, SECONDS)
    spec = robot()
    place = motion.base_position[-1]
    return [
        Figure(f"height, {name}", float(place[2] - spec.standing_height), "m", 3e-3),
        Figure(f"tilt, {name}", angle_between(motion.base_quaternion[-1], about(1, -ANGLE)), "rad", 5e-3),
        Figure(f"creep down in 1 s, {name}", float(place[0]), "m", 0.02),
    ]


def foot_friction(make: Make, timestep: float) -> tuple[Figure, ...]:
    """A table that slides down a slope is accelerated by g (sin α - μ cos α), on boxes."""
    motion = _on_slope(make, timestep, course("slope", STEEP), STEEP, SLIPPERY, SLIDE)
    steps = len(motion.base_position) - 1
    speed = -(motion.base_position[-1, 0] - motion.base_position[steps // 2, 0]) / ((steps - steps // 2) * timestep)
    # The mean over the second half is the speed in its middle.
    wanted = GRAVITY * (np.sin(STEEP) - SLIPPERY * np.cos(STEEP)) * 0.75 * SLIDE
    return (Figure("speed of the slide", float(speed / wanted - 1.0), "1", 0.05),)


def shank_contact(make: Make, timestep: float) -> tuple[Figure, ...]:
    """A shank that swings against a bar in the air, between knee and foot, stops there."""
    spec = robot()
    height, stop = 1.0, spec.thigh.standing + spec.shank.standing
    joint = links(spec)[-2].origin + links(spec)[-3].origin
    knee = joint + [0.0, 0.0, height] + spec.thigh_link.size[2] * _leaning(spec.thigh.standing)
    # The bar lies along the shank at the angle at which they meet, behind it.
    behind = np.array([-np.cos(stop), 0.0, np.sin(stop)])
    bar = knee + spec.shank_link.size[2] / 2 * _leaning(stop) + (BAR[2] + SHANK_RADIUS) * behind
    ground = Ground(np.array([BAR]), bar[None], about(1, stop + np.pi / 2)[None])
    engine = make(Body.nominal(spec, fixed=True), ground, timestep)
    angles = spec.joint_values("standing")
    angles[-1] -= SWING
    engine.reset(angles, np.array([0.0, 0.0, height]), UPRIGHT)
    torque, bound = np.zeros(spec.num_joints), np.full(spec.num_joints, HELD)
    torque[-1], bound[-1] = 1.0, 0.2
    motion = record(engine, round(SECONDS / timestep), lambda number, motion: (torque, bound))
    reached = motion.joint_position[-1, -1] - spec.shank.standing
    return (Figure("angle past the bar", float(reached), "rad", 0.02),)


def _leaning(angle: float) -> np.ndarray:
    """Return the direction in which a link hangs that is turned about y by an angle [rad]."""
    return np.array([-np.sin(angle), 0.0, -np.cos(angle)])
