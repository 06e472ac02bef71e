"""The ground of one robot: heights by hand, and the courses of the training."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.core.rotation import about
from stiction.engines.ground import Ground, box_top, course
from stiction.robots.terrain import CELL, KINDS, SLABS, STEEPEST, Terrain

HALF, PLACE, TURN = np.array([[0.1, 0.1, 0.1]]), np.array([[0.5, 0.5, 0.25]]), np.array([[1.0, 0.0, 0.0, 0.0]])
"""A box of 0.2 m."""


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


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: course("stairs", 0.5), "stairs up to 0.2"),
        (lambda: course("ice", 0.1), "expected flat"),
        (lambda: Ground(HALF[0], PLACE, TURN), "shapes"),
        (lambda: Ground(HALF, np.zeros((2, 3)), TURN), "shapes"),
        (lambda: Ground(-HALF, PLACE, TURN), "positive half sizes"),
        (lambda: Ground(HALF, PLACE, 2.0 * TURN), "length 1"),
    ],
)
def test_ground_that_cannot_be_is_refused(make, message: str) -> None:
    """An engine would make of it what it likes."""
    with pytest.raises(StictionError, match=message):
        make()
