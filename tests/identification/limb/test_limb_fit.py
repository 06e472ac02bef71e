"""Least squares over blocks: numbers worked out by hand."""

import numpy as np
import pytest

from stiction.identification.limb.fit import fit_blocks

ONES, MEAN = np.ones((4, 1)), ("mean",)


def test_a_mean_and_its_jackknife_by_hand() -> None:
    """Blocks (1, 3) and (5, 7): mean 4; without one block 6 and 2; variance (2-1)/2 · (2² + 2²) = 4."""
    fit = fit_blocks(MEAN, ONES, np.array([1.0, 3.0, 5.0, 7.0]), np.array([8, 8, 3, 3]))
    assert fit.values[0] == pytest.approx(4.0)
    assert fit.covariance[0, 0] == pytest.approx(4.0)
    assert fit.blocks == 2
    np.testing.assert_allclose(fit.residual, [-3, -1, 1, 3])
    estimate = fit.estimate("mean")
    assert estimate.std == pytest.approx(2.0)
    assert estimate.interval95[1] == pytest.approx(4.0 + 12.706 * 2.0, rel=1e-3)


def test_an_error_common_to_all_blocks_widens_the_interval_by_its_effect() -> None:
    """The target may be 0.3 too large throughout: the mean too, and no spread of blocks shows it."""
    target = np.array([1.0, 1.0, 1.0, 1.0])
    fit = fit_blocks(MEAN, ONES, target, np.array([0, 0, 1, 1]), systematic=np.array([[0.3] * 4, [0.4] * 4]))
    assert fit.covariance[0, 0] == pytest.approx(0.0)
    estimate = fit.estimate("mean")
    np.testing.assert_allclose(estimate.interval95, (0.5, 1.5))
    assert estimate.std == pytest.approx(0.25)


def test_a_prior_by_hand() -> None:
    """Level and offset look alike (both columns are 1); the offset is 0 ± 0.1, so the level takes all but its ±0.1."""
    generator = np.random.default_rng(0)
    target = 2.0 + 0.01 * generator.normal(size=400)
    block = np.repeat(np.arange(20), 20)
    fit = fit_blocks(("level", "offset"), np.ones((400, 2)), target, block, np.array([np.inf, 0.1]))
    assert fit.values == pytest.approx([2.0, 0.0], abs=0.01)
    assert fit.estimate("level").std == pytest.approx(0.1, rel=0.02)
    assert fit.combination({"level": 1.0, "offset": 1.0}).std < 0.002


def test_intervals_cover_when_blocks_share_an_error() -> None:
    """Intervals cover swings with a constant residual each, where textbook intervals cover a third."""
    generator, hits, narrow = np.random.default_rng(1), 0, 0
    block = np.repeat(np.arange(15), 12)
    for _ in range(300):
        column = generator.normal(size=(180, 1)) + generator.normal(size=15)[block, None]
        target = 2.0 * column[:, 0] + generator.normal(size=15)[block]
        fit = fit_blocks(("slope",), column, target, block)
        low, high = fit.estimate("slope").interval95
        hits += low <= 2.0 <= high
        textbook = float(np.std(fit.residual) / np.linalg.norm(column))
        narrow += abs(fit.values[0] - 2.0) <= 1.96 * textbook
    assert hits / 300 >= 0.92
    assert narrow / 300 < 0.75
