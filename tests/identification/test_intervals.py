"""Intervals under correlated residuals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from stiction.identification.intervals import (
    Blocks,
    block_count,
    bootstrap_reach,
    correlation_time,
    make_blocks,
    robust_covariance,
    with_intervals,
)


def correlated(seed: int, count: int, keep: float) -> np.ndarray:
    """Return noise of size 1 whose correlation falls by `keep` per sample."""
    noise = np.random.default_rng(seed).standard_normal(count + 500)
    return lfilter([np.sqrt(1 - keep**2)], [1, -keep], noise)[500:]


def test_covariance_of_a_mean_by_hand() -> None:
    """Residuals (1, 1, −1, −1) in two blocks: sums ±2, H = 4, factor 2 · 3/3, so 2 (4 + 4) / 16 = 1."""
    blocks = make_blocks(np.ones((4, 1)), np.array([1.0, 1.0, -1.0, -1.0]), np.array([0, 0, 1, 1]))
    assert blocks.gradient.ravel().tolist() == [2.0, -2.0] and blocks.curvature.ravel().tolist() == [2.0, 2.0]
    assert robust_covariance(blocks)[0, 0] == pytest.approx(1.0)


def test_instruments_enter_on_the_left() -> None:
    """With z = (1, 2), w = (1, 1), r = (1, -1) a row a block: A = 3, g = (1, -2), variance 2 (1/1) (1 + 4) / 9."""
    jacobian, instrument = np.ones((2, 1)), np.array([[1.0], [2.0]])
    blocks = make_blocks(jacobian, np.array([1.0, -1.0]), np.array([0, 1]), instrument)
    assert blocks.curvature.sum() == 3.0 and blocks.gradient.ravel().tolist() == [1.0, -2.0]
    assert robust_covariance(blocks)[0, 0] == pytest.approx(2 * 5 / 9)


def test_the_reach_is_at_least_students_and_grows_where_one_block_rules() -> None:
    """Thirty alike blocks: about Student's 2.05; where one block carries most of the weight, more."""
    rng = np.random.default_rng(0)
    gradient = rng.standard_normal((30, 1))
    alike = Blocks(np.ones((30, 1, 1)), gradient - gradient.mean(), 3000)
    reach = bootstrap_reach(alike)[0]
    assert 2.045 <= reach < 2.3
    gradient[-1] = 15.0
    ruled = Blocks(np.ones((30, 1, 1)), gradient - gradient.mean(), 3000)
    assert bootstrap_reach(ruled)[0] > 1.3 * reach


def test_correlation_time_of_a_known_process() -> None:
    """For correlation keep^|lag| it is (1 + keep) / (1 − keep): 19 for 0.9, 1 for white noise."""
    assert correlation_time(correlated(0, 200_000, 0.9)) == pytest.approx(19, rel=0.1)
    assert correlation_time(correlated(1, 200_000, 0.0)) == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("keep", [0.0, 0.97])
def test_intervals_of_a_slope_cover_the_truth(keep: float) -> None:
    """95 % intervals must cover about 95 %, also when the noise remembers 30 samples and the naive ones cover 30 %."""
    hits = 0
    for seed in range(300):
        regressor = np.stack([np.ones(3000), np.sin(np.arange(3000) / 100)], axis=1)
        data = regressor @ [0.3, 2.0] + correlated(seed, 3000, keep)
        values = np.linalg.lstsq(regressor, data, rcond=None)[0]
        residual = data - regressor @ values
        count = block_count(residual)
        blocks = make_blocks(regressor, residual, np.arange(3000) * count // 3000)
        low, high = with_intervals(values, robust_covariance(blocks), bootstrap_reach(blocks))[1].interval95
        hits += low < 2.0 < high
    assert 0.90 <= hits / 300 <= 0.98
