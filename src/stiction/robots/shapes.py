"""Contact and visual shapes of a robot: spheres, capsules, cylinders, boxes and convex hulls, as data. NumPy alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from stiction.core.rotation import matrix

Vector = tuple[float, float, float]


def vector(values: np.ndarray) -> Vector:
    """Return three numbers of an array, shape (3,)."""
    x, y, z = values.tolist()
    return x, y, z


ShapeKind = Literal["sphere", "capsule", "cylinder", "box", "hull"]

Contact = Literal["ground", "obstacles", "nothing"]
"""Contacts of a shape: ground and obstacles, obstacles alone, or nothing (visual only)."""


@dataclass(frozen=True)
class Shape:
    """Contact or visual shape of a link, in the link's frame."""

    kind: ShapeKind
    """A `hull` is the convex hull of `vertices`."""
    size: Vector
    """Sphere: radius; capsule, cylinder: radius and half length along the shape's z; box: half extents [m]."""
    position: Vector = (0.0, 0.0, 0.0)
    """Middle of the shape [m]."""
    quaternion: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    """Orientation: w, x, y, z."""
    contact: Contact = "nothing"
    color: Vector | None = None
    """Red, green, blue in [0, 1]."""
    vertices: tuple[Vector, ...] = ()
    """Corners of a hull [m], in the shape's frame."""

    @property
    def rotation(self) -> np.ndarray:
        """Columns are the shape's axes in the link's frame, shape (3, 3)."""
        return matrix(np.array(self.quaternion))


def reach(shape: Shape, direction: np.ndarray) -> float:
    """Return the reach of a shape along a direction from the link's origin [m]: its support function.

    direction: of unit length, in the link's frame, shape (3,).
    """
    x, y, z = direction @ shape.rotation
    a, b, c = shape.size
    if shape.kind == "sphere":
        distance = a
    elif shape.kind == "capsule":
        distance = a + b * abs(z)
    elif shape.kind == "cylinder":
        distance = a * np.hypot(x, y) + b * abs(z)
    elif shape.kind == "box":
        distance = a * abs(x) + b * abs(y) + c * abs(z)
    else:
        distance = (np.array(shape.vertices) @ np.array([x, y, z])).max()
    return float(direction @ np.array(shape.position) + distance)


def bounds(shapes: Sequence[Shape], rotation: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of the smallest upright box around shapes of one link [m], low and high, shape (3,) each.

    rotation: of the link against the frame in which the box is upright, shape (3, 3); None: the link's own frame.
    """
    axes = np.eye(3) if rotation is None else rotation
    high = np.array([max(reach(shape, axis) for shape in shapes) for axis in axes])
    low = np.array([-max(reach(shape, -axis) for shape in shapes) for axis in axes])
    return low, high
