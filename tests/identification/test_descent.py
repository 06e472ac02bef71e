"""The least-squares search, on problems whose answers are known."""

from __future__ import annotations

import numpy as np

from stiction.identification.output_error import MAX_REJECTED_STEPS, levenberg_marquardt

FREE = np.full(2, np.inf)
TINY = 1e-18


def test_it_follows_a_curved_valley() -> None:
    """Rosenbrock's function from its usual start: (1, 1), which plain Gauss-Newton steps overshoot."""
    found = levenberg_marquardt(
        lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]),
        lambda x: np.array([[-20 * x[0], 10.0], [-1.0, 0.0]]),
        np.array([-1.2, 1.0]),
        -FREE,
        FREE,
        lambda cost: TINY,
    )
    np.testing.assert_allclose(found, 1.0, atol=1e-6)


def test_it_stops_at_a_bound_and_goes_on_along_it() -> None:
    """Least of (x − 1)² + (x + y − 3)² with x ≥ 2: at the bound, where y is 1."""
    slopes = np.array([[1.0, 0.0], [1.0, 1.0]])
    found = levenberg_marquardt(
        lambda x: np.array([x[0] - 1, x[0] + x[1] - 3]),
        lambda x: slopes,
        np.array([5.0, 5.0]),
        np.array([2.0, -np.inf]),
        FREE,
        lambda cost: TINY,
    )
    np.testing.assert_allclose(found, [2.0, 1.0], atol=1e-6)


def test_what_does_not_matter_stays_where_it_was() -> None:
    """Only x + y is known: the search must not wander off along x − y, however small rounding makes its curvature."""
    found = levenberg_marquardt(
        lambda x: np.array([x[0] + x[1] - 3, 2 * (x[0] + x[1] - 3)]),
        lambda x: np.array([[1.0, 1.0], [2.0, 2.0]]),
        np.array([5.0, 4.0]),
        -FREE,
        FREE,
        lambda cost: TINY,
    )
    np.testing.assert_allclose(found, [2.0, 1.0], atol=1e-6)


def test_it_ends_on_a_corner_instead_of_searching_it() -> None:
    """The kink of |x| promises a fall on both sides that never comes: a handful of trials, not all that are allowed."""
    tried = []

    def size(x: np.ndarray) -> float:
        return float(np.sqrt(1 + 10 * abs(x[0] - 0.3)))

    def rows(x: np.ndarray) -> np.ndarray:
        tried.append(x[0])
        return np.array([size(x)])

    def slopes(x: np.ndarray) -> np.ndarray:
        return np.array([[(5.0 if x[0] >= 0.3 else -5.0) / size(x)]])

    found = levenberg_marquardt(rows, slopes, np.array([0.3]), -FREE[:1], FREE[:1], lambda cost: TINY)
    assert found[0] == 0.3 and len(tried) == MAX_REJECTED_STEPS + 2
