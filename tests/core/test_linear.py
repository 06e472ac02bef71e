"""Normal equations that leave unknowns open."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.core.linear import check_condition, invert


def test_an_inverse_in_any_units() -> None:
    """Columns whose sizes differ by 1e9 are well told apart, and the inverse is the one by hand."""
    scale = np.diag([1.0, 1e-9])
    inverse, told = invert(scale @ np.array([[2.0, 1.0], [1.0, 2.0]]) @ scale)
    assert told.all()
    np.testing.assert_allclose(scale @ inverse @ scale, np.array([[2.0, -1.0], [-1.0, 2.0]]) / 3)


def test_an_empty_column_costs_the_others_nothing() -> None:
    """A column of zeros tells nothing of its unknown, and all of the two beside it."""
    inverse, told = invert(np.array([[2.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 2.0]]))
    assert told.tolist() == [True, False, True]
    np.testing.assert_allclose(inverse[np.ix_(told, told)], np.array([[2.0, -1.0], [-1.0, 2.0]]) / 3)
    assert not inverse[1].any() and not inverse[:, 1].any()


def test_two_alike_columns_are_both_open() -> None:
    """Leaves two equal columns open, whose sum alone is determined, and determines a third, orthogonal one."""
    columns = np.array([[1.0, 1.0, 0.0], [2.0, 2.0, 0.0], [0.0, 0.0, 3.0]])
    inverse, told = invert(columns.T @ columns)
    assert told.tolist() == [False, False, True] and inverse[2, 2] == pytest.approx(1 / 9)


def test_one_singular_matrix_of_a_stack_is_refused() -> None:
    """LAPACK solves a matrix that is singular but for rounding, and returns numbers of 1e15."""
    good, nearly = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([[1.0, 1.0], [1.0, 1.0 + 1e-15]])
    check_condition(np.stack([good, 1e9 * good]))
    for bad in (nearly, np.zeros((2, 2)), np.full((2, 2), np.nan)):
        with pytest.raises(np.linalg.LinAlgError):
            check_condition(np.stack([good, bad]))
