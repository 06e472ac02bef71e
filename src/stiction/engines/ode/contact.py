"""What touches what in ODE: the shapes of a robot and its ground, and the contacts between them at every step.

ODE solves for the forces of friction with bounds that must be known before. Its own way (`Approx1`) is to take them
from the normal forces as they would be *without* friction on the ground, which on a legged robot are others: a gait
without feedback gets less far than in MuJoCo. Here the bound is the coefficient times the normal force of the
step before, against the slip. The first step of a contact has no step before, and Webots knows no other way than ODE's.

A height field is a mesh of its triangles: ODE's own height field misses contacts of a foot with edges and corners.
"""

from __future__ import annotations

import ctypes
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stiction.engines.engine import Body
from stiction.engines.ground import Ground, HeightField
from stiction.engines.ode import library as c
from stiction.engines.ode.robot import OdeRobot
from stiction.robots.tree import SHANK_RADIUS, foot_position, links

FOOT, TRUNK, SHANK, PLANE, OBSTACLE = (1 << number for number in range(5))
"""What a shape is, as a bit."""

MEETS = {FOOT: FOOT | TRUNK, TRUNK: 0, SHANK: 0, PLANE: FOOT | TRUNK, OBSTACLE: FOOT | TRUNK | SHANK}
"""What a shape is -> what it meets; two shapes touch if one of them meets the other. As in training."""

POINTS = 8
"""Most contacts of a pair of shapes; a box on a plane has four."""

APART = 2e-3
"""Contacts of a pair of shapes that are nearer to each other are one [m]."""

SLIPS = 1e-4
"""A contact that moves faster than this slips [m/s]; a slower one has no direction of slip worth the name."""


@dataclass(frozen=True)
class ContactSettings:
    """How a contact gives way, and what bounds its friction."""

    erp: float = 0.2
    """Share of its depth that is corrected in a step [1]."""
    cfm: float = 1e-6
    """Speed at which it gives way, per force [m/s/N]: at 2 ms 100 N press a foot 1 µm into the ground."""
    last_step: bool = True
    """Whether friction is bounded by the normal force of the last step, and not in ODE's own way."""


class Owner(NamedTuple):
    """Whose a shape is."""

    body: int | None
    """The body that it belongs to, None for the ground."""
    leg: int | None = None
    """Number of the leg, for a foot."""


GROUND = Owner(None)
"""The owner of shapes that belong to no body."""


class Touch(NamedTuple):
    """A contact that was a joint of the last step."""

    pair: tuple[int, int]
    """The shapes, that of the robot first."""
    leg: int | None
    """Number of the leg whose foot the ground touches."""
    normal: tuple[float, float, float]
    """Into the first shape."""
    feedback: c.Feedback
    """What the joint did."""

    def push(self) -> float:
        """Return the normal force of the last step [N]."""
        return sum(part * force for part, force in zip(self.normal, self.feedback.force1, strict=False))


class OdeContacts:
    """The shapes of a robot and its ground, and the contacts of one step."""

    def __init__(
        self, library: ctypes.CDLL, world: int, robot: OdeRobot, body: Body, ground: Ground, settings: ContactSettings
    ) -> None:
        """Give the robot its shapes and lay the ground."""
        self._library, self._world, self._settings = library, world, settings
        self._friction, self._legs = body.ground_friction, len(body.spec.legs)
        self._owners: dict[int, Owner] = {}
        self._meshes: list[tuple[int, np.ndarray, np.ndarray]] = []
        self._of_robot, self._of_ground = library.dSimpleSpaceCreate(None), library.dSimpleSpaceCreate(None)
        self._joints = library.dJointGroupCreate(0)
        self._add_robot(robot, body)
        self._add_ground(ground)
        self._contacts = (c.Contact * POINTS)()
        for contact in self._contacts:
            contact.surface.soft_erp, contact.surface.soft_cfm = settings.erp, settings.cfm
        self._touching: list[Touch] = []
        self._near: list[tuple[int, int]] = []
        near = self._near
        self._remember = c.NearCallback(lambda data, first, second: near.append((first, second)))

    def release(self) -> None:
        """Give everything back to ODE. Bodies are destroyed after this: their shapes know them."""
        library = self._library
        library.dJointGroupDestroy(self._joints)
        library.dSpaceDestroy(self._of_robot)
        library.dSpaceDestroy(self._of_ground)
        for mesh, _, _ in self._meshes:
            library.dGeomTriMeshDataDestroy(mesh)

    def find(self) -> None:
        """Make a joint of every contact that there is now, for the coming step."""
        pushed: dict[tuple[int, int], float] = {}
        for touch in self._touching:
            pushed[touch.pair] = pushed.get(touch.pair, 0.0) + touch.push()
        self.forget()
        self._near.clear()
        self._library.dSpaceCollide(self._of_robot, None, self._remember)
        self._library.dSpaceCollide2(self._of_robot, self._of_ground, None, self._remember)
        for first, second in self._near:
            pair = (first, second) if first in self._owners else (second, first)
            self._touch(pair, pushed.get(pair, 0.0))

    def forget(self) -> None:
        """Take the contacts of the last step out of the world, and forget how they pushed."""
        self._library.dJointGroupEmpty(self._joints)
        self._touching.clear()

    def pushes(self) -> np.ndarray:
        """Return the normal force of the ground on each foot in the last step [N], shape (legs,)."""
        push = np.zeros(self._legs)
        for touch in self._touching:
            if touch.leg is not None:
                push[touch.leg] += touch.push()
        return push

    def _touch(self, pair: tuple[int, int], pushed: float) -> None:
        """Make joints of the contacts of two shapes that are near each other; `pushed`: the last step's force [N]."""
        library, contacts = self._library, self._contacts
        one, other = self._owners[pair[0]], self._owners.get(pair[1], GROUND)
        count = library.dCollide(*pair, POINTS, contacts[0].point, ctypes.sizeof(c.Contact))
        apart = distinct(contacts[:count])
        friction = 1.0 if one.leg is None and other.leg is None else self._friction
        leg = one.leg if other is GROUND else None
        for contact in apart:
            self._bound(contact, one.body, other.body, friction, pushed / len(apart))
            joint = library.dJointCreateContact(self._world, self._joints, contact)
            library.dJointAttach(joint, one.body, other.body)
            feedback = c.Feedback()
            library.dJointSetFeedback(joint, feedback)
            self._touching.append(Touch(pair, leg, tuple(contact.point.normal[:3]), feedback))

    def _bound(self, contact: c.Contact, one: int | None, other: int | None, friction: float, pushed: float) -> None:
        """Say what friction may do at a contact of two bodies that were pushed together with a force [N]."""
        surface = contact.surface
        surface.mode, surface.mu = c.SOFT_ERP | c.SOFT_CFM | c.APPROX1, friction
        if not self._settings.last_step or pushed <= 0.0:
            return
        surface.mode, surface.mu = c.SOFT_ERP | c.SOFT_CFM, friction * pushed
        slip = self._slip(contact.point, one, other)
        speed = sum(part * part for part in slip) ** 0.5
        if speed > SLIPS:
            surface.mode |= c.FIRST_DIRECTION
            contact.first_direction[:3] = [part / speed for part in slip]

    def _slip(self, point: c.ContactPoint, one: int | None, other: int | None) -> list[float]:
        """Return the velocity of the first body at a contact against the second, along the surface [m/s]."""
        pairs = zip(self._velocity(point, one), self._velocity(point, other), strict=True)
        relative, normal = [a - b for a, b in pairs], point.normal[:3]
        away = sum(a * b for a, b in zip(relative, normal, strict=True))
        return [part - away * direction for part, direction in zip(relative, normal, strict=True)]

    def _velocity(self, point: c.ContactPoint, body: int | None) -> list[float]:
        """Return the velocity of a body where a contact is [m/s]; the ground's is zero."""
        velocity = c.Vector()
        if body is not None:
            self._library.dBodyGetPointVel(body, *point.position[:3], velocity)
        return velocity[:3]

    def _add_robot(self, robot: OdeRobot, body: Body) -> None:
        """Add the trunk's box, and sphere and capsule of every leg."""
        library, space, spec = self._library, self._of_robot, body.spec
        tree = links(spec)
        trunk = library.dCreateBox(space, *spec.base.size)
        self._fasten(trunk, TRUNK, Owner(robot.base), -np.array(body.base_com))
        for leg in range(self._legs):
            number = 3 * leg + 2
            shank, foot = robot.links[number], library.dCreateSphere(space, spec.foot_radius)
            self._fasten(foot, FOOT, Owner(shank, leg), foot_position(spec) - tree[number].com)
            capsule = library.dCreateCapsule(space, SHANK_RADIUS, spec.shank_link.size[2])
            self._fasten(capsule, SHANK, Owner(shank), foot_position(spec) / 2 - tree[number].com)

    def _add_ground(self, ground: Ground) -> None:
        """Add plane, boxes and the triangles of the height field."""
        library, space = self._library, self._of_ground
        self._sort(library.dCreatePlane(space, 0.0, 0.0, 1.0, 0.0), PLANE)
        for half, place, turn in zip(ground.half_sizes, ground.positions, ground.quaternions, strict=True):
            box = library.dCreateBox(space, *(2 * half))
            library.dGeomSetPosition(box, *place)
            library.dGeomSetQuaternion(box, (ctypes.c_double * 4)(*turn))
            self._sort(box, OBSTACLE)
        if ground.field is not None:
            self._sort(self._mesh(ground.field), OBSTACLE)

    def _mesh(self, field: HeightField) -> int:
        """Return a shape of the field's triangles. ODE reads the arrays where they are, so they are kept."""
        vertices, faces = field.triangles()
        vertices, faces = np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.uint32)
        mesh = self._library.dGeomTriMeshDataCreate()
        self._meshes.append((mesh, vertices, faces))
        self._library.dGeomTriMeshDataBuildDouble(
            mesh, vertices.ctypes.data, 24, len(vertices), faces.ctypes.data, faces.size, 12
        )
        return self._library.dCreateTriMesh(self._of_ground, mesh, None, None, None)

    def _fasten(self, shape: int, kind: int, owner: Owner, offset: np.ndarray) -> None:
        """Fasten a shape to its owner, its middle `offset` away from the centre of mass [m], shape (3,)."""
        self._owners[shape] = owner
        self._sort(shape, kind)
        self._library.dGeomSetBody(shape, owner.body)
        self._library.dGeomSetOffsetPosition(shape, *offset)

    def _sort(self, shape: int, kind: int) -> None:
        """Say what a shape is, and what it meets."""
        self._library.dGeomSetCategoryBits(shape, kind)
        self._library.dGeomSetCollideBits(shape, MEETS[kind])


def distinct(contacts: list[c.Contact]) -> list[c.Contact]:
    """Return contacts at least `APART` from each other; of those that are nearer the deepest.

    A foot on an edge between two triangles touches both, in one place. Equal rows make the solver slow, and fail.
    """
    if len(contacts) < 2:
        return contacts
    kept: list[c.Contact] = []
    for contact in sorted(contacts, key=lambda contact: -contact.point.depth):
        if all(math.dist(contact.point.position[:3], other.point.position[:3]) >= APART for other in kept):
            kept.append(contact)
    return kept
