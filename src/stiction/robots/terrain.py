"""Ground of a fleet: flat, slopes, rough ground, stairs, with a course for each robot. NumPy only.

A course is centred on the origin of its robot's world. The robot starts before it on flat ground and crosses it: up, a
landing, down. Everything is made of boxes whose sizes belong to the model and whose places belong to the robot. Boxes
are as fast as a plane; a height field is slower by a multiple, and its risers lean. `stiction bench --ground` measures
it.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from stiction.core.rotation import UPRIGHT, about

KINDS = ("flat", "slope", "rough", "stairs")
"""Kinds of ground; a robot's kind is its number in here."""

TREAD = 0.30
"""Depth of a stair [m]."""

STEPS = 6
"""Stairs up, and down again: as many as a robot crosses in a quarter of a minute at 0.4 m/s."""

LANDING = 0.6
"""Half the length of the landing between up and down [m], for stairs without the highest treads, which are level with
it: longer than a trunk."""

WIDTH = 3.0
"""Half the width of a slope [m]. Stairs are square, and can be climbed from four sides."""

RAMP = TREAD * STEPS
"""Length of a slope along its surface [m]."""

SLABS = 24
"""Number of slabs of rough ground."""

STEEPEST = {"slope": 0.45, "rough": 0.15, "stairs": 0.20}
"""Values at difficulty 1: angle of the slope [rad], height of the highest slab [m], height of a step [m]."""

REACH = LANDING + TREAD * STEPS
"""Distance from the middle of a course to its foot [m]; for a slope, its length before it is tilted."""

CELL = 0.05
"""Cell of the table in which the heights of rough ground are looked up [m]; the slabs themselves are exact."""

_SLAB = (0.12, 0.35)
"""Range of the half sizes of slabs, seen from above [m]."""

_SPREAD = (REACH - 2**0.5 * _SLAB[1], REACH / 2)
"""Half the extent along x and y of the middles of slabs [m]: however turned, none is beyond the foot."""

_TABLE = (REACH, REACH / 2 + 0.5)
"""Half the extent of that table along x and y [m]."""

_THICK = 0.5
"""Half the thickness of every box [m]; only its top is used."""

_PARKED = -10.0
"""Height of a box that its robot does not use [m]."""


def half_sizes(kind: str) -> np.ndarray:
    """Return the half sizes of the boxes of one kind of course [m], shape (boxes, 3)."""
    if kind == "stairs":
        half = REACH - TREAD * np.arange(STEPS)
        return np.stack((half, half, np.full(STEPS, _THICK)), -1)
    if kind == "slope":
        return np.array([[RAMP / 2, WIDTH, _THICK], [LANDING, WIDTH, _THICK], [RAMP / 2, WIDTH, _THICK]])
    if kind == "rough":
        # Sizes are the same for every robot; where the slabs lie is not.
        size = np.random.default_rng(0).uniform(*_SLAB, (SLABS, 2))
        return np.hstack((size, np.full((SLABS, 1), _THICK)))
    return np.zeros((0, 3))


def step_height(kind: str, difficulty: np.ndarray) -> np.ndarray:
    """Return the size of a difficulty: step height [m], slope [rad], highest slab [m]; zero on flat ground."""
    return STEEPEST.get(kind, 0.0) * np.asarray(difficulty, float)


class Terrain:
    """Courses of N robots. `difficulty`, (N,), is set by `place`; robots of kind `flat` have none."""

    def __init__(self, kind: np.ndarray) -> None:
        """Start without courses. `kind`: number in `KINDS` of each robot's course, shape (N,)."""
        self.kind = np.asarray(kind, int)
        num = len(self.kind)
        self.used = tuple(name for number, name in enumerate(KINDS) if name != "flat" and (self.kind == number).any())
        sizes = [half_sizes(name) for name in self.used]
        self.boxes = np.concatenate([np.zeros((0, 3)), *sizes])
        ends = np.cumsum([0, *map(len, sizes)])
        self._columns = {name: slice(ends[i], ends[i + 1]) for i, name in enumerate(self.used)}
        self.difficulty = np.zeros(num)
        self.position = np.zeros((num, len(self.boxes), 3))
        self.quaternion = np.zeros((num, len(self.boxes), 4))
        self.position[..., 2], self.quaternion[..., 0] = _PARKED, 1.0
        cells = [len(np.arange(-half, half, CELL)) for half in _TABLE] if "rough" in self.used else [0, 0]
        self._table = np.zeros((num, *cells), np.float32)

    def place(self, ids: np.ndarray, difficulty: np.ndarray, uniform: np.ndarray) -> None:
        """Lay out new courses for the robots `ids`.

        difficulty: 0 to 1, shape (len(ids),); uniform: random numbers in [0, 1) for rough ground, shape
        (len(ids), SLABS, 4).
        """
        self.difficulty[ids] = difficulty
        for name in self.used:
            mine = self.kind[ids] == KINDS.index(name)
            rows, columns = ids[mine], self._columns[name]
            size = step_height(name, difficulty[mine])
            position, quaternion = _PLACERS[name](size, self.boxes[columns], uniform[mine])
            self.position[rows, columns], self.quaternion[rows, columns] = position, quaternion
            if name == "rough":
                self._tabulate(rows)

    def restore(self, difficulty: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Restore all courses; arguments as the attributes of the same names."""
        self.difficulty[:], self.position[:], self.quaternion[:] = difficulty, position, quaternion
        if "rough" in self.used:
            self._tabulate(np.flatnonzero(self.kind == KINDS.index("rough")))

    def height(self, points: np.ndarray) -> np.ndarray:
        """Return the height of the ground [m] at points of every robot's world, (N, P, 2) [m]; shape (N, P)."""
        ground = np.zeros(points.shape[:2])
        for name in self.used:
            rows = np.flatnonzero(self.kind == KINDS.index(name))
            size = step_height(name, self.difficulty[rows])[:, None]
            if name == "stairs":
                ground[rows] = stair_height(points[rows], size)
            elif name == "slope":
                ground[rows] = slope_height(points[rows], size)
            else:
                ground[rows] = self._look_up(rows, points[rows])
        return ground

    def _tabulate(self, rows: np.ndarray) -> None:
        """Write the heights of rough ground into its table, once per course: 24 slabs are too many for every step."""
        columns = self._columns["rough"]
        grid = np.stack(np.meshgrid(*(np.arange(-half, half, CELL) + CELL / 2 for half in _TABLE), indexing="ij"), -1)
        points = grid.reshape(1, -1, 2)
        for row in rows:
            slabs = self.position[[row], columns], self.quaternion[[row], columns]
            self._table[row] = slab_height(points, *slabs, self.boxes[columns]).reshape(grid.shape[:2])

    def _look_up(self, rows: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return heights of rough ground, (rows, P), at points (rows, P, 2); zero beyond the table."""
        cells = np.floor((points + np.array(_TABLE)) / CELL).astype(int)
        shape = np.array(self._table.shape[1:])
        inside = ((cells >= 0) & (cells < shape)).all(-1)
        cells = np.clip(cells, 0, shape - 1)
        return self._table[rows[:, None], cells[..., 0], cells[..., 1]] * inside


def stair_height(points: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return the height of square stairs with steps of `step` [m], (N, 1), at points (N, P, 2) [m]; shape (N, P)."""
    # A reduction over an axis of two entries is ten times slower than this.
    outward = np.maximum(np.abs(points[..., 0]), np.abs(points[..., 1]))
    return step * np.clip(np.floor((REACH - outward) / TREAD) + 1.0, 0.0, STEPS)


def slope_height(points: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return the height of a ridge across x with slopes of `angle` [rad], (N, 1), at points (N, P, 2) [m]."""
    down = np.clip(np.abs(points[..., 0]) - LANDING, 0.0, RAMP * np.cos(angle))
    return (RAMP * np.sin(angle) - down * np.tan(angle)) * (np.abs(points[..., 1]) <= WIDTH)


def slab_height(points: np.ndarray, position: np.ndarray, quaternion: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Return the height of level slabs at points (N, P, 2); their places (N, S, 3), yaw (N, S, 4), sizes (S, 3)."""
    offset = points[:, :, None] - position[:, None, :, :2]
    # Of a rotation about z alone, (w, 0, 0, z).
    cosine = 1.0 - 2.0 * quaternion[:, None, :, 3] ** 2
    sine = 2.0 * quaternion[:, None, :, 0] * quaternion[:, None, :, 3]
    along = np.abs(cosine * offset[..., 0] + sine * offset[..., 1])
    across = np.abs(cosine * offset[..., 1] - sine * offset[..., 0])
    top = position[:, None, :, 2] + half[:, 2]
    return np.where((along <= half[:, 0]) & (across <= half[:, 1]), top, 0.0).max(-1)


def _upright(shape: tuple[int, ...]) -> np.ndarray:
    """Return quaternions without rotation."""
    return np.broadcast_to(UPRIGHT, (*shape, 4)).copy()


def _place_stairs(step: np.ndarray, half: np.ndarray, uniform: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stack the squares: the k-th ends at (k + 1) steps."""
    position = np.zeros((len(step), STEPS, 3))
    position[..., 2] = step[:, None] * np.arange(1, STEPS + 1) - _THICK
    return position, _upright(position.shape[:2])


def _place_slope(angle: np.ndarray, half: np.ndarray, uniform: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tilt one box up and one down about y, and put the landing between them."""
    position, quaternion = np.zeros((len(angle), 3, 3)), _upright((len(angle), 3))
    top = RAMP * np.sin(angle)
    position[:, 1, 2] = top - _THICK
    for box, side in ((0, -1.0), (2, 1.0)):
        # A box is placed by its middle, which lies half its thickness under the slope, along the slope's normal.
        position[:, box, 0] = side * (LANDING + RAMP / 2 * np.cos(angle) - _THICK * np.sin(angle))
        position[:, box, 2] = top / 2 - _THICK * np.cos(angle)
        quaternion[:, box] = about(1, side * angle)
    return position, quaternion


def _place_slabs(highest: np.ndarray, half: np.ndarray, uniform: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Scatter slabs over the course, each at a random angle and of a random height up to `highest`."""
    position, quaternion = np.zeros((len(highest), SLABS, 3)), about(2, np.pi * uniform[..., 3])
    position[..., :2] = np.array(_SPREAD) * (2.0 * uniform[..., :2] - 1.0)
    position[..., 2] = highest[:, None] * uniform[..., 2] - _THICK
    return position, quaternion


_PLACERS = {"stairs": _place_stairs, "slope": _place_slope, "rough": _place_slabs}


def assign(shares: Iterable[float], num: int) -> np.ndarray:
    """Return the kind of each of `num` robots, in runs whose lengths are the shares of `KINDS`, shape (num,)."""
    share = np.array(list(shares))
    # Ends are rounded, and not lengths, which need not add up to all robots.
    ends = np.round(np.cumsum(share / share.sum()) * num).astype(int)
    return np.searchsorted(ends, np.arange(num), side="right")
