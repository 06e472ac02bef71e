"""Ground of one robot as data that every engine can build: a plane, and boxes on it.

Boxes are exact in every engine, and the courses of the training are made of them (`stiction.robots.terrain`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.core.rotation import matrix
from stiction.robots.terrain import KINDS, SLABS, STEEPEST, Terrain


@dataclass(frozen=True)
class Ground:
    """The plane z = 0 with B boxes on it."""

    half_sizes: np.ndarray
    """Half the extent of the boxes along their axes [m], shape (B, 3)."""
    positions: np.ndarray
    """Middles of the boxes [m], shape (B, 3)."""
    quaternions: np.ndarray
    """Orientations of the boxes, w x y z, shape (B, 4)."""

    def __post_init__(self) -> None:
        """Reject boxes without size, position or orientation, so that no engine needs to."""
        shapes = np.shape(self.half_sizes), np.shape(self.positions), np.shape(self.quaternions)
        count = shapes[0][0] if shapes[0] else 0
        if shapes != ((count, 3), (count, 3), (count, 4)):
            raise ConfigurationError(
                f"boxes with half sizes, places and quaternions of shapes {shapes}; expected (B, 3), (B, 3) and (B, 4) "
                "for B boxes"
            )
        for half, place, turn in zip(self.half_sizes, self.positions, self.quaternions, strict=True):
            sized = np.isfinite(half).all() and np.min(half) > 0
            if not (sized and np.isfinite(place).all() and abs(np.linalg.norm(turn) - 1.0) < 1e-6):
                raise ConfigurationError(
                    f"box of half sizes {half} m at {place} m, turned by {turn}; expected positive half sizes, a "
                    "place, and a quaternion of length 1"
                )

    def height(self, points: np.ndarray) -> np.ndarray:
        """Return the height of the ground [m], shape (P,), at points (P, 2) [m]."""
        points = np.asarray(points, float)
        top = np.zeros(len(points))
        for half, position, quaternion in zip(self.half_sizes, self.positions, self.quaternions, strict=True):
            top = np.maximum(top, box_top(points, half, position, quaternion))
        return top


def flat() -> Ground:
    """Return the bare plane."""
    return Ground(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 4)))


def course(kind: str, size: float, seed: int = 0) -> Ground:
    """Return a course of the training, about the origin, to be crossed along x.

    kind: `stairs`, `slope`, `rough`, or `flat`; size: height of a step [m], angle of the slope [rad], height of the
    highest slab [m]; seed: places of the slabs.

    Raises `StictionError`: the kind is unknown, or the size is out of range.
    """
    if kind == "flat":
        return flat()
    if kind not in STEEPEST or not 0 <= size <= STEEPEST[kind]:
        limits = ", ".join(f"{name} up to {limit:g}" for name, limit in STEEPEST.items())
        raise ConfigurationError(f"course {kind!r} of size {size:g}: expected flat, {limits} (m, of a slope rad)")
    terrain = Terrain(np.array([KINDS.index(kind)]))
    uniform = np.random.default_rng(seed).uniform(size=(1, SLABS, 4))
    terrain.place(np.array([0]), np.array([size / STEEPEST[kind]]), uniform)
    return Ground(terrain.boxes, terrain.position[0], terrain.quaternion[0])


def box_top(points: np.ndarray, half: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Return the height of a box's top over points (P, 2) [m], shape (P,); minus infinity outside it."""
    # A vertical line is inside a box where it is between its three pairs of planes.
    axes = matrix(quaternion).T
    start = (np.column_stack((points, np.zeros(len(points)))) - position) @ axes.T
    slope = axes[:, 2]
    highest, lowest = np.full(len(points), np.inf), np.full(len(points), -np.inf)
    for along, rise, extent in zip(start.T, slope, half, strict=True):
        # Upright planes bound no height: beside them there is none.
        if abs(rise) < 1e-12:
            highest = np.where(np.abs(along) <= extent, highest, -np.inf)
            continue
        ends = np.sort(np.stack(((-extent - along) / rise, (extent - along) / rise)), axis=0)
        lowest, highest = np.maximum(lowest, ends[0]), np.minimum(highest, ends[1])
    return np.where(lowest <= highest, highest, -np.inf)
