"""Consistency of a log's parts, drift, and autocorrelation of a residual, by hand where possible."""

from __future__ import annotations

import numpy as np
import pytest

from equation import autoregressive, equation_rows
from stiction.files.joints import Estimate
from stiction.identification.consistency import (
    COMPARED,
    Comparison,
    compare,
    compare_parts,
    find_drift,
    friction_at,
    splits,
    whiteness,
    widened,
)
from stiction.identification.model import Model
from stiction.identification.prepare import Rows
from stiction.identification.regression import Fit, fit_rows

PLAIN = {"inertia": 0.02, "viscous_friction": 0.07, "coulomb_friction": 0.4, "offset": -0.05}


def noisy(seed: int = 0, size: float = 0.05, **changes: float) -> Rows:
    """Return rows of a plain joint in white noise, its parameters changed."""
    noise = size * np.random.default_rng(seed).standard_normal(2000)
    grows = changes.pop("grows", 0.0)
    return equation_rows(PLAIN | changes, noise=noise, grows=grows)


def fitted(rows: Rows) -> Fit:
    """Fit viscous and Coulomb friction."""
    return fit_rows(rows, Model())


def around(value: float, std: float) -> Estimate:
    """Return an estimate whose interval is two deviations to each side."""
    return Estimate(value, std, (value - 2 * std, value + 2 * std))


def apart(values: tuple[Estimate, Estimate]) -> Comparison:
    """Return a comparison that differs in dry friction alone."""
    same = (around(1.0, 0.1), around(1.0, 0.1))
    table = {"inertia": same, "viscous_friction": same, "coulomb_friction": values}
    return Comparison("halves", ("first half", "second half"), table, 1.0, same)


def test_a_log_is_cut_in_half_by_time_and_by_speed() -> None:
    """Fast in stretches 3, 7, 11 and so on of 16: too few for the median, so the slow part is the other twelve."""
    time = 5.0 + 0.01 * np.arange(1600)
    stretch = np.arange(1600) // 100
    velocity = np.where(stretch % 4 == 3, 2.0, 0.5) * np.where(np.arange(1600) % 2, 1.0, -1.0)
    halves, speeds = splits(time, velocity)
    np.testing.assert_array_equal(np.flatnonzero(halves.first), np.arange(800))
    np.testing.assert_array_equal(speeds.first, stretch % 4 != 3)
    assert halves.parts == ("first half", "second half") and speeds.parts == ("slow part", "fast part")


def test_sigmas_and_disputes_by_hand() -> None:
    """0.5 and 0.6 with deviations 0.03 and 0.04 are 0.1/0.05 = 2 apart: chance; 0.65 is 3 apart: a dispute."""
    chance, dispute = (apart((around(0.5, 0.03), around(other, 0.04))) for other in (0.6, 0.65))
    assert chance.sigmas("coulomb_friction") == pytest.approx(2.0) and chance.disputed == ()
    assert dispute.sigmas("coulomb_friction") == pytest.approx(3.0) and dispute.disputed == ("coulomb_friction",)
    assert dispute.sigmas("inertia") == 0.0
    data = dispute.to_dict()
    assert data["disputed"] == ["coulomb_friction"] and data["values"]["coulomb_friction"][1]["value"] == 0.65


def test_a_disputed_interval_admits_both_parts() -> None:
    """Between 0.5 and 0.7 stands 0.58 ± 0.02: from 0.5 to 0.7 after it, its deviation half the gap."""
    seen = {name: around(0.58, 0.01) for name in COMPARED}
    wide = widened(seen, (apart((around(0.5, 0.01), around(0.7, 0.01))),))
    assert wide["coulomb_friction"].interval95 == (0.5, 0.7)
    assert wide["coulomb_friction"].std == pytest.approx(0.1) and wide["coulomb_friction"].value == 0.58
    assert wide["inertia"] == seen["inertia"] and wide["viscous_friction"] == seen["viscous_friction"]


def test_parts_of_one_joint_agree_and_two_joints_do_not() -> None:
    """Ten logs of one joint: at most two disputes among 60 comparisons; with 0.05 N m more friction: always."""
    disputes = []
    for seed in range(10):
        rows = noisy(seed)
        comparisons = compare_parts(rows, fitted(rows))
        assert [comparison.label for comparison in comparisons] == ["halves", "slow and fast"]
        disputes += [name for comparison in comparisons for name in comparison.disputed]
        other = compare("repeat 1", ("a", "b"), rows, noisy(seed + 10, coulomb_friction=0.45), fitted(rows))
        assert other.disputed == ("coulomb_friction",) and other.parts == ("a", "b")
        one, two = other.values["coulomb_friction"]
        assert one.value == pytest.approx(0.4, abs=0.02) and two.value == pytest.approx(0.45, abs=0.02)
    assert len(disputes) <= 2, disputes


def test_friction_at_a_speed_by_hand() -> None:
    """0.07 · 3 + 0.4 = 0.61 N m; B and b_c err against each other, so their sum is better known than b_c alone."""
    rows = noisy()
    fit = fitted(rows)
    tau = friction_at(fit, 3.0)
    assert tau.value == pytest.approx(3.0 * fit.values[1] + fit.values[2]) and abs(tau.value - 0.61) < 4 * tau.std
    weights = np.array([0.0, 3.0, 1.0, 0.0])
    assert tau.std == pytest.approx(np.sqrt(weights @ fit.covariance @ weights))
    assert tau.std < fit.estimates()["coulomb_friction"].std


@pytest.mark.parametrize("grows", [0.2, -0.2, 0.0])
def test_friction_that_grows_is_found(grows: float) -> None:
    """From 10 % under its mean at the start to 10 % over it at the end: 20 %, within the interval, and not without."""
    inside = 0
    for seed in range(20):
        rows = noisy(seed, grows=grows)
        change = find_drift(rows, fitted(rows)).change
        assert change is not None and abs(change.value - grows) < 5 * change.std
        assert change.std < 0.02
        inside += change.interval95[0] <= grows <= change.interval95[1]
    assert inside >= 17


def test_white_noise_has_no_memory() -> None:
    """The portmanteau probability of white noise is even from 0 to 1: under 0.05 in about 5 of 100."""
    results = [whiteness(np.random.default_rng(seed).standard_normal(1000)) for seed in range(100)]
    assert 1 <= sum(one.probability < 0.05 for one in results) <= 11
    assert 0.35 < np.mean([one.probability for one in results]) < 0.65
    assert max(abs(one.first_lag) for one in results) < 0.15
    assert np.median([one.correlation_time for one in results]) == pytest.approx(1.0, abs=0.1)


def test_noise_that_remembers_is_told() -> None:
    """A first-order memory of 0.8: neighbours correlate 0.8, and it lasts (1 + 0.8)/(1 − 0.8) = 9 rows."""
    result = whiteness(autoregressive(np.random.default_rng(0), 20_000, 0.8))
    assert result.first_lag == pytest.approx(0.8, abs=0.02)
    assert result.correlation_time == pytest.approx(9.0, rel=0.15) and result.probability < 1e-10
