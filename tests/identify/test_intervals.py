"""Intervals under correlated residuals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from stiction.identify.intervals import block_count, block_covariance, correlation_time, estimates


def correlated(seed: int, count: int, keep: float) -> np.ndarray:
    """Return noise of size 1 whose correlation falls by `keep` per sample."""
    noise = np.random.default_rng(seed).standard_normal(count + 500)
    return lfilter([np.sqrt(1 - keep**2)], [1, -keep], noise)[500:]


def test_covariance_of_a_mean_by_hand() -> None:
    """Residuals (1, 1, −1, −1) in two blocks: sums ±2, H = 4, factor 2 · 3/3, so 2 (4 + 4) / 16 = 1."""
    covariance = block_covariance(np.ones((4, 1)), np.array([1.0, 1.0, -1.0, -1.0]), np.array([0, 0, 1, 1]))
    assert covariance[0, 0] == pytest.approx(1.0)


def test_correlation_time_of_a_known_process() -> None:
    """For correlation keep^|lag| it is (1 + keep) / (1 − keep): 19 for 0.9, 1 for white noise."""
    assert correlation_time(correlated(0, 200_000, 0.9)) == pytest.approx(19, rel=0.1)
    assert correlation_time(correlated(1, 200_000, 0.0)) == pytest.approx(1, abs=0.1)


def test_blocks_outlast_the_memory() -> None:
    """White noise gives the most blocks; memory of a tenth of the log gives the fewest."""
    assert block_count(correlated(0, 5000, 0.0)) == 30
    assert block_count(np.sin(np.arange(5000) / 800)) == 8


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
        covariance = block_covariance(regressor, residual, np.arange(3000) * count // 3000)
        low, high = estimates(values, covariance, count - 1)[1].interval95
        hits += low < 2.0 < high
    assert 0.90 <= hits / 300 <= 0.98
