"""Least squares by Levenberg and Marquardt's method, made for residuals that have a corner here and there.

Stick and slip leave corners in the cost that no step size resolves. A search that asks the cost itself whether it still
falls spends most of its time on them; this one stops where its linear model promises nothing more that matters.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

MOST_TRIALS = 40
"""Points tried before the search ends where it is."""

MOST_REFUSALS = 5
"""Steps in a row, each shorter than the last, that make the cost larger: a corner, and the search ends on it."""

FAINTEST = 1e-12
"""Curvature, over the largest one in units of the diagonal, under which a direction is left alone."""


def descend(
    residual: Callable[[np.ndarray], np.ndarray],
    jacobian: Callable[[np.ndarray], np.ndarray],
    start: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    enough: Callable[[float], float],
) -> np.ndarray:
    """Return the point, shape (num_parameters,), at which half the sum of squares is least.

    residual: point -> shape (num_rows,); jacobian: point -> shape (num_rows, num_parameters); lower, upper: bounds,
    shape (num_parameters,) each; enough: cost -> promised fall of the cost that is not worth another step.
    """
    point = np.clip(start, lower, upper)
    rows, slopes = residual(point), jacobian(point)
    cost, damping, growth, refused = 0.5 * float(rows @ rows), 1e-4, 2.0, 0
    for _ in range(MOST_TRIALS):
        step, promised = _step(slopes, rows, (point >= upper).astype(int) - (point <= lower), damping)
        if promised <= enough(cost) or refused > MOST_REFUSALS:
            break
        trial = np.clip(point + step, lower, upper)
        tried = residual(trial)
        found = 0.5 * float(tried @ tried)
        if found < cost:
            # The better the model foretold the cost, the less the next step is held back (Nielsen's rule).
            damping *= max(0.1, 1.0 - (2.0 * (cost - found) / promised - 1.0) ** 3)
            point, rows, cost, slopes = trial, tried, found, jacobian(trial)
            growth, refused = 2.0, 0
        else:
            damping, growth, refused = max(growth * damping, 1e-4), 2.0 * growth, refused + 1
    return point


def _step(slopes: np.ndarray, rows: np.ndarray, bound: np.ndarray, damping: float) -> tuple[np.ndarray, float]:
    """Return the damped step from a point, and the fall of the cost that the linear model promises for it.

    bound: -1 for parameters at their lower bound and 1 for those at their upper one, else 0, shape (num_parameters,);
    from a bound they move away only.
    """
    gradient, curvature = slopes.T @ rows, slopes.T @ slopes
    scale = np.sqrt(np.diag(curvature))
    moving = (scale > 0) & (bound * gradient >= 0)
    step = np.zeros(len(gradient))
    if not moving.any():
        return step, 0.0
    units = scale[moving]
    values, directions = np.linalg.eigh(curvature[np.ix_(moving, moving)] / np.outer(units, units))
    seen = values > FAINTEST * values[-1]
    wanted = np.where(seen, directions.T @ (gradient[moving] / units), 0.0)
    moved = wanted / np.where(seen, values + damping, 1.0)
    step[moving] = -(directions @ moved) / units
    return step, float(np.sum(moved * wanted - 0.5 * np.where(seen, values, 0.0) * moved**2))
