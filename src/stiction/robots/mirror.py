"""The left-right mirror of a robot: which joint and foot is whose image, and which angles change their sign. NumPy.

A reflection in the plane x-z of the base turns a position (x, y, z) into (x, -y, z) and the axis of a rotation
(x, y, z) into (-x, y, -z). Joint j is the mirror image of joint i where it sits at i's reflected place, on the mirror
image of i's parent, and its axis is i's reflected axis, or the opposite of it. Then the mirrored robot has

    q'_j = s q_i,   s = 1 where the axes agree, -1 where they are opposite,

and the same for velocities, torques, targets and every other signed value of a joint; friction, inertia and whatever
else has no sign is exchanged alone. The map is found in the links, never from names, and a robot whose image is another
robot has none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stiction.core.errors import RobotError, StictionError
from stiction.robots.model import JOINTS_PER_LEG, RobotSpec
from stiction.robots.tree import Link, links

POSITION = np.array([1.0, -1.0, 1.0])
"""What the reflection does to positions, velocities and forces."""

ROTATION = np.array([-1.0, 1.0, -1.0])
"""What it does to axes, rates of turn and torques."""

UNSIGNED = ("torque_limit", "armature", "damping", "frictionloss", "stiffness", "derivative")
"""Fields of `JointSpec` that a joint shares with its mirror image."""


@dataclass(frozen=True)
class RobotMirror:
    """The mirrored robot's value i is `sign[i]` times the robot's value `joints[i]`; doing it twice changes nothing."""

    joints: np.ndarray
    """Number of the joint that joint i mirrors, shape (joints,)."""
    sign: np.ndarray
    """+1, or -1 where an angle changes its sign, shape (joints,)."""
    feet: np.ndarray
    """Number of the foot that foot i mirrors, shape (legs,)."""


def robot_mirror(robot: RobotSpec) -> RobotMirror:
    """Return the mirror map of a robot.

    Raises `StictionError` naming the joint, or the foot, that has no mirror image.
    """
    try:
        joints, sign = match_links(links(robot))
        _check_values(robot, joints, sign)
        feet = _match_feet(robot, joints)
    except StictionError as error:
        raise RobotError(f"robot {robot.name!r} has no left-right mirror: {error}; use --symmetry none") from error
    return RobotMirror(joints, sign, feet)


def match_links(tree: Sequence[Link]) -> tuple[np.ndarray, np.ndarray]:
    """Return each joint's mirror image, shape (joints,), and the sign of its angle, shape (joints,).

    `tree`: the links, each after its parent. Raises `StictionError` naming a joint whose place, axis, parent, mass,
    centre of mass or inertia has no counterpart.
    """
    place = np.zeros((len(tree), 3))
    image = np.full(len(tree) + 1, -1)  # its last entry is the base, number -1, its own image
    sign = np.ones(len(tree))
    for number, link in enumerate(tree):
        place[number] = link.origin + (place[link.parent] if link.parent >= 0 else 0.0)
    for number, link in enumerate(tree):
        there = np.abs(place - POSITION * place[number]).max(axis=1) < 1e-9
        candidates = [other for other in np.flatnonzero(there).tolist() if tree[other].parent == image[link.parent]]
        found = [(other, _agree(link, tree[other])) for other in candidates]
        found = [(other, agreement) for other, agreement in found if agreement]
        if len(found) != 1:
            raise RobotError(
                f"joint {link.joint!r} at {place[number].round(4).tolist()} m, axis {link.axis.tolist()}: "
                f"{len(found)} joints are at {(POSITION * place[number]).round(4).tolist()} m with a mirrored axis and "
                "a link of mirrored mass, centre and inertia; expected one"
            )
        image[number], sign[number] = found[0]
    return image[:-1], sign


def _agree(link: Link, other: Link) -> float:
    """Return the sign of the angle where `other` is the mirror image of `link`, 0 where it is none."""
    same = (
        np.isclose(link.mass, other.mass)
        and np.allclose(link.com * POSITION, other.com)
        and np.allclose(link.inertia, other.inertia)
    )
    axis = link.axis * ROTATION
    if same and np.allclose(axis, other.axis):
        return 1.0
    return -1.0 if same and np.allclose(axis, -other.axis) else 0.0


def _check_values(robot: RobotSpec, image: np.ndarray, sign: np.ndarray) -> None:
    """Raise `StictionError` naming a joint whose range, pose, motor or gains are not those of its mirror image."""
    values = {name: robot.joint_values(name) for name in (*UNSIGNED, "standing", "lower", "upper")}
    mirrored = {name: values[name][image] for name in UNSIGNED} | {"standing": sign * values["standing"][image]}
    ends = np.stack([sign * values[name][image] for name in ("lower", "upper")])
    mirrored |= {"lower": ends.min(axis=0), "upper": ends.max(axis=0)}
    for name, value in values.items():
        wrong = np.flatnonzero(~np.isclose(value, mirrored[name]))
        if len(wrong):
            joint, other = robot.joint_names[wrong[0]], robot.joint_names[image[wrong[0]]]
            raise RobotError(
                f"joint {joint!r} has {name} {value[wrong[0]]:g}, the mirror image of {other!r} "
                f"{mirrored[name][wrong[0]]:g}"
            )


def _match_feet(robot: RobotSpec, image: np.ndarray) -> np.ndarray:
    """Return each foot's mirror image, shape (legs,): the foot of the leg whose joints are mirrored onto its own.

    Raises `StictionError` where the contact groups of the gait are neither exchanged nor kept.
    """
    feet = image[::JOINTS_PER_LEG] // JOINTS_PER_LEG
    groups = robot.groups()
    changed = groups != groups[feet]
    if changed.any() and not changed.all():
        leg = robot.foot_names[int(np.flatnonzero(changed)[0])]
        raise RobotError(
            f"foot {leg!r} and its mirror image are in different contact groups, while others share theirs; the "
            "mirrored gait is another gait"
        )
    return feet
