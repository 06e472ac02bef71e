"""Quadrupeds with equal legs of hip, thigh and calf, each in the maker's axes: hips turn about x, the others about y.

One leg is given, the one at the front left. The others are its mirror images, but every axis points as the front left
one does: so do the motors of most makers, and the angle of a hip that opens a left leg closes a right one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from boxes import FEET, SHANK_RADIUS, THIGH_RADIUS, TRUNK, bone, reflect

from stiction.robots.model import Base, Foot, Joint, Link, Robot, Vendor, with_standing_height
from stiction.robots.shapes import Shape, Vector

CORNERS = ("FR", "FL", "RR", "RL")
"""Legs in the maker's order."""

GROUPS = {"FL": 0, "RR": 0, "FR": 1, "RL": 1}
"""Legs that step together in a trot."""

BONE: Vector = (0.45, 0.5, 0.56)


@dataclass(frozen=True)
class Segment:
    """One link of the front left leg, in its own frame; frames are parallel to the base's at angles of zero."""

    origin: Vector
    """Where its joint is on the link before it [m]."""
    mass: float
    com: Vector
    inertia: tuple[float, float, float, float, float, float]
    """About the centre of mass: xx, yy, zz, xy, xz, yz [kg m²]."""


@dataclass(frozen=True)
class Quadruped:
    """A quadruped by its front left leg; `robot` builds it."""

    name: str
    base: Base
    """The trunk, without shapes: its box is `size`."""
    hip: Segment
    thigh: Segment
    calf: Segment
    calf_is_mirrored: bool
    """True if right calves are mirror images of left ones; False if they are the same part."""
    foot: Vector
    """Middle of the foot on the calf [m]."""
    foot_radius: float
    joints: tuple[Joint, Joint, Joint]
    """Hip, thigh and calf; their names are made from the leg's and the kind's."""
    rear_thigh_limits: tuple[float, float] | None = None
    """Where those of the rear legs differ [rad]."""

    def robot(self) -> Robot:
        """Return the robot."""
        links = tuple(link for number, leg in enumerate(CORNERS) for link in self._links(leg, 3 * number))
        joints = tuple(self._joint(leg, joint) for leg in CORNERS for joint in self.joints)
        feet = tuple(self._foot(leg, 3 * number + 2) for number, leg in enumerate(CORNERS))
        x, y, z = (extent / 2 for extent in self.base.size)
        trunk = Shape("box", (x, y, z), self.base.center, contact="ground", color=TRUNK)
        names = tuple(joint.name for joint in joints)
        robot = Robot(
            name=self.name,
            base=replace(self.base, shapes=(trunk,)),
            links=links,
            joints=joints,
            feet=feet,
            standing_height=1.0,
            vendor=Vendor(names, (1.0,) * len(names), (0.0,) * len(names)),
        )
        return with_standing_height(robot)

    def _joint(self, leg: str, joint: Joint) -> Joint:
        """Return one joint of a leg."""
        limits = self.rear_thigh_limits if leg[0] == "R" and joint.kind == "thigh" else None
        lower, upper = limits or (joint.lower, joint.upper)
        return replace(joint, name=f"{leg}_{joint.kind}_joint", lower=lower, upper=upper)

    def _links(self, leg: str, first: int) -> tuple[Link, ...]:
        """Return hip, thigh and calf of a leg whose hip is link `first`."""
        rear, right = leg[0] == "R", leg[1] == "R"
        hip = reflect(_link(f"{leg}_hip", -1, self.hip, (1.0, 0.0, 0.0)), x=rear, y=right)
        thigh = reflect(_link(f"{leg}_thigh", first, self.thigh, (0.0, 1.0, 0.0)), y=right)
        calf = reflect(_link(f"{leg}_calf", first + 1, self.calf, (0.0, 1.0, 0.0)), y=right and self.calf_is_mirrored)
        knee, ankle = np.array(self.calf.origin), np.array(self.foot)
        return (
            hip,
            replace(thigh, shapes=(bone(float(-knee[2]), THIGH_RADIUS, "nothing", BONE),)),
            replace(calf, shapes=(bone(float(-ankle[2]), SHANK_RADIUS, "obstacles", BONE),)),
        )

    def _foot(self, leg: str, link: int) -> Foot:
        """Return the ball at the end of a leg."""
        group = GROUPS[leg]
        ball = Shape("sphere", (self.foot_radius, 0.0, 0.0), self.foot, contact="ground", color=FEET[group])
        return Foot(f"{leg}_foot", link, self.foot, self.foot_radius, (ball,), group)


def _link(name: str, parent: int, segment: Segment, axis: Vector) -> Link:
    """Return a link of the front left leg."""
    return Link(
        name=name,
        parent=parent,
        origin=segment.origin,
        axis=axis,
        mass=segment.mass,
        com=segment.com,
        inertia=segment.inertia,
    )
