"""Statistics of the report, by hand-computed numbers."""

import pytest

from stiction_experiments.paper.decide import Test, decide, holm, joined

FIVE = {10: 0.9, 11: 0.8, 12: 0.85, 13: 0.95, 14: 0.9}


def test_holm_multiplies_the_smallest_by_the_number_of_tests():
    """0.01 · 3, 0.03 · 2, and 0.04 · 1 raised to the one before; Holm 1979."""
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.5, 0.9]) == [1.0, 1.0]
    assert holm([]) == []


def test_differences_of_the_same_seeds_are_paired():
    """Differences 0.1, 0.1, 0.2, 0.1, 0.1: mean 0.12, standard error 0.02, t = 6 with 4 degrees of freedom."""
    lower = {10: 0.8, 11: 0.7, 12: 0.65, 13: 0.85, 14: 0.8}
    test = Test("20 %", FIVE, lower)
    assert test.paired and test.p() == pytest.approx(0.003883, rel=1e-3)
    low, high = test.interval(0.95)
    assert (low, high) == pytest.approx((0.12 - 2.776445 * 0.02, 0.12 + 2.776445 * 0.02), rel=1e-5)
    (decision,) = decide([test])
    assert decision.outcome == "holds" and decision.p == pytest.approx(0.003883, rel=1e-3)
    assert decide([Test("20 %", lower, FIVE)])[0].outcome == "does not hold"


def test_correction_makes_a_weak_difference_undecided():
    """P of 0.0039 times thirteen tests of the same strength is 0.0505."""
    lower = {10: 0.8, 11: 0.7, 12: 0.65, 13: 0.85, 14: 0.8}
    decisions = decide([Test(str(number), FIVE, lower) for number in range(13)])
    assert {decision.outcome for decision in decisions} == {"undecided"}
    assert joined(decisions) == "undecided"


def test_no_difference_needs_an_interval_within_the_margin():
    """Equal values are the same; 0.12 apart are not; a scatter of ± 0.1 says neither."""
    scattered = {10: 1.0, 11: 0.7, 12: 0.95, 13: 0.85, 14: 0.9}
    apart = {seed: value - 0.12 for seed, value in FIVE.items()}
    outcomes = [decide([Test("", FIVE, other, "same")])[0].outcome for other in (FIVE, apart, scattered)]
    assert outcomes == ["holds", "does not hold", "undecided"]


def test_a_noticeable_difference_is_one_beyond_the_margin():
    """0.12 more everywhere is; 0.02 to 0.03 is sure and too little; a scatter of ± 0.1 is neither."""
    less = {seed: value - 0.12 - 0.001 * (seed % 2) for seed, value in FIVE.items()}
    hardly = {seed: value - 0.02 - 0.01 * (seed % 2) for seed, value in FIVE.items()}
    scattered = {10: 1.0, 11: 0.7, 12: 0.95, 13: 0.85, 14: 0.9}
    pairs = ((FIVE, less), (less, FIVE), (FIVE, hardly), (FIVE, scattered))
    decisions = [decide([Test("", first, second, "noticeable")])[0] for first, second in pairs]
    assert [decision.outcome for decision in decisions] == ["holds", "does not hold", "does not hold", "undecided"]
    assert decisions[2].p is not None and decisions[2].p < 0.05


def test_one_training_is_decided_where_all_seeds_are_on_one_side():
    """The bound itself counts as above."""
    above = [Test("", FIVE, kind="above", bound=bound) for bound in (0.8, 0.85, 0.96)]
    assert [decision.outcome for decision in decide(above)] == ["holds", "undecided", "does not hold"]
    assert decide([Test("", FIVE, kind="below", bound=0.96)])[0].outcome == "holds"


def test_two_seeds_decide_nothing():
    """A sentence whose walks are missing says so."""
    few = Test("1 %", {10: 1.0, 11: 1.0}, FIVE)
    decisions = decide([few, Test("20 %", FIVE, kind="above")])
    assert decisions[0].outcome == "not walked" and decisions[0].evidence == "1 %: 2 and 5 seeds"
    assert joined(decisions) == "holds: 20 %; not walked: 1 %"
