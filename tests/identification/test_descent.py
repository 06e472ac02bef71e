"""The least-squares search, on problems whose answers are known."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.identification.output_error import levenberg_marquardt

FREE = np.full(2, np.inf)
TINY = 1e-18


@pytest.mark.parametrize(
    ("rows", "slopes", "start", "lower", "expected"),
    [
        # Rosenbrock's function from its usual start, which plain Gauss-Newton steps overshoot.
        (lambda x: [10 * x[1] - 10 * x[0] ** 2, 1 - x[0]], lambda x: [[-20 * x[0], 10], [-1, 0]], (-1.2, 1), -FREE, 1),
        # Least of (x − 1)² + (x + y − 3)² with x ≥ 2: at the bound, where y is 1.
        (lambda x: [x[0] - 1, x[0] + x[1] - 3], lambda x: [[1, 0], [1, 1]], [5, 5], np.array([2, -np.inf]), [2, 1]),
        # Only x + y is known: no wandering off along x − y, however small rounding makes its curvature.
        (lambda x: [x.sum() - 3, 2 * (x.sum() - 3)], lambda x: [[1, 1], [2, 2]], [5, 4], -FREE, [2, 1]),
    ],
    ids=["curved valley", "bound", "valley without an end"],
)
def test_the_least_is_found(rows, slopes, start: list[float], lower: np.ndarray, expected: list[float]) -> None:
    """The search follows a curved valley, continues along a bound, and leaves irrelevant parameters unchanged."""
    residuals, jacobian = (lambda x: np.array(rows(x), float)), (lambda x: np.array(slopes(x), float))
    solution = levenberg_marquardt(residuals, jacobian, np.array(start, float), lower, FREE, lambda cost: TINY)
    np.testing.assert_allclose(solution, expected, atol=1e-6)
