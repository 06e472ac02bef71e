"""Rows as samples over seeds, and which seed is shipped."""

import pytest

from stiction_experiments.friction.claims import takes_longer
from stiction_experiments.friction.evaluation import iterations_by_seed, learning_curve
from stiction_experiments.friction.evidence import TrainingEvidence, at, median_seed, seed_means
from synthetic import condition_rows, curve


def test_slower_faster_and_error_by_hand() -> None:
    """Forward 1.0 and 0.6, backward half of it: errors (0 + 0.5 + 0.4 + 0.7) / 4 = 0.4."""
    evidence = TrainingEvidence.of_runs(condition_rows("a", {0.0: [1.0], 0.2: [0.6]}, backward=0.5))
    assert evidence.slower("a", at(0.2)).seeds == {0: pytest.approx(0.3)}
    assert evidence.faster("a", at(0.2)).seeds == {0: pytest.approx(0.6)}
    assert evidence.mean_error("a").seeds == {0: pytest.approx(0.4)}
    assert evidence.slower("b", at(0.2)).seeds == {} and evidence.mean_error("b").seeds == {}


def test_a_seed_without_every_level_is_no_sample() -> None:
    """Leaves out a seed that lacks a level."""
    evidence = TrainingEvidence.of_runs(condition_rows("a", {0.0: [1.0, 1.0], 0.2: [1.0]}))
    assert list(evidence.mean_error("a").seeds) == [0]


def test_means_are_over_seeds_and_one_seed_has_no_interval() -> None:
    """1, 2, 3 forward: 2 ± 2.4841, of three samples and not of three times sixteen episodes."""
    rows = [*condition_rows("a", {0.0: [1.0, 2.0, 3.0]}), *condition_rows("b", {0.0: [1.0]})]
    means = seed_means(TrainingEvidence.of_runs(rows))
    first = next(m for m in means if (m.condition, m.command) == ("a", "vx=0.5"))
    assert (first.seeds, first.mean) == (3, 2.0) and first.low == pytest.approx(2 - 2.4841, abs=1e-4)
    assert all((m.low, m.high) == (None, None) for m in means if m.condition == "b")


def test_the_median_seed_is_shipped_not_the_best() -> None:
    """Errors 0.3, 0.0, 0.1: seed 2. Levels above 0.3 and teachers do not count."""
    rows = condition_rows("a", {0.0: [0.7, 1.0, 0.9], 0.5: [1.0, 0.0, 0.0]})
    rows += condition_rows("a", {0.0: [1.0, 0.5, 0.0]}, who="teacher")
    assert median_seed(rows, "a") == 2
    assert median_seed(condition_rows("a", {0.0: [0.7, 1.0, 0.9, 0.8]}), "a") == 2
    assert median_seed(rows, "b") is None


def test_iterations_to_walk() -> None:
    """Walks from 120 on; a run that never walks counts as its whole budget."""
    curves = {"a-s0": curve("a-s0", 120), "a-s1": curve("a-s1", 1000), "b-s0": curve("b-s0", 50)}
    assert iterations_by_seed("a", curves) == ({0: 120.0, 1: 350.0}, 1)
    claim = takes_longer("a", "b")(TrainingEvidence.of_runs([], curves))
    assert claim.evidence.startswith("a (1 of 2 seeds not before the end) 235.00 [") and "; b 50.00" in claim.evidence


def test_a_learning_curve_is_means_of_ten() -> None:
    """Iterations 1 to 25, forward = iteration: 5.5 and 15.5; the five that are left over are left out."""
    rows = [
        {"phase": "teacher", "iteration": i, "walk/forward_ratio": float(i), "walk/backward_ratio": 1.0}
        for i in range(1, 26)
    ]
    points = learning_curve("a-s0", rows)
    assert [(p.iteration, p.forward_ratio, p.backward_ratio) for p in points] == [(10, 5.5, 1.0), (20, 15.5, 1.0)]
