"""Intervals over seeds, with numbers worked out by hand (t quantiles from a printed table)."""

import pytest
from scipy.stats import binomtest, norm, permutation_test, ttest_1samp, ttest_ind

from stiction.core.statistics import permutation_p, t_interval, wilson
from stiction_experiments.lab.statistics import difference_interval, ratio_interval


def test_t_interval_by_hand() -> None:
    """1, 2, 3: mean 2, s = 1, t(2) = 4.3027, half width 4.3027 / √3 = 2.4841."""
    assert t_interval([1.0, 2.0, 3.0]) == pytest.approx((2 - 2.4841, 2 + 2.4841), abs=1e-4)


def test_difference_by_hand() -> None:
    """1, 2, 3 against 4, 5, 6: both variances 1, so ν = 4, t = 2.7764, half width 2.7764 √(2/3) = 2.2670."""
    assert difference_interval([4.0, 5.0, 6.0], [1.0, 2.0, 3.0]) == pytest.approx((0.7330, 5.2670), abs=1e-4)


def test_unequal_spread_by_hand() -> None:
    """0, 2 against 5, 5, 5: all spread is the first's, so ν = 1, t = 12.706, s/√n = 1: -4 ± 12.706."""
    assert difference_interval([0.0, 2.0], [5.0, 5.0, 5.0]) == pytest.approx((-16.706, 8.706), abs=1e-3)


def test_one_seed_has_no_interval() -> None:
    """One seed gives no interval, of a mean or of a difference."""
    assert t_interval([1.0]) is None and difference_interval([1.0, 2.0], [1.0]) is None


def test_ratio_by_hand() -> None:
    """1, 3 over 2, 2: ratio 1, spread of the first alone, s/√n over 2 is 0.5, ν = 1, t = 12.706: 1 ± 6.353."""
    assert ratio_interval([1.0, 3.0], [2.0, 2.0]) == pytest.approx((1 - 6.353, 1 + 6.353), abs=1e-3)


def test_intervals_are_those_of_scipy() -> None:
    """Intervals equal those of SciPy."""
    first, second = [0.31, 0.51, 0.42, 0.37], [0.25, 0.11, 0.22]
    assert t_interval(first) == pytest.approx(ttest_1samp(first, 0.0).confidence_interval(0.95), abs=1e-9)
    welch = ttest_ind(first, second, equal_var=False).confidence_interval(0.95)
    assert difference_interval(first, second) == pytest.approx(welch, abs=1e-9)
    six_digits = 2 * norm.cdf(1.959964) - 1
    for successes, trials in ((0, 16), (1, 3), (7, 80), (16, 16)):
        shares = binomtest(successes, trials).proportion_ci(six_digits, "wilson")
        assert wilson(successes, trials) == pytest.approx(shares, abs=1e-9)


def test_a_share_of_clusters_by_hand() -> None:
    """1.5 of 6: z² = 3.8415, centre (0.25 + z²/12) / (1 + z²/6) = 0.34758, half width 1.19492 · 0.24068 = 0.28759."""
    assert wilson(1.5, 6) == pytest.approx((0.05999, 0.63518), abs=1e-5)


def test_an_exact_permutation_test_by_hand_and_by_scipy() -> None:
    """1, 2 against 3, 4: of six splits two are as far apart; ties of five seeds, and three of each, as in SciPy."""
    assert permutation_p([1.0, 2.0], [3.0, 4.0]) == pytest.approx(2 / 6)
    assert permutation_p([], [1.0]) is None and permutation_p([0.0] * 15, [1.0] * 15) is None
    for first, second in (([15, 15, 14, 15, 12], [12, 12, 13, 9, 15]), ([0.1, 0.2, 0.4], [0.3, 0.9, 0.8])):
        exact = permutation_test((first, second), lambda a, b: a.mean() - b.mean(), n_resamples=10**6)
        assert permutation_p(first, second) == pytest.approx(exact.pvalue)
