"""The ground of one robot as data that every engine can build: a plane, boxes on it, a height field on it.

Boxes are exact in every engine, and the courses of the training are made of them (`stiction.robots.terrain`). MuJoCo
takes a height field as it is, PhysX and ODE take its triangles, which are the same surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.core.rotation import matrix
from stiction.robots.terrain import KINDS, SLABS, STEEPEST, Terrain


@dataclass(frozen=True)
class HeightField:
    """Heights over a grid of square cells, each cut into two triangles; beyond the grid there is the plane."""

    heights: np.ndarray
    """[m], at least 0, shape (rows, columns): rows go along y, columns along x."""
    cell: float
    """Side of a cell [m]."""
    corner: tuple[float, float]
    """Position of the first height, x and y [m]."""

    def __post_init__(self) -> None:
        """Refuse a malformed grid."""
        heights = np.asarray(self.heights)
        grid = heights.ndim == 2 and min(heights.shape) >= 2 and np.isfinite(heights).all()
        if not (grid and 0 < self.cell < np.inf and np.shape(self.corner) == (2,) and np.isfinite(self.corner).all()):
            raise ConfigurationError(
                f"height field of shape {heights.shape} from {self.corner} m on with cells of {self.cell} m: expected "
                "at least two rows and two columns of finite heights, a place, and a positive cell"
            )
        if heights.min() < 0:
            raise ConfigurationError(
                f"height field down to {heights.min():g} m: expected heights of at least 0, the plane's"
            )

    def triangles(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the surface: vertices [m], shape (V, 3), and triangles, numbers of vertices, shape (F, 3).

        Triangles are counterclockwise from above. A cell is cut from lower left to upper right, as MuJoCo does.
        """
        rows, columns = np.shape(self.heights)
        along, across = np.meshgrid(np.arange(columns), np.arange(rows))
        x, y = self.corner[0] + self.cell * along, self.corner[1] + self.cell * across
        vertices = np.stack((x, y, self.heights), -1).reshape(-1, 3)
        first = (columns * across + along)[:-1, :-1].ravel()
        right, up, far = first + 1, first + columns, first + columns + 1
        faces = np.concatenate((np.stack((first, right, far), -1), np.stack((first, far, up), -1)))
        return vertices, faces

    def height(self, points: np.ndarray) -> np.ndarray:
        """Return the height of the triangles [m], shape (P,), at points (P, 2) [m]; zero beyond the grid."""
        rows, columns = np.shape(self.heights)
        place = (np.asarray(points, float) - self.corner) / self.cell
        inside = ((place >= 0) & (place <= (columns - 1, rows - 1))).all(-1)
        column, row = np.clip(np.floor(place).astype(int), 0, (columns - 2, rows - 2)).T
        right, up = (place - np.stack((column, row), -1)).T
        low, high = self.heights[row, column], self.heights[row + 1, column + 1]
        beside, above = self.heights[row, column + 1], self.heights[row + 1, column]
        lower = low + right * (beside - low) + up * (high - beside)
        upper = low + up * (above - low) + right * (high - above)
        return np.where(inside, np.where(right >= up, lower, upper), 0.0)


@dataclass(frozen=True)
class Ground:
    """The plane z = 0 with B boxes on it."""

    half_sizes: np.ndarray
    """Half the extent of the boxes along their own axes [m], shape (B, 3)."""
    positions: np.ndarray
    """Their middles [m], shape (B, 3)."""
    quaternions: np.ndarray
    """Their orientations, w x y z, shape (B, 4)."""
    field: HeightField | None = None
    """A height field."""

    def __post_init__(self) -> None:
        """Refuse boxes without size, position or orientation, so that no engine needs to."""
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
        return top if self.field is None else np.maximum(top, self.field.height(points))


def flat(field: HeightField | None = None) -> Ground:
    """Return the plane, with nothing on it but perhaps a height field."""
    return Ground(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 4)), field)


def course(kind: str, size: float, seed: int = 0) -> Ground:
    """Return a course of the training, about the origin, to be crossed along x.

    kind: `stairs`, `slope`, `rough`, or `flat`; size: height of a step [m], angle of the slope [rad], height of the
    highest slab [m]; seed: places of the slabs.

    Raises `StictionError`: there is no such kind, or it is not made that steep.
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


def sampled(ground: Ground, half: tuple[float, float], cell: float) -> Ground:
    """Return a ground as a height field, sampled at the corners of cells over ±`half` along x and y [m]."""
    x, y = (np.arange(-round(extent / cell), round(extent / cell) + 1) * cell for extent in half)
    points = np.stack(np.meshgrid(x, y), -1)
    heights = ground.height(points.reshape(-1, 2)).reshape(points.shape[:2])
    return flat(HeightField(heights, cell, (float(x[0]), float(y[0]))))


def box_top(points: np.ndarray, half: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Return the height of a box's top over points (P, 2) [m], shape (P,); minus infinity beside it."""
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
