"""Left-right mirror of a robot: pairs of joints and feet, and the angles that change their sign. NumPy.

A reflection in the plane x-z of the base turns a position (x, y, z) into (x, -y, z) and the axis of a rotation (x, y,
z) into (-x, y, -z). Joint j is the mirror image of joint i if it sits at i's reflected place, on the mirror image of
i's parent, and its axis is i's reflected axis, or the opposite of it. Then the mirrored robot has

  q'_j = s q_i,   s = 1 where the axes agree, -1 where they are opposite,

and the same for velocities, torques, targets and every other signed value of a joint; friction, inertia and other
values without a sign are only exchanged. The map follows from the links, never from names, and a robot whose image is
another robot has none. Machines are built symmetric and measured with tolerances, hence `TOLERANCE`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stiction.core.errors import RobotError, StictionError
from stiction.robots.model import Link, Robot

POSITION = np.array([1.0, -1.0, 1.0])
"""Factors of the reflection for positions, velocities and forces."""

ROTATION = np.array([-1.0, 1.0, -1.0])
"""Factors of the reflection for axes, angular velocities and torques."""

UNSIGNED = ("torque_limit", "kp", "kd", "action_scale")
"""Fields of `Joint` that a joint shares with its mirror image. Rotor and friction, which differ from motor to motor of
one machine, may differ: a policy copes with them as with a worn joint."""

TOLERANCE = {
    **{"place": 2e-3, "axis": 2e-3, "mass": 0.05, "com": 0.02, "inertia": 0.2, "value": 0.01},
    **{"angle": 0.02, "limit": 0.1},
}
"""Tolerance of an image: places and centres of mass [m], axes [-], mass, inertia and values of `UNSIGNED` as shares,
angles of the pose and limits [rad]. Gains that follow from inertias have the rounding of these."""


@dataclass(frozen=True)
class RobotMirror:
    """Mirror map: the mirrored robot's value i is `sign[i]` times the robot's value `joints[i]`; twice is the
    identity.
    """

    joints: np.ndarray
    """Number of the joint that joint i mirrors, shape (joints,)."""
    sign: np.ndarray
    """+1, or -1 where an angle changes its sign, shape (joints,)."""
    feet: np.ndarray
    """Number of the foot that foot i mirrors, shape (feet,)."""


def robot_mirror(robot: Robot) -> RobotMirror:
    """Return the mirror map of a robot.

    Raises `StictionError` naming the joint, or the foot, that has no mirror image.
    """
    try:
        if robot.mirror_names == ():
            raise RobotError("its description says mirror: none")
        joints, sign = match_links(robot.links, robot.joint_names, robot.mirror_names)
        _check_values(robot, joints, sign)
        feet = _match_feet(robot, joints)
    except StictionError as error:
        raise RobotError(f"robot {robot.name!r} has no left-right mirror: {error}; use --symmetry none") from error
    return RobotMirror(joints, sign, feet)


def mirrored_kinds(robot: Robot, mirror: RobotMirror) -> np.ndarray:
    """Return the number of the kind that each kind of joint mirrors, shape (kinds,), in the order of `joint_kinds`.

    A kind on both sides is its own image; `left_hip` is that of `right_hip`. Raises `RobotError` naming a kind whose
    joints mirror joints of several kinds.
    """
    kinds, image = np.array([joint.kind for joint in robot.joints]), []
    for kind in robot.joint_kinds:
        seen = list(dict.fromkeys(kinds[mirror.joints[robot.joints_of(kind)]].tolist()))
        # The map exchanges joints one by one, so equal numbers are the same joints.
        if len(seen) > 1 or len(robot.joints_of(seen[0])) != len(robot.joints_of(kind)):
            raise RobotError(
                f"robot {robot.name!r}: the joints of kind {kind!r} mirror joints of {', '.join(map(repr, seen))}; "
                "expected all joints of one kind: mend `kind` in its description, or use --symmetry none"
            )
        image.append(robot.joint_kinds.index(seen[0]))
    return np.array(image)


def match_links(
    tree: Sequence[Link], names: Sequence[str], images: Sequence[str] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return each joint's mirror image, shape (joints,), and the sign of its angle, shape (joints,).

    tree: the links, each after its parent; names: of their joints; images: the name of each joint's image, if known.
    Raises `StictionError` naming a joint whose place, axis, parent, mass, centre of mass or inertia has no counterpart.
    """
    # Frames are parallel at angles of zero, so that places are sums.
    place = np.zeros((len(tree), 3))
    image = np.full(len(tree) + 1, -1)  # its last entry is the base, number -1, its own image
    sign = np.ones(len(tree))
    for number, link in enumerate(tree):
        place[number] = np.array(link.origin) + (place[link.parent] if link.parent >= 0 else 0.0)
    for number, link in enumerate(tree):
        near = np.abs(place - POSITION * place[number]).max(axis=1) < TOLERANCE["place"]
        candidates = [other for other in np.flatnonzero(near).tolist() if tree[other].parent == image[link.parent]]
        if images is not None:
            candidates = [other for other in candidates if names[other] == images[number]]
        matches = [(other, _agree(link, tree[other])) for other in candidates]
        matches = [(other, agreement) for other, agreement in matches if agreement]
        if len(matches) != 1:
            raise RobotError(
                f"joint {names[number]!r} at {place[number].round(4).tolist()} m, axis "
                f"{np.round(link.axis, 4).tolist()}: {len(matches)} joints"
                + (f" named {images[number]!r}" if images is not None else "")
                + f" are at {(POSITION * place[number]).round(4).tolist()} m with a mirrored axis and a link of "
                "mirrored mass, centre and inertia; expected one"
            )
        image[number], sign[number] = matches[0]
    return image[:-1], sign


def _agree(link: Link, other: Link) -> float:
    """Return the sign of the angle where `other` is the mirror image of `link`, else 0."""
    reflected = np.outer(POSITION, POSITION) * link.inertia_matrix
    size = np.trace(link.inertia_matrix)
    same = (
        abs(link.mass - other.mass) <= TOLERANCE["mass"] * link.mass
        and np.allclose(np.array(link.com) * POSITION, other.com, rtol=0, atol=TOLERANCE["com"])
        and np.allclose(reflected, other.inertia_matrix, rtol=0, atol=TOLERANCE["inertia"] * size)
    )
    axis = np.array(link.axis) * ROTATION
    if same and np.allclose(axis, other.axis, rtol=0, atol=TOLERANCE["axis"]):
        return 1.0
    return -1.0 if same and np.allclose(axis, -np.array(other.axis), rtol=0, atol=TOLERANCE["axis"]) else 0.0


def _check_values(robot: Robot, image: np.ndarray, sign: np.ndarray) -> None:
    """Raise `StictionError` naming a joint whose range, pose, motor or gains are not those of its mirror image."""
    values = {name: robot.joint_values(name) for name in (*UNSIGNED, "default_position", "lower", "upper")}
    mirrored = {name: values[name][image] for name in UNSIGNED}
    mirrored["default_position"] = sign * values["default_position"][image]
    # Where the sign changes, the lower limit is the image's upper one.
    ends = np.stack([sign * values[name][image] for name in ("lower", "upper")])
    mirrored |= {"lower": ends.min(axis=0), "upper": ends.max(axis=0)}
    for name, value in values.items():
        slack = {"default_position": TOLERANCE["angle"], "lower": TOLERANCE["limit"], "upper": TOLERANCE["limit"]}
        share = TOLERANCE["value"] if name in UNSIGNED else 1e-5
        wrong = np.flatnonzero(~np.isclose(value, mirrored[name], rtol=share, atol=slack.get(name, 1e-8)))
        if len(wrong):
            joint, other = robot.joint_names[wrong[0]], robot.joint_names[image[wrong[0]]]
            raise RobotError(
                f"joint {joint!r} has {name} {value[wrong[0]]:g}, the mirror image of {other!r} "
                f"{mirrored[name][wrong[0]]:g}"
            )


def _match_feet(robot: Robot, image: np.ndarray) -> np.ndarray:
    """Return each foot's mirror image, shape (feet,): the foot on the link that mirrors its link.

    Raises `StictionError` where a foot has none, or the contact groups of the gait are neither exchanged nor kept.
    """
    carrier = [foot.link for foot in robot.feet]
    for foot in robot.feet:
        if carrier.count(image[foot.link]) != 1:
            raise RobotError(f"foot {foot.name!r} has no mirror image, or several on one link")
    feet = np.array([carrier.index(image[foot.link]) for foot in robot.feet])
    groups = robot.groups()
    if groups is None:
        return feet
    changed = groups != groups[feet]
    if changed.any() and not changed.all():
        name = robot.foot_names[int(np.flatnonzero(changed)[0])]
        raise RobotError(
            f"foot {name!r} and its mirror image are in different contact groups, while others share theirs; the "
            "mirrored gait is another gait"
        )
    return feet
