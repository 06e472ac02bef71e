"""The links of a robot as a tree, for whoever builds it in an engine or writes it into a file. NumPy.

Every link has the frame of its joint; in the zero position all frames are parallel to the base's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.robots.model import LegSpec, RobotSpec, box_inertia

THIGH_RADIUS, SHANK_RADIUS = 0.02, 0.013
"""Radii of the capsules [m]. A thigh's is there to be seen; a shank catches with its own on an edge."""


@dataclass(frozen=True)
class Link:
    """One link and the joint before it. Positions are in the parent's frame for the joint, in its own for the rest."""

    joint: str
    """Name of the joint: `FL_hip`."""
    parent: int
    """Number of the link before it, -1 for the base."""
    origin: np.ndarray
    """Where the joint is on the parent [m], shape (3,)."""
    axis: np.ndarray
    """Axis of the joint, shape (3,)."""
    mass: float
    """[kg]."""
    com: np.ndarray
    """Centre of mass [m], shape (3,)."""
    inertia: np.ndarray
    """Principal moments about it, along the frame's axes [kg m²], shape (3,)."""

    @property
    def name(self) -> str:
        """Name of the link: `FL_hip_link`."""
        return f"{self.joint}_link"


def links(robot: RobotSpec) -> tuple[Link, ...]:
    """Return the links, in the order of `RobotSpec.joint_names`: link i is moved by joint i."""
    return tuple(link for number, leg in enumerate(robot.legs) for link in _leg(robot, leg, 3 * number))


def foot_position(robot: RobotSpec) -> np.ndarray:
    """Return the middle of the foot in the frame of its shank [m], shape (3,)."""
    return np.array([0.0, 0.0, -robot.shank_link.size[2]])


def _leg(robot: RobotSpec, leg: LegSpec, first: int) -> tuple[Link, ...]:
    """Return hip, thigh and shank of a leg whose hip is link `first`: uniform boxes, one hung on the other."""
    lateral = leg.side * robot.hip_link.size[1]
    thigh, shank = robot.thigh_link.size[2], robot.shank_link.size[2]
    parts = (
        ("hip", -1, leg.mount, (leg.side, 0, 0), robot.hip_link, (0, lateral / 2, 0)),
        ("thigh", first, (0, lateral, 0), (0, 1, 0), robot.thigh_link, (0, 0, -thigh / 2)),
        ("shank", first + 1, (0, 0, -thigh), (0, 1, 0), robot.shank_link, (0, 0, -shank / 2)),
    )
    return tuple(
        Link(
            joint=f"{leg.name}_{kind}",
            parent=parent,
            origin=np.array(origin, float),
            axis=np.array(axis, float),
            mass=link.mass,
            com=np.array(com, float),
            inertia=box_inertia(link.mass, link.size),
        )
        for kind, parent, origin, axis, link, com in parts
    )
