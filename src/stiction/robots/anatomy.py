"""Rigid bodies of a compiled model; the frames of links are parallel to the base's at angles of zero.

Bodies without a driven joint between them are one link: masses add up, inertias by the parallel-axis theorem. MuJoCo's
kinematics gives all places at angles of zero, so that a joint's reference, the frames of the file and nested bodies
need no formula here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from stiction.core.errors import RobotError, unknown_name
from stiction.robots.hold import Frame, merge
from stiction.robots.model import Body, Link
from stiction.robots.shapes import Contact, Shape, ShapeKind, Vector

MOST_CORNERS = 64
"""Maximum corners of a hull that replaces a mesh, as in PhysX."""


@dataclass(frozen=True)
class Part(Link):
    """Link, or the base, as in the file; `shapes` includes those that are only visible."""

    bodies: tuple[int, ...] = ()
    """Numbers of its bodies."""
    tip: str = ""
    """Name of its outermost body, which is often the foot."""
    touched: tuple[Shape, ...] = ()
    """Shapes that have contacts in the file."""
    geoms: tuple[int, ...] = ()
    """Numbers of the geometries of `touched`."""


@dataclass(frozen=True)
class Anatomy:
    """Base and links of a robot, and the numbers of its joints in the model."""

    base: Part
    links: tuple[Part, ...]
    joints: tuple[int, ...]
    """Number in the model of each link's joint."""


def hinges(model: mujoco.MjModel) -> list[int]:
    """Return the numbers of all hinges, in the order of the model."""
    return np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE)).tolist()


def dissect(model: mujoco.MjModel, base: str | None, origin: str) -> Anatomy:
    """Return the links of a model.

    base: name of the body whose frame is the robot's, None: the floating body; origin: the file's name.

    Raises `RobotError` where a body has two joints, or the base is not rigid with the floating body.
    """
    driven = hinges(model)
    moved: dict[int, int] = {}
    for number, joint in enumerate(driven):
        body = int(model.jnt_bodyid[joint])
        if body in moved:
            raise RobotError(
                f"{origin}: the body {model.body(body).name!r} has more than one joint; give each a body of its own"
            )
        moved[body] = number
    root = int(model.body_rootid[model.jnt_bodyid[driven[0]]])
    owner = owners(model, driven, root)
    data = at_zero(model)
    body = _named_base(model, base, owner, origin) if base else root
    frame = data.xpos[body].copy(), data.xmat[body].reshape(3, 3).copy()
    links = tree(model, data, driven, owner, frame)
    whole = _rigid(model, data, owner, -1, frame)
    return Anatomy(
        _part(model, data, owner, -1, frame, Link(**vars(whole), name=model.body(root).name)),
        tuple(
            _part(model, data, owner, number, (frame[0] + frame[1] @ anchor, frame[1]), link)
            for number, (link, anchor) in enumerate(zip(links, _anchors(data, driven, frame), strict=True))
        ),
        tuple(driven),
    )


def owners(model: mujoco.MjModel, driven: Sequence[int], root: int | None = None) -> list[int]:
    """Return the link of each body: the number of the last hinge that moves it, -1 for the base.

    root: the floating body; all bodies not on it then have -2; None: the world itself is the base.
    """
    last = {int(model.jnt_bodyid[joint]): number for number, joint in enumerate(driven)}
    owner = [-1 if root is None else -2]
    for body in range(1, model.nbody):
        owner.append(-1 if body == root else last.get(body, owner[int(model.body_parentid[body])]))
    return owner


def at_zero(model: mujoco.MjModel) -> mujoco.MjData:
    """Return the pose with hinges at zero, all else at its reference, and a floating base at the origin."""
    data = mujoco.MjData(model)
    for joint in range(model.njnt):
        address = int(model.jnt_qposadr[joint])
        if model.jnt_type[joint] == int(mujoco.mjtJoint.mjJNT_HINGE):
            data.qpos[address] = 0.0
        elif model.jnt_type[joint] == int(mujoco.mjtJoint.mjJNT_FREE):
            data.qpos[address : address + 7] = (0, 0, 0, 1, 0, 0, 0)
    mujoco.mj_kinematics(model, data)
    return data


def tree(
    model: mujoco.MjModel, data: mujoco.MjData, driven: Sequence[int], owner: Sequence[int], frame: Frame
) -> list[Link]:
    """Return the tree of links that hinges move, without shapes, in frames parallel to the world's; data: see
    `at_zero`.

    A body with several hinges is a chain of links, of which only the last has its mass.
    """
    links, anchors = [], _anchors(data, driven, frame)
    for number, joint in enumerate(driven):
        body, (place, turn) = int(model.jnt_bodyid[joint]), frame
        chained = number > 0 and int(model.jnt_bodyid[driven[number - 1]]) == body
        parent = number - 1 if chained else owner[int(model.body_parentid[body])]
        links.append(
            Link(
                **vars(_rigid(model, data, owner, number, (place + turn @ anchors[number], turn))),
                name=model.body(body).name or model.joint(joint).name,
                parent=parent,
                origin=as_vector(anchors[number] - anchors[parent] if parent >= 0 else anchors[number]),
                axis=as_vector(turn.T @ data.xaxis[joint]),
            )
        )
    return links


def _anchors(data: mujoco.MjData, driven: Sequence[int], frame: Frame) -> list[np.ndarray]:
    """Return the places of hinges in a frame of the world [m]."""
    return [frame[1].T @ (data.xanchor[joint] - frame[0]) for joint in driven]


def _rigid(model: mujoco.MjModel, data: mujoco.MjData, owner: Sequence[int], number: int, frame: Frame) -> Body:
    """Return the bodies of one owner merged, without shapes, in a frame of the world."""
    place, turn = frame
    parts = []
    for body in np.flatnonzero(np.equal(owner, number)):
        # Along its principal axes, about its centre of mass.
        x, y, z = (float(moment) for moment in model.body_inertia[body])
        mass = Body(float(model.body_mass[body]), (0.0, 0.0, 0.0), (x, y, z, 0.0, 0.0, 0.0))
        parts.append((mass, (turn.T @ (data.xipos[body] - place), turn.T @ data.ximat[body].reshape(3, 3))))
    whole = merge(parts)
    return replace(whole, com=as_vector(whole.com))


def _named_base(model: mujoco.MjModel, name: str, owner: Sequence[int], origin: str) -> int:
    """Return the number of the body whose frame is the robot's."""
    names = [model.body(body).name for body in range(1, model.nbody)]
    if name not in names:
        raise RobotError(f"{origin}: base: {unknown_name('body', name, names)}")
    body = names.index(name) + 1
    if owner[body] != -1:
        raise RobotError(
            f"{origin}: base: joints move {name!r} against the body that floats; name a body rigid with it"
        )
    return body


def as_vector(values: Sequence[float] | np.ndarray) -> Vector:
    """Return three numbers, with rounding errors set to zero."""
    x, y, z = (0.0 if abs(value) < 1e-12 else float(value) for value in values)
    return x, y, z


def _part(
    model: mujoco.MjModel, data: mujoco.MjData, owner: Sequence[int], number: int, frame: Frame, link: Link
) -> Part:
    """Return a link, or the base (-1), with its shapes and its tip; frame: its frame in the world."""
    bodies = np.flatnonzero(np.equal(owner, number)).tolist()
    geoms = [geom for geom in range(model.ngeom) if int(model.geom_bodyid[geom]) in set(bodies)]
    # Some files leave the bits to the program that loads them, and only the names say what is to touch.
    solid = [
        geom
        for geom in geoms
        if model.geom_contype[geom] or model.geom_conaffinity[geom] or "collision" in model.geom(geom).name
    ]
    shape_of = {geom: _shape(model, data, geom, frame) for geom in geoms}
    shapes = {geom: shape for geom, shape in shape_of.items() if shape is not None}
    shaped = [body for body in bodies if model.body_geomnum[body]] or bodies
    outermost = max(shaped, key=lambda body: _depth(model, body))
    return Part(
        **vars(link) | {"shapes": tuple(shapes.values())},
        bodies=tuple(bodies),
        tip=model.body(outermost).name or link.name,
        touched=tuple(shapes[geom] for geom in solid if geom in shapes),
        geoms=tuple(geom for geom in solid if geom in shapes),
    )


def _depth(model: mujoco.MjModel, body: int) -> int:
    """Return the depth of a body in the tree."""
    return 1 + _depth(model, int(model.body_parentid[body])) if body else 0


_PLAIN: dict[int, ShapeKind] = {
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
}


def _shape(model: mujoco.MjModel, data: mujoco.MjData, geom: int, frame: Frame) -> Shape | None:
    """Return one geometry in a frame of the world; None for planes, height fields and the like."""
    place, turn = frame
    position = as_vector(turn.T @ (data.geom_xpos[geom] - place))
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, (turn.T @ data.geom_xmat[geom].reshape(3, 3)).ravel())
    contact: Contact = "ground" if model.geom_contype[geom] or model.geom_conaffinity[geom] else "nothing"
    red, green, blue = (float(value) for value in model.geom_rgba[geom][:3])
    w, x, y, z = quaternion.tolist()
    common: dict[str, Any] = {
        "position": position,
        "quaternion": (w, x, y, z),
        "contact": contact,
        "color": (red, green, blue),
    }
    kind = int(model.geom_type[geom])
    if kind in _PLAIN:
        a, b, c = (float(value) for value in model.geom_size[geom])
        return Shape(_PLAIN[kind], (a, b, c), **common)
    if kind == int(mujoco.mjtGeom.mjGEOM_MESH):
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        return Shape("hull", (0.0, 0.0, 0.0), vertices=hull(model.mesh_vert[first : first + count]), **common)
    if kind == int(mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        return Shape("hull", (0.0, 0.0, 0.0), vertices=hull(_directions() * model.geom_size[geom]), **common)
    return None


def hull(points: np.ndarray) -> tuple[Vector, ...]:
    """Return at most `MOST_CORNERS` corners of the convex hull of points, shape (count, 3).

    The corners are those that reach furthest along directions spread evenly over the sphere; the hull shrinks between
    them, never at the points that reach furthest down.
    """
    points = np.asarray(points, float)
    try:
        corners = points[ConvexHull(points).vertices]
    except QhullError as error:
        raise RobotError("a mesh is flat or a line; it has no convex hull of any volume") from error
    if len(corners) > MOST_CORNERS:
        # The extremes along the axes first, so that the extent of the hull is exact.
        axes = np.concatenate((np.eye(3), -np.eye(3)))
        best = {int(number) for number in np.argmax(corners @ axes.T, axis=0)}
        for direction in _directions():
            if len(best) == MOST_CORNERS:
                break
            best.add(int(np.argmax(corners @ direction)))
        corners = corners[sorted(best)]
    return tuple(as_vector(corner) for corner in corners)


DIRECTIONS = 120
"""Number of directions in which corners of a shape are searched."""


def _directions() -> np.ndarray:
    """Return directions spread evenly over the sphere (Fibonacci's lattice), shape (DIRECTIONS, 3)."""
    count = DIRECTIONS
    height = 1.0 - 2.0 * (np.arange(count) + 0.5) / count
    angle = np.pi * (1.0 + 5.0**0.5) * np.arange(count)
    radius = np.sqrt(1.0 - height**2)
    return np.stack((radius * np.cos(angle), radius * np.sin(angle), height), -1)
