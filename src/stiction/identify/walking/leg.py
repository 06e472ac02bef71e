"""Rigid-body dynamics of three-jointed legs on a moving base, in NumPy, over a whole log at once.

Recursive Newton-Euler, every vector along the axes of the base. The base's acceleration enters as its specific force,
acceleration minus gravity, which is what an accelerometer reads: gravity needs no orientation then. Geometry and
inertias are those of `robots/build.py`: links are uniform boxes, the hip's axis is x (mirrored on the right), thigh and
shank turn about y. The rotors' inertia (armature) is not part of it; it acts on the joint's own equation alone.

`tests/identify/walking/test_leg.py` compares all of it with MuJoCo's inverse dynamics.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.robots.links import links
from stiction.robots.spec import JOINTS_PER_LEG, LegSpec, RobotSpec, box_inertia


@dataclass(frozen=True)
class BaseMotion:
    """How the base moves, T samples; vectors in the base frame, at the base's origin."""

    angular_velocity: np.ndarray
    """ω [rad/s], shape (T, 3)."""
    angular_acceleration: np.ndarray
    """ω' [rad/s²], shape (T, 3)."""
    specific_force: np.ndarray
    """Acceleration minus gravity [m/s²], shape (T, 3): (0, 0, 9.81) at rest."""


@dataclass(frozen=True)
class LegMotion:
    """How the three joints of one leg move: hip, thigh, shank, shape (T, 3) each."""

    position: np.ndarray
    """θ [rad]."""
    velocity: np.ndarray
    """θ' [rad/s]."""
    acceleration: np.ndarray
    """θ'' [rad/s²]."""


@dataclass(frozen=True)
class LegEffort:
    """What it takes to move a leg's links with its foot in the air."""

    torque: np.ndarray
    """Torque about each joint's axis [N m], shape (T, 3)."""
    wrench: np.ndarray
    """Force [N] and moment about the base's origin [N m] by which the base holds the leg, shape (T, 6)."""


@dataclass(frozen=True)
class _Frames:
    """Where the joints are: axes and origins of hip, thigh and shank, and the rotations of their links."""

    axes: np.ndarray
    """Unit vectors, shape (3, T, 3)."""
    origins: np.ndarray
    """Positions from the base's origin [m], shape (3, T, 3)."""
    rotations: np.ndarray
    """Link frame -> base frame, shape (3, T, 3, 3)."""


def rotation_about(axis: int, angle: np.ndarray) -> np.ndarray:
    """Return rotation matrices about x (0) or y (1) by `angle` [rad], shape (T,), as an array (T, 3, 3)."""
    cos, sin = np.cos(angle), np.sin(angle)
    matrix = np.zeros((*np.shape(angle), 3, 3))
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix[..., axis, axis] = 1.0
    matrix[..., first, first] = matrix[..., second, second] = cos
    matrix[..., first, second], matrix[..., second, first] = -sin, sin
    return matrix


def _frames(spec: RobotSpec, leg: LegSpec, position: np.ndarray) -> _Frames:
    """Return the leg's joint frames at the angles `position`, shape (T, 3)."""
    hip = rotation_about(0, leg.side * position[:, 0])
    thigh = hip @ rotation_about(1, position[:, 1])
    shank = thigh @ rotation_about(1, position[:, 2])
    mount = np.broadcast_to(np.array(leg.mount), (len(position), 3))
    shoulder = mount + hip[:, :, 1] * (leg.side * spec.hip_link.size[1])
    knee = shoulder - thigh[:, :, 2] * spec.thigh_link.size[2]
    return _Frames(
        axes=np.stack([leg.side * hip[:, :, 0], hip[:, :, 1], thigh[:, :, 1]]),
        origins=np.stack([mount, shoulder, knee]),
        rotations=np.stack([hip, thigh, shank]),
    )


def foot_position(spec: RobotSpec, leg: LegSpec, position: np.ndarray) -> np.ndarray:
    """Return the centre of the foot in the base frame [m], shape (T, 3), at joint angles `position`, shape (T, 3)."""
    frames = _frames(spec, leg, position)
    return frames.origins[2] - frames.rotations[2][:, :, 2] * spec.shank_link.size[2]


def point_jacobian(spec: RobotSpec, leg: LegSpec, position: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return J of a point of the shank, v = J θ', shape (T, 3, 3): rows x y z, columns hip thigh shank.

    position: joint angles [rad], shape (T, 3); point: where it is now, in the base frame [m], shape (T, 3).
    """
    frames = _frames(spec, leg, position)
    columns = np.cross(frames.axes, point - frames.origins)
    return np.moveaxis(columns, 0, -1)


def leg_effort(spec: RobotSpec, leg: LegSpec, motion: LegMotion, base: BaseMotion) -> LegEffort:
    """Return torques and wrench that move one leg's links as they move, its foot in the air."""
    frames = _frames(spec, leg, motion.position)
    spin, turning = base.angular_velocity, base.angular_acceleration
    pull, here = base.specific_force, np.zeros_like(base.specific_force)
    force, moment, first = [], [], JOINTS_PER_LEG * spec.legs.index(leg)
    for number, link in enumerate(links(spec)[first : first + JOINTS_PER_LEG]):
        step = frames.origins[number] - here
        pull = pull + np.cross(turning, step) + np.cross(spin, np.cross(spin, step))
        here = frames.origins[number]
        rate = frames.axes[number] * motion.velocity[:, number, None]
        turning = turning + frames.axes[number] * motion.acceleration[:, number, None] + np.cross(spin, rate)
        spin = spin + rate
        turn = frames.rotations[number]
        arm = turn @ link.com
        load = link.mass * (pull + np.cross(turning, arm) + np.cross(spin, np.cross(spin, arm)))
        inertia = turn * link.inertia @ np.swapaxes(turn, 1, 2)
        momentum = (inertia @ spin[..., None])[..., 0]
        force.append(load)
        # About the base's origin, so that the wrenches of links add up without shifting them from joint to joint.
        moment.append((inertia @ turning[..., None])[..., 0] + np.cross(spin, momentum) + np.cross(here + arm, load))
    torque, total, about = [], np.zeros_like(pull), np.zeros_like(pull)
    for number in (2, 1, 0):
        total, about = total + force[number], about + moment[number]
        own = about - np.cross(frames.origins[number], total)
        torque.append((frames.axes[number] * own).sum(axis=1))
    return LegEffort(np.stack(torque[::-1], axis=1), np.concatenate([total, about], axis=1))


@dataclass(frozen=True)
class Trunk:
    """The trunk with whatever it carries: what must be known before feet without force sensors tell anything."""

    mass: float
    """Mass [kg]."""
    centre: tuple[float, float, float]
    """Centre of mass in the base frame [m]."""
    inertia: tuple[float, float, float]
    """Principal moments about the centre of mass, along the base's axes [kg m²]."""

    @classmethod
    def of(cls, spec: RobotSpec, payload: float = 0.0, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Trunk:
        """Return a robot's bare trunk, or with `payload` [kg] on it and its centre of mass at `centre` [m].

        The payload is taken as spread over the trunk's box.
        """
        mass = spec.base.mass + payload
        x, y, z = box_inertia(mass, spec.base.size)
        return cls(mass, centre, (float(x), float(y), float(z)))


def trunk_wrench(trunk: Trunk, base: BaseMotion) -> np.ndarray:
    """Return force and moment about the base's origin that move the trunk as it moves, shape (T, 6)."""
    spin, arm, inertia = base.angular_velocity, np.array(trunk.centre), np.array(trunk.inertia)
    pull = base.specific_force + np.cross(base.angular_acceleration, arm) + np.cross(spin, np.cross(spin, arm))
    force = trunk.mass * pull
    moment = inertia * base.angular_acceleration + np.cross(spin, inertia * spin) + np.cross(arm, force)
    return np.concatenate([force, moment], axis=1)
