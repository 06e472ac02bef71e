"""The linear probe: ridge, its penalty, R² and intervals against numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_experiments.adaptation.probes import PENALTIES, determination, fit_ridge

HALF = np.array([0.5])


def test_one_feature_by_hand() -> None:
    """X = ±1, y = 3 ± 2: without penalty the slope is 2, with a penalty of 1 it is half of it, and 3 is untouched."""
    x, y = np.array([[1.0], [-1.0]] * 10), np.array([[5.0], [1.0]] * 10)
    robot = np.arange(20) // 2
    none, one = fit_ridge(x, y, robot, (1e-12,)), fit_ridge(x, y, robot, (1.0,))
    assert none.weights == pytest.approx(np.array([[2.0]]))
    assert one.weights == pytest.approx(np.array([[1.0]]))
    assert one.predict(np.array([[0.0], [3.0]])) == pytest.approx(np.array([[3.0], [6.0]]))


def test_the_penalty_is_chosen_on_robots_that_were_left_out() -> None:
    """Each robot repeats one noisy row ten times: with folds by row the copies would ask for no penalty at all."""
    generator = np.random.default_rng(0)
    features, noise = generator.standard_normal((40, 60)), generator.standard_normal((40, 1))
    robot = np.repeat(np.arange(40), 10)
    by_robot = fit_ridge(features[robot], noise[robot], robot)
    by_row = fit_ridge(features[robot], noise[robot], np.arange(400))
    assert by_robot.penalty == max(PENALTIES)
    assert by_row.penalty == min(PENALTIES)


def test_determination_by_hand() -> None:
    """Targets 0, 2, 4, predicted 1, 2, 4: error 1, variation 8, R² 7/8; the mean of all scores 0, a bad guess less."""
    y, robot, mean = np.repeat([[0.0], [2.0], [4.0]], 10, axis=0), np.arange(30) + 5, np.full((30, 1), 2.0)
    two = np.array([2.0])
    assert determination(y, np.repeat([[1.0], [2.0], [4.0]], 10, axis=0), robot, two).mean == pytest.approx(7 / 8)
    assert determination(y, mean, robot, two).each == pytest.approx([0.0])
    assert determination(y, y[::-1], robot, two).mean == pytest.approx(-3.0)
    both = determination(np.hstack([y, y]), np.hstack([y, mean]), robot, np.array([2.0, 2.0]))
    assert both.each == pytest.approx([1.0, 0.0])
    assert both.mean == pytest.approx(0.5)


def test_intervals_count_robots_and_not_rows() -> None:
    """A walk of a hundred steps is one robot: copying every row must not narrow the interval."""
    generator = np.random.default_rng(1)
    y = generator.uniform(size=(50, 1))
    predicted = y + 0.2 * generator.standard_normal((50, 1))
    few = determination(y, predicted, np.arange(50), HALF)
    many = determination(np.repeat(y, 100, 0), np.repeat(predicted, 100, 0), np.repeat(np.arange(50), 100), HALF)
    assert many.mean_interval == pytest.approx(few.mean_interval)
    assert few.mean_interval[0] < few.mean < few.mean_interval[1]


def test_a_stumble_does_not_drag_the_fit_along() -> None:
    """One row in eighty has a feature a thousand times too large: without the cut the slope would be lost, errors 1."""
    x = np.tile(np.linspace(-1.0, 1.0, 40), 2)[:, None]
    y, robot = 2.0 * x, np.arange(80)
    wild = x.copy()
    wild[0] = 1000.0
    clean, hurt = fit_ridge(x, y, robot), fit_ridge(wild, y, robot)
    np.testing.assert_allclose(clean.predict(x), y, atol=0.01)
    assert np.abs(hurt.predict(x) - y).mean() < 0.4
