"""Contacts in ODE: the shapes of a robot and its ground, and the contacts between them at every step.

ODE solves for the forces of friction with bounds that must be known before. By itself (`Approx1`) it takes them from
the normal forces as they would be *without* friction, which on a legged robot are wrong. Here the bound is the
coefficient times the normal force of the step before, against the slip; the first step of a contact, and all of
Webots', use `Approx1`.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from stiction.engines.engine import Body
from stiction.engines.ground import Ground
from stiction.engines.ode import library as c
from stiction.engines.ode.robot import OdeRobot
from stiction.robots.shapes import Shape

FOOT, TRUNK, SHANK, PLANE, OBSTACLE = (1 << number for number in range(5))
"""Categories of shapes, as bits."""

MEETS = {FOOT: FOOT | TRUNK, TRUNK: 0, SHANK: 0, PLANE: FOOT | TRUNK, OBSTACLE: FOOT | TRUNK | SHANK}
"""Category -> categories that it collides with; one direction suffices. As in training."""

POINTS = 8
"""Maximum contacts of a pair of shapes; a box on a plane has four."""

APART = 2e-3
"""Minimum distance of two contacts of a pair of shapes; nearer ones are merged [m]."""

SLIPS = 1e-4
"""Minimum speed of a slipping contact [m/s]; a slower one has no direction of slip."""


@dataclass(frozen=True)
class ContactSettings:
    """Softness of contacts, and the bound of their friction."""

    erp: float = 0.2
    """Share of its depth that is corrected in a step [1]."""
    cfm: float = 1e-6
    """Yielding speed per force [m/s/N]: at 2 ms 100 N press a foot 1 µm into the ground."""
    last_step: bool = True
    """True if friction is bounded by the normal force of the last step, and not by `Approx1`."""


class Owner(NamedTuple):
    """Owner of a shape."""

    body: int | None
    """Body of the shape, None for the ground."""
    leg: int | None = None
    """Number of the leg, for a foot."""


GROUND = Owner(None)
"""Owner of shapes without a body."""


class Touch(NamedTuple):
    """Contact that was a joint of the last step."""

    pair: tuple[int, int]
    """Shapes, that of the robot first."""
    leg: int | None
    """Number of the leg whose foot the ground touches."""
    normal: tuple[float, float, float]
    """Normal, into the first shape."""
    feedback: c.Feedback
    """Forces of the joint."""

    def push(self) -> float:
        """Return the normal force of the last step [N]."""
        return sum(part * force for part, force in zip(self.normal, self.feedback.force1, strict=False))


class OdeContacts:
    """Shapes of a robot and its ground, and the contacts of one step."""

    def __init__(
        self, library: ctypes.CDLL, world: int, robot: OdeRobot, body: Body, ground: Ground, settings: ContactSettings
    ) -> None:
        """Add the shapes of robot and ground."""
        self._library, self._world, self._settings = library, world, settings
        self._friction, self._legs = body.ground_friction, len(body.spec.feet)
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
        """Free everything; call it before the bodies are destroyed."""
        library = self._library
        library.dJointGroupDestroy(self._joints)
        library.dSpaceDestroy(self._of_robot)
        library.dSpaceDestroy(self._of_ground)
        for mesh, _, _ in self._meshes:
            library.dGeomTriMeshDataDestroy(mesh)

    def find(self) -> None:
        """Make a joint of every present contact, for the coming step."""
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
        """Remove the contacts of the last step."""
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
        """Make joints of the contacts of two nearby shapes; `pushed`: the last step's force [N]."""
        library, contacts = self._library, self._contacts
        first, second = self._owners[pair[0]], self._owners.get(pair[1], GROUND)
        count = library.dCollide(*pair, POINTS, contacts[0].point, ctypes.sizeof(c.Contact))
        apart = distinct(contacts[:count])
        friction = 1.0 if first.leg is None and second.leg is None else self._friction
        leg = first.leg if second is GROUND else None
        for contact in apart:
            # Evenly, for the contacts of the last step need not be these: a pair is known from step to step, its points
            # are not.
            self._bound(contact, first.body, second.body, friction, pushed / len(apart))
            joint = library.dJointCreateContact(self._world, self._joints, contact)
            library.dJointAttach(joint, first.body, second.body)
            feedback = c.Feedback()
            library.dJointSetFeedback(joint, feedback)
            self._touching.append(Touch(pair, leg, tuple(contact.point.normal[:3]), feedback))

    def _bound(self, contact: c.Contact, first: int | None, second: int | None, friction: float, pushed: float) -> None:
        """Bound the friction at a contact of two bodies that were pushed together with a force [N]."""
        surface = contact.surface
        surface.mode, surface.mu = c.SOFT_ERP | c.SOFT_CFM | c.APPROX1, friction
        if not self._settings.last_step or pushed <= 0.0:
            return
        surface.mode, surface.mu = c.SOFT_ERP | c.SOFT_CFM, friction * pushed
        slip = self._slip(contact.point, first, second)
        speed = sum(part * part for part in slip) ** 0.5
        if speed > SLIPS:
            surface.mode |= c.FIRST_DIRECTION
            contact.first_direction[:3] = [part / speed for part in slip]

    def _slip(self, point: c.ContactPoint, first: int | None, second: int | None) -> list[float]:
        """Return the velocity of the first body at a contact relative to the second, along the surface [m/s]."""
        pairs = zip(self._velocity(point, first), self._velocity(point, second), strict=True)
        relative, normal = [a - b for a, b in pairs], point.normal[:3]
        normal_speed = sum(a * b for a, b in zip(relative, normal, strict=True))
        return [part - normal_speed * direction for part, direction in zip(relative, normal, strict=True)]

    def _velocity(self, point: c.ContactPoint, body: int | None) -> list[float]:
        """Return the velocity of a body at a contact [m/s]; the ground's is zero."""
        velocity = c.Vector()
        if body is not None:
            self._library.dBodyGetPointVel(body, *point.position[:3], velocity)
        return velocity[:3]

    def _add_robot(self, robot: OdeRobot, body: Body) -> None:
        """Add the contact shapes of the robot."""
        spec = body.spec
        for shape in spec.base.shapes:
            self._add_shape(shape, TRUNK, Owner(robot.base), body.base_com)
        for number, (link, part) in enumerate(zip(spec.links, robot.links, strict=True)):
            for leg, foot in enumerate(spec.feet):
                for shape in foot.shapes if foot.link == number else ():
                    self._add_shape(shape, FOOT, Owner(part, leg), link.com)
            for shape in link.shapes:
                self._add_shape(shape, SHANK if shape.contact == "obstacles" else TRUNK, Owner(part), link.com)

    def _add_shape(self, shape: Shape, category: int, owner: Owner, com: Sequence[float] | np.ndarray) -> None:
        """Attach one shape if it has contacts; `com`: its body's centre of mass in the link's frame [m]."""
        if shape.contact == "nothing":
            return
        library, space, (a, b, c_) = self._library, self._of_robot, shape.size
        if shape.kind == "sphere":
            built = library.dCreateSphere(space, a)
        elif shape.kind == "box":
            built = library.dCreateBox(space, 2 * a, 2 * b, 2 * c_)
        elif shape.kind == "hull":
            corners = np.array(shape.vertices)
            built = self._mesh(corners, outward(corners), space)
        else:
            make = library.dCreateCapsule if shape.kind == "capsule" else library.dCreateCylinder
            built = make(space, a, 2 * b)
        self._attach(built, category, owner, np.subtract(shape.position, com))
        if shape.quaternion != (1.0, 0.0, 0.0, 0.0):
            library.dGeomSetOffsetQuaternion(built, (ctypes.c_double * 4)(*shape.quaternion))

    def _add_ground(self, ground: Ground) -> None:
        """Add plane and boxes."""
        library, space = self._library, self._of_ground
        self._categorize(library.dCreatePlane(space, 0.0, 0.0, 1.0, 0.0), PLANE)
        for half, place, turn in zip(ground.half_sizes, ground.positions, ground.quaternions, strict=True):
            box = library.dCreateBox(space, *(2 * half))
            library.dGeomSetPosition(box, *place)
            library.dGeomSetQuaternion(box, (ctypes.c_double * 4)(*turn))
            self._categorize(box, OBSTACLE)

    def _mesh(self, vertices: np.ndarray, faces: np.ndarray, space: int) -> int:
        """Return a shape of triangles; ODE does not copy the arrays, so references to them are stored."""
        vertices, faces = np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.uint32)
        mesh = self._library.dGeomTriMeshDataCreate()
        self._meshes.append((mesh, vertices, faces))
        # 24 and 12: bytes from one vertex, and from one triangle, to the next.
        self._library.dGeomTriMeshDataBuildDouble(
            mesh, vertices.ctypes.data, 24, len(vertices), faces.ctypes.data, faces.size, 12
        )
        return int(self._library.dCreateTriMesh(space, mesh, None, None, None))

    def _attach(self, shape: int, category: int, owner: Owner, offset: np.ndarray) -> None:
        """Attach a shape to its owner, its middle at `offset` from the centre of mass [m], shape (3,)."""
        self._owners[shape] = owner
        self._categorize(shape, category)
        self._library.dGeomSetBody(shape, owner.body)
        self._library.dGeomSetOffsetPosition(shape, *offset)

    def _categorize(self, shape: int, category: int) -> None:
        """Set the category of a shape, and the categories that it collides with."""
        self._library.dGeomSetCategoryBits(shape, category)
        self._library.dGeomSetCollideBits(shape, MEETS[category])


def outward(corners: np.ndarray) -> np.ndarray:
    """Return the triangles of a convex hull, corners in outward order, shape (faces, 3)."""
    hull = ConvexHull(corners)
    faces = hull.simplices.copy()
    normals = np.cross(corners[faces[:, 1]] - corners[faces[:, 0]], corners[faces[:, 2]] - corners[faces[:, 0]])
    inward = (normals * hull.equations[:, :3]).sum(axis=1) < 0
    faces[inward] = faces[inward][:, ::-1]
    return faces


def distinct(contacts: list[c.Contact]) -> list[c.Contact]:
    """Return contacts at least `APART` from each other, the deepest of nearer ones.

    A foot on an edge between two triangles touches both at one point; equal rows make the solver slow, and fail.
    """
    apart: list[c.Contact] = []
    for contact in sorted(contacts, key=lambda contact: -contact.point.depth):
        if all(math.dist(contact.point.position[:3], other.point.position[:3]) >= APART for other in apart):
            apart.append(contact)
    return apart
