"""Joints held rigid: links without a driven joint between them become one, at the angles at which the robot holds them.
NumPy.

A humanoid's arms are held while its legs walk. Masses add up and inertias follow by the parallel-axis theorem; frames
turned by a held joint become parallel to the base's again, as every frame is where all driven joints are at zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from stiction.core.errors import RobotError, unknown_name
from stiction.core.rotation import quaternion_of
from stiction.robots.model import Body, HeldJoint, Link, Robot, link_poses
from stiction.robots.shapes import Shape, vector

Frame = tuple[np.ndarray, np.ndarray]
"""A frame in another one: position [m], shape (3,), and rotation, shape (3, 3)."""


def hold(robot: Robot, angles: Mapping[str, float]) -> Robot:
    """Return a robot whose joints of these names are rigid at these angles [rad].

    Raises `RobotError` for an unknown joint, or where no joint would be left, or a foot would be part of the base.
    """
    for name in angles:
        if name not in robot.joint_names:
            raise RobotError(f"robot {robot.name!r}: {unknown_name('joint', name, robot.joint_names)}")
    if not angles:
        return robot
    driven = [number for number, joint in enumerate(robot.joints) if joint.name not in angles]
    position, rotation = link_poses(robot, np.array([angles.get(name, 0.0) for name in robot.joint_names]))
    owner: list[int] = []
    for number, link in enumerate(robot.links):
        above = owner[link.parent] if link.parent >= 0 else -1
        owner.append(driven.index(number) if number in driven else above)
    frames = {-1: np.zeros(3)} | {new: position[old] for new, old in enumerate(driven)}

    def parts(new: int, bodies: Sequence[Body]) -> list[tuple[Body, Frame]]:
        rigid: list[tuple[Body, Frame]] = [(body, (np.zeros(3), np.eye(3))) for body in bodies]
        return rigid + [
            (link, (position[old] - frames[new], rotation[old]))
            for old, link in enumerate(robot.links)
            if owner[old] == new
        ]

    links = []
    for new, old in enumerate(driven):
        link = robot.links[old]
        parent = owner[link.parent] if link.parent >= 0 else -1
        origin, axis = vector(position[old] - frames[parent]), vector(rotation[old] @ np.array(link.axis))
        links.append(Link(**vars(merge(parts(new, ()))), name=link.name, parent=parent, origin=origin, axis=axis))
    feet = []
    for foot in robot.feet:
        if owner[foot.link] < 0:
            raise RobotError(f"robot {robot.name!r}: no driven joint moves the foot {foot.name!r}")
        place = position[foot.link] - frames[owner[foot.link]], rotation[foot.link]
        shapes = tuple(_moved(shape, place) for shape in foot.shapes)
        middle = vector(place[0] + place[1] @ np.array(foot.position))
        feet.append(replace(foot, link=owner[foot.link], position=middle, shapes=shapes))
    names = robot.mirror_names
    return replace(
        robot,
        base=replace(robot.base, **vars(merge(parts(-1, (robot.base,))))),
        links=tuple(links),
        joints=tuple(robot.joints[old] for old in driven),
        feet=tuple(feet),
        held=robot.held
        + tuple(
            HeldJoint(joint.name, angles[joint.name], vector(rotation[number] @ np.array(robot.links[number].axis)))
            for number, joint in enumerate(robot.joints)
            if joint.name in angles
        ),
        mirror_names=tuple(names[old] for old in driven) if names else names,
    )


def merge(parts: Sequence[tuple[Body, Frame]]) -> Body:
    """Return several bodies merged, each with the place of its frame in the common frame."""
    mass = sum(body.mass for body, _ in parts)
    centres = [position + rotation @ np.array(body.com) for body, (position, rotation) in parts]
    com = (
        sum(body.mass * centre for (body, _), centre in zip(parts, centres, strict=True)) / mass
        if mass
        else np.zeros(3)
    )
    # Exactly as it was: the sums below would round.
    if len(parts) == 1 and np.array_equal(parts[0][1][1], np.eye(3)) and not parts[0][1][0].any():
        return Body(mass, parts[0][0].com, parts[0][0].inertia, parts[0][0].shapes)
    inertia = np.zeros((3, 3))
    for (body, (_, rotation)), centre in zip(parts, centres, strict=True):
        offset = centre - com
        inertia += rotation @ body.inertia_matrix @ rotation.T
        inertia += body.mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    shapes = tuple(_moved(shape, place) for body, place in parts for shape in body.shapes)
    xx, yy, zz, xy, xz, yz = (float(inertia[pair]) for pair in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    return Body(float(mass), vector(com), (xx, yy, zz, xy, xz, yz), shapes)


def _moved(shape: Shape, frame: Frame) -> Shape:
    """Return a shape transformed into another frame."""
    position, rotation = frame
    if np.array_equal(rotation, np.eye(3)) and not position.any():
        return shape
    w, x, y, z = quaternion_of(rotation @ shape.rotation)
    return replace(shape, position=vector(position + rotation @ np.array(shape.position)), quaternion=(w, x, y, z))
