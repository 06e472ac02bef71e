"""Load of the hinges of a standing robot, from its links alone: force, moment, torque about the axis. NumPy.

A hinge holds the links behind it: its force F is the weight of all of them less the ground's force on their feet, the
moment M about any point likewise. M along the axis is the motor's torque at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from stiction.robots.model import GRAVITY, Link, Robot, chain_to, tree_poses

SWAY = 0.2
"""Deviation of the joints of a leg from the standing pose [rad], each to both sides: the stance of a slow walk."""

LEANS = ((0.0, 0.0), (0.2, 0.0), (-0.2, 0.0), (0.0, 0.2), (0.0, -0.2))
"""Horizontal over vertical force of the ground on a foot, forward and sideways: well inside the friction of any
floor."""

MOST_SWAYED = 3
"""Number of joints of a leg that deviate, those nearest the foot; the remaining ones do not."""

POSES = (
    f"every joint of a leg within {SWAY:g} rad of the standing pose, the weight on all feet or on half of them, the "
    f"ground's force upright or leaning by {LEANS[1][0]:g}"
)
"""Poses of `stance_loads`, in words."""


@dataclass(frozen=True)
class HingeLoad:
    """Load of one hinge, over poses; shape (P,) each."""

    force: np.ndarray
    """|F| [N]."""
    moment: np.ndarray
    """|T| about the centre of mass of the link behind the hinge [N m], as in the law `load`."""
    axis_torque: np.ndarray
    """|torque about the axis|, which the motor holds at rest [N m]."""

    @property
    def size(self) -> np.ndarray:
        """|F| + |T|, which the law `load` multiplies [N and N m], shape (P,)."""
        return self.force + self.moment


def hinge_loads(
    links: Sequence[Link], angles: np.ndarray, foot: int, place: np.ndarray, forces: np.ndarray
) -> dict[int, HingeLoad]:
    """Return the loads of the hinges between base and a foot at rest, the base upright, by the number of the joint.

    angles: of all joints [rad], shape (J,); foot: the link that the ground pushes; place: where, in that link's frame
    [m], shape (3,); forces: of the ground on it in the base's frame [N], shape (P, 3): a load each.
    """
    position, rotation = tree_poses(links, angles)
    centres = [origin + turn @ np.array(link.com) for origin, turn, link in zip(position, rotation, links)]
    ground = position[foot] + rotation[foot] @ place
    loads = {}
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
        loads[number] = HingeLoad(np.linalg.norm(force, axis=1), np.linalg.norm(moments[0], axis=1), torque)
    return loads


def stance_loads(robot: Robot) -> dict[int, HingeLoad]:
    """Return the load of every hinge between base and ground in the poses of `POSES`, by the number of its joint.

    A foot carries an equal share of the weight. Hinges without a foot behind them are left out.
    """
    share, shares = robot.weight / len(robot.feet), sorted({1.0, min(2.0, float(len(robot.feet)))})
    forces = np.array([factor * share * np.array([*lean, 1.0]) for factor, lean in product(shares, LEANS)])
    loads_of: dict[int, list[HingeLoad]] = {}
    for foot in robot.feet:
        swayed = list(robot.chain(foot.link)[-MOST_SWAYED:])
        for sways in product((-SWAY, 0.0, SWAY), repeat=len(swayed)):
            angles = robot.joint_values("default_position")
            angles[swayed] += sways
            turn = tree_poses(robot.links, angles)[1][foot.link]
            # The ground pushes under the middle of the foot, wherever the link points.
            sole = np.array(foot.position) - turn.T @ np.array([0.0, 0.0, foot.radius])
            for number, load in hinge_loads(robot.links, angles, foot.link, sole, forces).items():
                loads_of.setdefault(number, []).append(load)
    return {
        number: HingeLoad(
            *(np.concatenate(parts) for parts in zip(*((pose.force, pose.moment, pose.axis_torque) for pose in loads)))
        )
        for number, loads in sorted(loads_of.items())
    }
