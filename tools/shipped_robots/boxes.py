"""Robots made of boxes: a trunk and any number of equal legs with three joints each, hip, thigh and shank.

Links are boxes of uniform density; a thigh is seen as a capsule, a shank catches on edges, a foot is a ball.
Legs on the right mirror those on the left: their hips turn about the opposite axis, so that equal angles look alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stiction.core.errors import RobotError
from stiction.robots.model import Base, Foot, Joint, Link, Robot
from stiction.robots.shapes import Contact, Shape, Vector, vector

KINDS = ("hip", "thigh", "shank")
"""The joints of a leg, from the trunk down: abduction, flexion, knee. Fields of `BoxLegs` have these names."""

THIGH_RADIUS, SHANK_RADIUS = 0.02, 0.013
"""Radii of the capsules [m]. A thigh's is there to be seen; a shank catches with its own on an edge."""

TRUNK: Vector = (0.82, 0.84, 0.86)
THIGH: Vector = (0.25, 0.3, 0.36)
SHANK: Vector = (0.55, 0.6, 0.66)

FEET: tuple[Vector, Vector] = ((0.9, 0.45, 0.15), (0.15, 0.5, 0.85))
"""Colors by contact group."""


def box_inertia(mass: float, size: Sequence[float]) -> np.ndarray:
    """Return the principal moments of a uniform box [kg m²], shape (3,). `size` is its full extent [m]."""
    x, y, z = size
    return mass / 12.0 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])


def reflect(body: Link, x: bool = False, y: bool = False) -> Link:
    """Return the mirror image of a link, in the plane across x or across y, with its axis as it is."""
    sign = np.array([-1.0 if x else 1.0, -1.0 if y else 1.0, 1.0])
    xx, yy, zz, xy, xz, yz = body.inertia
    inertia = (xx, yy, zz, float(xy * sign[0] * sign[1]), float(xz * sign[0]), float(yz * sign[1]))
    return replace(body, origin=vector(sign * body.origin), com=vector(sign * body.com), inertia=inertia)


@dataclass(frozen=True)
class Box:
    """One rigid link."""

    mass: float
    """Mass [kg]."""
    size: Vector
    """Full extent along x, y, z in the link's frame [m]."""


@dataclass(frozen=True)
class Leg:
    """Where one leg is mounted."""

    name: str
    """Two letters, front/middle/rear and left/right: `FL`."""
    mount: Vector
    """Position of the hip joint in the base's frame [m]."""
    group: int
    """Contact group of the tripod or trot (0 or 1)."""

    @property
    def side(self) -> float:
        """+1 on the left, -1 on the right."""
        return 1.0 if self.mount[1] > 0 else -1.0


@dataclass(frozen=True)
class BoxLegs:
    """A robot made of boxes; `robot` builds it."""

    name: str
    trunk: Box
    hip_link: Box
    """From the hip axis to the thigh axis; `size[1]` is the lateral offset between them."""
    thigh_link: Box
    """From the thigh axis down to the knee; `size[2]` is its length."""
    shank_link: Box
    """From the knee down to the foot; `size[2]` is its length."""
    foot_radius: float
    """[m]."""
    hip: Joint
    """Abduction, axis x; names and kinds are made from the legs' and these fields'."""
    thigh: Joint
    """Flexion at the hip, axis y."""
    shank: Joint
    """Knee, axis y."""
    legs: tuple[Leg, ...]

    def robot(self) -> Robot:
        """Return the robot.

        Raises `RobotError` where it could not be built.
        """
        if len(self.legs) < 2:
            raise RobotError(f"robot {self.name!r}: {len(self.legs)} legs; expected at least two")
        return Robot(
            name=self.name,
            base=Base(
                mass=self.trunk.mass,
                com=(0.0, 0.0, 0.0),
                inertia=_inertia(self.trunk),
                size=self.trunk.size,
                shapes=(_box(self.trunk.size, "ground"),),
            ),
            links=tuple(link for number, leg in enumerate(self.legs) for link in self._links(leg, 3 * number)),
            joints=tuple(self._joint(leg, kind) for leg in self.legs for kind in KINDS),
            feet=tuple(self._foot(leg, 3 * number + 2) for number, leg in enumerate(self.legs)),
            standing_height=self._height(),
        )

    def _joint(self, leg: Leg, kind: str) -> Joint:
        """Return one joint of a leg."""
        joint: Joint = getattr(self, kind)
        return replace(joint, name=f"{leg.name}_{kind}", kind=kind)

    def _links(self, leg: Leg, first: int) -> tuple[Link, ...]:
        """Return hip, thigh and shank of a leg whose hip is link `first`: one hung on the other."""
        lateral = leg.side * self.hip_link.size[1]
        thigh, shank = self.thigh_link.size[2], self.shank_link.size[2]
        bones = ((), (bone(thigh, THIGH_RADIUS, "nothing", THIGH),), (bone(shank, SHANK_RADIUS, "obstacles", SHANK),))
        parts = (
            ("hip", -1, leg.mount, (leg.side, 0.0, 0.0), self.hip_link, (0.0, lateral / 2, 0.0)),
            ("thigh", first, (0.0, lateral, 0.0), (0.0, 1.0, 0.0), self.thigh_link, (0.0, 0.0, -thigh / 2)),
            ("shank", first + 1, (0.0, 0.0, -thigh), (0.0, 1.0, 0.0), self.shank_link, (0.0, 0.0, -shank / 2)),
        )
        return tuple(
            Link(
                name=f"{leg.name}_{kind}_link",
                parent=parent,
                origin=origin,
                axis=axis,
                mass=link.mass,
                com=com,
                inertia=_inertia(link),
                shapes=shapes,
            )
            for (kind, parent, origin, axis, link, com), shapes in zip(parts, bones, strict=True)
        )

    def _foot(self, leg: Leg, link: int) -> Foot:
        """Return the ball at the end of a leg."""
        middle = (0.0, 0.0, -self.shank_link.size[2])
        ball = Shape("sphere", (self.foot_radius, 0.0, 0.0), position=middle, contact="ground", color=FEET[leg.group])
        return Foot(f"{leg.name}_foot", link, middle, self.foot_radius, (ball,), leg.group)

    def _height(self) -> float:
        """Return the height of the base in the standing pose: planar kinematics of thigh and shank."""
        angle = self.thigh.default_position
        leg = self.thigh_link.size[2] * np.cos(angle)
        leg += self.shank_link.size[2] * np.cos(angle + self.shank.default_position)
        return float(leg * np.cos(self.hip.default_position) + self.foot_radius)


def _inertia(box: Box) -> tuple[float, float, float, float, float, float]:
    """Return the inertia of a box about its middle."""
    xx, yy, zz = box_inertia(box.mass, box.size).tolist()
    return xx, yy, zz, 0.0, 0.0, 0.0


def _box(size: Vector, contact: Contact) -> Shape:
    """Return the box of a trunk; `size`: its full extent [m]."""
    x, y, z = (extent / 2 for extent in size)
    return Shape("box", (x, y, z), contact=contact, color=TRUNK)


def bone(length: float, radius: float, contact: Contact, color: Vector) -> Shape:
    """Return a capsule from the link's joint straight down."""
    half = 0.5 * length
    return Shape("capsule", (radius, half, 0.0), (0.0, 0.0, -half), contact=contact, color=color)
