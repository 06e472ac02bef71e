"""What the hinges of a standing robot carry, from its links alone: force, moment, torque about the axis. NumPy.

A link behind a hinge is held by what the hinge transmits: the force F on it is the weight of all that it carries less
the ground's force on the feet among that, the moment M about any point likewise. M along the axis is the motor's torque
at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from stiction.robots.model import GRAVITY, Link, Robot, chain_to, tree_poses

SWAY = 0.2
"""How far the joints of a leg stand from the standing pose [rad], each to both sides: the stance of a slow walk."""

LEANS = ((0.0, 0.0), (0.2, 0.0), (-0.2, 0.0), (0.0, 0.2), (0.0, -0.2))
"""Horizontal over vertical force of the ground on a foot, forward and sideways: of feet that push, well inside the
friction of any floor."""

MOST_SWAYED = 3
"""Joints of a leg that sway, those nearest the foot; the others stand as they are."""

POSES = (
    f"every joint of a leg within {SWAY:g} rad of the standing pose, the weight on all feet or on half of them, the "
    f"ground's force upright or leaning by {LEANS[1][0]:g}"
)
"""In which poses `stance_loads` looks, in words."""


@dataclass(frozen=True)
class HingeLoad:
    """What one hinge transmits, over poses; shape (P,) each."""

    force: np.ndarray
    """|F| [N]."""
    moment: np.ndarray
    """|T| about the centre of mass of the link behind the hinge [N m], as the law `load` has it."""
    axis_torque: np.ndarray
    """|torque about the axis|, which the motor holds at rest [N m]."""

    @property
    def size(self) -> np.ndarray:
        """|F| + |T|, what the law `load` multiplies [N and N m], shape (P,)."""
        return self.force + self.moment


def hinge_loads(
    links: Sequence[Link], angles: np.ndarray, foot: int, place: np.ndarray, forces: np.ndarray
) -> dict[int, HingeLoad]:
    """Return what the hinges between base and a foot transmit at rest, the base upright, by the number of the joint.

    angles: of all joints [rad], shape (J,); foot: the link that the ground pushes; place: where, in that link's frame
    [m], shape (3,); forces: of the ground on it in the base's frame [N], shape (P, 3): a load each.
    """
    position, rotation = tree_poses(links, angles)
    centres = [origin + turn @ np.array(link.com) for origin, turn, link in zip(position, rotation, links)]
    ground = position[foot] + rotation[foot] @ place
    found = {}
    for number in chain_to(links, foot):
        carried = [index for index in range(len(links)) if number in chain_to(links, index)]
        mass = sum(links[index].mass for index in carried)
        first = sum((links[index].mass * centres[index] for index in carried), np.zeros(3))
        fall = np.array([0.0, 0.0, -GRAVITY])
        force = -(mass * fall + forces)
        moments = [
            -(np.cross(first - mass * point, fall) + np.cross(ground - point, forces))
            for point in (centres[number], position[number])
        ]
        torque = np.abs(moments[1] @ (rotation[number] @ np.array(links[number].axis)))
        found[number] = HingeLoad(np.linalg.norm(force, axis=1), np.linalg.norm(moments[0], axis=1), torque)
    return found


def stance_loads(robot: Robot) -> dict[int, HingeLoad]:
    """Return the load of every hinge between base and ground in the poses of `POSES`, by the number of its joint.

    A foot carries its even share of the weight. Hinges that no foot stands on have none.
    """
    share, shares = robot.weight / len(robot.feet), sorted({1.0, min(2.0, float(len(robot.feet)))})
    forces = np.array([factor * share * np.array([*lean, 1.0]) for factor, lean in product(shares, LEANS)])
    found: dict[int, list[HingeLoad]] = {}
    for foot in robot.feet:
        swayed = list(robot.chain(foot.link)[-MOST_SWAYED:])
        for sways in product((-SWAY, 0.0, SWAY), repeat=len(swayed)):
            angles = robot.joint_values("default_position")
            angles[swayed] += sways
            turn = tree_poses(robot.links, angles)[1][foot.link]
            # The ground pushes under the middle of the foot, wherever the link points.
            sole = np.array(foot.position) - turn.T @ np.array([0.0, 0.0, foot.radius])
            for number, load in hinge_loads(robot.links, angles, foot.link, sole, forces).items():
                found.setdefault(number, []).append(load)
    return {
        number: HingeLoad(
            *(np.concatenate(parts) for parts in zip(*((one.force, one.moment, one.axis_torque) for one in loads)))
        )
        for number, loads in sorted(found.items())
    }
