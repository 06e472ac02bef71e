"""The ground of one robot: heights by hand, the courses of the training, and the same surface in MuJoCo."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.core.rotation import about
from stiction.engines.ground import Ground, HeightField, box_top, course, sampled
from stiction.engines.mujoco_engine import add_field
from stiction.robots.terrain import CELL, KINDS, SLABS, STEEPEST, Terrain

HALF, PLACE, TURN = np.array([[0.1, 0.1, 0.1]]), np.array([[0.5, 0.5, 0.25]]), np.array([[1.0, 0.0, 0.0, 0.0]])
"""A box of 0.2 m."""


def test_heights_of_a_field_by_hand() -> None:
    """One cell of 2 m, 1 m high at one side, is cut from lower left to upper right: a slope below, another above."""
    field = HeightField(np.array([[0.0, 0.0], [1.0, 0.5]]), 2.0, (1.0, 1.0))
    points = np.array([[1.0, 1.0], [2.0, 2.0], [3.0, 2.0], [1.0, 2.0], [2.0, 3.0], [2.5, 1.5], [0.9, 2.0], [3.1, 2.0]])
    np.testing.assert_allclose(field.height(points), [0.0, 0.25, 0.25, 0.5, 0.75, 0.125, 0.0, 0.0], atol=1e-12)


def test_triangles_look_up_and_are_the_surface() -> None:
    """PhysX and ODE take triangles: one that looked down would let a foot through."""
    field = HeightField(np.random.default_rng(0).uniform(0.0, 0.3, (4, 5)), 0.2, (-0.3, 0.1))
    vertices, faces = field.triangles()
    corners = vertices[faces]
    assert vertices.shape == (20, 3) and faces.shape == (24, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    np.testing.assert_allclose(normals[:, 2], 0.04)
    middles = corners.mean(axis=1)
    np.testing.assert_allclose(field.height(middles[:, :2]), middles[:, 2])


def test_mujoco_touches_the_same_field() -> None:
    """A small ball just above the surface touches it, and just so: were cells cut the other way, it would not."""
    field, radius = HeightField(np.random.default_rng(0).uniform(0.0, 0.1, (6, 5)), 0.2, (1.0, -0.5)), 1e-3
    spec = mujoco.MjSpec()
    add_field(spec, field)
    ball = spec.worldbody.add_body()
    ball.add_freejoint()
    ball.add_geom(size=[radius, 0.0, 0.0])
    model = spec.compile()
    data = mujoco.MjData(model)
    points = np.random.default_rng(1).uniform((1.01, -0.49), (1.79, 0.49), (200, 2))
    for point, height in zip(points, field.height(points), strict=True):
        data.qpos[:3] = *point, height + 0.5 * radius
        mujoco.mj_forward(model, data)
        assert data.ncon and -radius < data.contact.dist.min() < 0.0


def test_a_box_from_above_by_hand() -> None:
    """A cube of 2 m turned by 45 degrees about y stands on an edge: its top is the root of two above its middle."""
    half, middle, turn = np.ones(3), np.array([5.0, 0.0, 0.0]), about(1, np.pi / 4)
    points = np.array([[5.0, 0.0], [5.5, 0.99], [5.0 + 2**0.5 - 1e-9, 0.0], [5.0, 1.01], [3.5, 0.0]])
    wanted = [2**0.5, 2**0.5 - 0.5, 0.0, -np.inf, -np.inf]
    np.testing.assert_allclose(box_top(points, half, middle, turn), wanted, atol=1e-8)


@pytest.mark.parametrize(("kind", "size"), [("stairs", 0.1), ("slope", 0.3), ("rough", 0.1)])
def test_a_course_is_that_of_the_training(kind: str, size: float) -> None:
    """A policy trained on stairs would be tried on others."""
    terrain = Terrain(np.array([KINDS.index(kind)]))
    uniform = np.random.default_rng(3).uniform(size=(1, SLABS, 4))
    terrain.place(np.array([0]), np.array([size / STEEPEST[kind]]), uniform)
    points = np.random.default_rng(0).uniform(-3.0, 3.0, (2000, 2))
    if kind == "rough":
        # The training looks rough ground up in a table of cells, which is exact in their middles.
        points = CELL * (np.round(points / CELL) + 0.5)
    np.testing.assert_allclose(course(kind, size, seed=3).height(points), terrain.height(points[None])[0], atol=1e-9)


def test_a_sampled_course_has_the_same_heights_at_its_corners() -> None:
    """Stairs as a height field: 0.6 m high on the landing, 0.5 m on the step before it, zero in front."""
    stairs = course("stairs", 0.1)
    field = sampled(stairs, (3.0, 1.0), 0.05)
    assert field.field is not None and field.field.heights.shape == (41, 121) and not len(field.half_sizes)
    corners = np.array([[-3.0, -1.0], [0.0, 0.0], [-1.0, 0.5], [2.95, 1.0]])
    np.testing.assert_allclose(field.height(corners), stairs.height(corners))
    np.testing.assert_allclose(field.height(corners), [0.0, 0.6, 0.5, 0.0])


def test_nothing_lies_on_flat_ground() -> None:
    """Flat ground is a course too."""
    assert course("flat", 0.0).height(np.array([[0.0, 0.0], [3.0, 1.0]])).tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: course("stairs", 0.5), "stairs up to 0.2"),
        (lambda: course("ice", 0.1), "expected flat"),
        (lambda: HeightField(np.zeros(3), 0.1, (0.0, 0.0)), "two rows"),
        (lambda: HeightField(np.zeros((2, 2)), 0.0, (0.0, 0.0)), "positive cell"),
        (lambda: HeightField(np.zeros((2, 2)), np.inf, (0.0, 0.0)), "positive cell"),
        (lambda: HeightField(np.zeros((2, 2)), 0.1, (np.nan, 0.0)), "a place"),
        (lambda: HeightField(np.full((2, 2), np.nan), 0.1, (0.0, 0.0)), "finite"),
        (lambda: HeightField(np.full((2, 2), -0.1), 0.1, (0.0, 0.0)), "down to -0.1"),
        (lambda: Ground(HALF[0], PLACE, TURN), "shapes"),
        (lambda: Ground(HALF, np.zeros((2, 3)), TURN), "shapes"),
        (lambda: Ground(HALF, PLACE, TURN[:, :3]), "shapes"),
        (lambda: Ground(-HALF, PLACE, TURN), "positive half sizes"),
        (lambda: Ground(HALF * [1.0, 0.0, 1.0], PLACE, TURN), "positive half sizes"),
        (lambda: Ground(HALF * np.inf, PLACE, TURN), "positive half sizes"),
        (lambda: Ground(HALF, PLACE + np.nan, TURN), "a place"),
        (lambda: Ground(HALF, PLACE, 2.0 * TURN), "length 1"),
        (lambda: Ground(HALF, PLACE, TURN + np.nan), "length 1"),
    ],
)
def test_ground_that_cannot_be_is_refused(make, message: str) -> None:
    """An engine would make of it what it likes."""
    with pytest.raises(StictionError, match=message):
        make()


def test_boxes_count_where_they_overlap_a_field() -> None:
    """The robot walks on whatever is higher."""
    field = HeightField(np.full((2, 2), 0.2), 2.0, (-1.0, -1.0))
    box = Ground(HALF, PLACE, TURN, field)
    np.testing.assert_allclose(box.height(np.array([[0.5, 0.5], [0.0, 0.0], [2.0, 2.0]])), [0.35, 0.2, 0.0])
