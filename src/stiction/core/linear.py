"""Normal equations with unknowns that they do not determine: the determined ones, and their inverse."""

from __future__ import annotations

import numpy as np

LARGEST_CONDITION = 1e12
"""Condition number, with ones on the diagonal, above which rounding dominates the inverse."""

SMALLEST_DIAGONAL = 1e-200
"""Sum of squares of a column below which the squares of its inverse overflow: the column counts as empty."""

MIN_SHARE = 1e-3
"""Minimum share of an unknown in an undetermined direction for the unknown to count as undetermined."""


def invert(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the inverse of the normal equations of P unknowns, and a mask of the determined ones.

    matrix: A = ZᵀW, shape (P, P). The inverse, shape (P, P), is that of the largest invertible part of A, with zeros
    elsewhere. Mask, bool, shape (P,): False for every unknown with a share in an undetermined direction of A, and for
    all where A is not finite.
    """
    determined = np.full(len(matrix), bool(np.isfinite(matrix).all()))
    # With ones on the diagonal, or units would decide what counts as singular.
    scale = np.sqrt(np.abs(np.diag(matrix)))
    determined &= np.abs(np.diag(matrix)) > SMALLEST_DIAGONAL
    remaining = np.flatnonzero(determined)
    while len(remaining):
        unit = matrix[np.ix_(remaining, remaining)] / np.outer(scale[remaining], scale[remaining])
        _, sizes, directions = np.linalg.svd(unit)
        if sizes[-1] * LARGEST_CONDITION > sizes[0]:
            break
        # Of the unknowns in the open direction the one with the largest part goes, and the others are looked at again.
        parts = np.abs(directions[-1])
        determined[remaining[parts > MIN_SHARE]] = False
        remaining = np.delete(remaining, np.argmax(parts))
    inverse = np.zeros(matrix.shape)
    if len(remaining):
        inverse[np.ix_(remaining, remaining)] = np.linalg.inv(unit) / np.outer(scale[remaining], scale[remaining])
    return inverse, determined


def check_condition(matrices: np.ndarray) -> None:
    """Raise `numpy.linalg.LinAlgError` where a matrix, or one of a stack, shape (..., P, P), is near singular."""
    scale = np.sqrt(np.abs(np.diagonal(matrices, axis1=-2, axis2=-1))).clip(1e-300)
    if not (np.linalg.cond(matrices / scale[..., :, None] / scale[..., None, :]) < LARGEST_CONDITION).all():
        raise np.linalg.LinAlgError("the equations do not determine all unknowns")
