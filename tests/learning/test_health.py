"""Divergence: found by what it looks like, with the iteration it began in; healthy runs pass."""

import math

import pytest

from stiction.learning.health import Diagnosis, Health

USUAL = {
    "reward": 0.02,
    "loss/value": 0.02,
    "loss/estimator": 0.1,
    "action_std": 0.5,
    "kl": 0.02,
    "learning_rate": 1e-3,
    "walk/falls": 0.1,
    "walk/blown_up": 0.0,
}


def first_diagnosis(rows: list[dict], num_envs: int = 100) -> tuple[int, Diagnosis] | None:
    """The iteration, counted from 1, in which a run of `rows` is stopped, and why."""
    health = Health(num_envs, desired_kl=0.01)
    for iteration, row in enumerate(rows, 1):
        diagnosis = health.check(iteration, row)
        if diagnosis is not None:
            return iteration, diagnosis
    return None


@pytest.mark.parametrize(
    ("change", "lasting", "symptom"),
    [
        ({"reward": math.nan}, 1, "reward not finite"),
        ({"loss/value": 2.1}, 10, "median before was 0.02"),
        ({"loss/estimator": math.inf}, 1, "loss/estimator not finite"),
        ({"loss/estimator": 10.1}, 10, "loss/estimator is 10.1"),
        ({"action_std": 1.99}, 50, "from 0.50 to its bound"),
        ({"kl": 0.11, "learning_rate": 1e-5}, 20, "learning rate at its floor"),
        ({"walk/blown_up": 6.0}, 5, "6% of the simulations"),
        ({"walk/falls": 4.0}, 50, "after 0.25 s"),
    ],
)
def test_each_way_to_diverge_is_found_after_it_has_lasted(change: dict, lasting: int, symptom: str) -> None:
    """Without this a run goes on for hours after it is lost; what is seen, and since when, must be said."""
    rows = [USUAL] * 30 + [USUAL | change] * 60
    first = first_diagnosis(rows)
    assert first is not None
    iteration, diagnosis = first
    assert iteration == 30 + lasting and diagnosis.since == 31
    assert symptom in diagnosis.what and diagnosis.advice
    assert first_diagnosis(rows[: 30 + lasting - 1]) is None


def test_a_run_is_suspicious_from_the_first_bad_iteration() -> None:
    """Its checkpoints must not replace good ones before the verdict is sure."""
    health = Health(100, 0.01)
    for iteration, (row, suspicious) in enumerate(
        [(USUAL, False), (USUAL | {"walk/blown_up": 50.0}, True), (USUAL, False)], 1
    ):
        assert health.check(iteration, row) is None
        assert health.suspicious is suspicious
