"""The rigid bodies of a compiled model, as links with frames parallel to the base's where all angles are zero.

Bodies that no driven joint parts are one link: masses add up, inertias by the parallel-axis theorem. MuJoCo's own
kinematics says where everything is at angles of zero, so that a joint's reference, the frames of the file and nested
bodies need no formula here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from stiction.core.errors import RobotError, unknown_name
from stiction.robots.hold import Frame, merge
from stiction.robots.model import Body
from stiction.robots.shapes import Contact, Shape, ShapeKind, Vector

MOST_CORNERS = 64
"""Corners of a hull that stands for a mesh: as many as PhysX takes."""


@dataclass(frozen=True)
class Part(Body):
    """One link, or the base, as the file has it."""

    name: str = ""
    """Of the body that the joint moves."""
    bodies: tuple[int, ...] = ()
    """Numbers of the bodies that it is made of."""
    tip: str = ""
    """Name of the body furthest out, which is often the foot."""
    parent: int = -1
    origin: Vector = (0.0, 0.0, 0.0)
    axis: Vector = (0.0, 0.0, 1.0)
    touched: tuple[Shape, ...] = ()
    """Shapes that touch something in the file; `shapes` has those that are only seen, too."""
    geoms: tuple[int, ...] = ()
    """Numbers of the geometries of `touched`."""


@dataclass(frozen=True)
class Anatomy:
    """The base and the links of a robot, and its joints as numbers in the model."""

    base: Part
    links: tuple[Part, ...]
    joints: tuple[int, ...]
    """Number in the model of the joint that moves each link."""


def hinges(model: mujoco.MjModel) -> list[int]:
    """Return the numbers of all hinges, in the order of the model."""
    return np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE)).tolist()


def dissect(model: mujoco.MjModel, base: str | None, origin: str) -> Anatomy:
    """Return the links of a model.

    base: name of the body whose frame is the robot's, None: that of the body that floats; origin: the file's name.

    Raises `RobotError` where a body has two joints, or the base is not rigid with the body that floats.
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
    # -2: the world's own bodies, which belong to no part of the robot.
    owner = {0: -2, root: -1}
    for body in range(1, model.nbody):
        if body != root:
            owner[body] = moved.get(body, owner[int(model.body_parentid[body])])
    frame = _named_base(model, base, owner, origin) if base else root
    data = _at_zero(model)
    middle, turn = data.xpos[frame].copy(), data.xmat[frame].reshape(3, 3).copy()
    anchors = np.array([turn.T @ (data.xanchor[joint] - middle) for joint in driven])
    axes = np.array([turn.T @ data.xaxis[joint] for joint in driven])
    parts = []
    for number in range(-1, len(driven)):
        bodies = [body for body in range(1, model.nbody) if owner[body] == number]
        anchor = np.zeros(3) if number < 0 else anchors[number]
        parent = -1 if number < 0 else owner[int(model.body_parentid[model.jnt_bodyid[driven[number]]])]
        place = anchor if number < 0 or parent < 0 else anchor - anchors[parent]
        parts.append(
            _part(model, data, bodies, (middle + turn @ anchor, turn))
            | {
                "parent": parent,
                "origin": as_vector(place),
                "axis": as_vector(axes[number] if number >= 0 else (0, 0, 1)),
            }
            | ({} if number < 0 else _called(model, bodies, driven[number]))
        )
    return Anatomy(
        Part(**parts[0]),
        tuple(Part(**part) for part in parts[1:]),
        tuple(driven),
    )


def _called(model: mujoco.MjModel, bodies: Sequence[int], joint: int) -> dict[str, str]:
    """Return the names of a link and of its outermost body with a shape: the joint's where a body has none."""
    shaped = [body for body in bodies if model.body_geomnum[body]] or bodies
    outermost = max(shaped, key=lambda body: len(_ancestors(model, body)))
    own, tip = model.body(bodies[0]).name, model.body(outermost).name
    return {"name": own or model.joint(joint).name, "tip": tip or own or model.joint(joint).name}


def _named_base(model: mujoco.MjModel, name: str, owner: Mapping[int, int], origin: str) -> int:
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


def _at_zero(model: mujoco.MjModel) -> mujoco.MjData:
    """Return where everything is with the base at the origin and all joints at zero."""
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    for joint in np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)):
        data.qpos[model.jnt_qposadr[joint] + 3] = 1.0
    mujoco.mj_kinematics(model, data)
    return data


def as_vector(values: Sequence[float] | np.ndarray) -> Vector:
    """Return three numbers, those that are nothing but rounding as zero."""
    x, y, z = (0.0 if abs(value) < 1e-12 else float(value) for value in values)
    return x, y, z


def _part(
    model: mujoco.MjModel, data: mujoco.MjData, bodies: Sequence[int], frame: tuple[np.ndarray, np.ndarray]
) -> dict:
    """Return mass and shapes of bodies that are one, in a frame (its place, its orientation) of the world."""
    whole = merge([centred(model, data, body, frame) for body in bodies])
    geoms = [geom for geom in range(model.ngeom) if int(model.geom_bodyid[geom]) in set(bodies)]
    # Some files leave the bits to the program that loads them, and only the names say what is to touch.
    solid = [
        geom
        for geom in geoms
        if model.geom_contype[geom] or model.geom_conaffinity[geom] or "collision" in model.geom(geom).name
    ]
    shapes = {geom: _shape(model, data, geom, frame) for geom in geoms}
    return {
        "name": model.body(bodies[0]).name,
        "bodies": tuple(bodies),
        "mass": whole.mass,
        "com": as_vector(whole.com),
        "inertia": whole.inertia,
        "shapes": tuple(shape for shape in shapes.values() if shape is not None),
        "touched": tuple(shapes[geom] for geom in solid if shapes[geom] is not None),
        "geoms": tuple(geom for geom in solid if shapes[geom] is not None),
    }


def centred(
    model: mujoco.MjModel, data: mujoco.MjData, body: int, frame: tuple[np.ndarray, np.ndarray]
) -> tuple[Body, Frame]:
    """Return one body along its principal axes about its centre of mass, and where that is in a frame of the world."""
    place, turn = frame
    x, y, z = (float(moment) for moment in model.body_inertia[body])
    mass = Body(float(model.body_mass[body]), (0.0, 0.0, 0.0), (x, y, z, 0.0, 0.0, 0.0))
    return mass, (turn.T @ (data.xipos[body] - place), turn.T @ data.ximat[body].reshape(3, 3))


def _ancestors(model: mujoco.MjModel, body: int) -> list[int]:
    """Return the numbers of the bodies that carry one."""
    found: list[int] = []
    while body:
        body = int(model.body_parentid[body])
        found.append(body)
    return found


_PLAIN: dict[int, ShapeKind] = {
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
}


def _shape(model: mujoco.MjModel, data: mujoco.MjData, geom: int, frame: tuple[np.ndarray, np.ndarray]) -> Shape | None:
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

    The corners kept are those that reach furthest along directions spread evenly over the sphere; the hull shrinks by
    what lies between them, and never at the points that reach furthest down.
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
"""Directions in which the corners of a shape are looked for."""


def _directions() -> np.ndarray:
    """Return directions spread evenly over the sphere (Fibonacci's lattice), shape (DIRECTIONS, 3)."""
    count = DIRECTIONS
    height = 1.0 - 2.0 * (np.arange(count) + 0.5) / count
    angle = np.pi * (1.0 + 5.0**0.5) * np.arange(count)
    radius = np.sqrt(1.0 - height**2)
    return np.stack((radius * np.cos(angle), radius * np.sin(angle), height), -1)
