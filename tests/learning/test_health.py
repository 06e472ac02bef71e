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
    ("change", "lasting", "said"),
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
def test_each_way_to_diverge_is_found_after_it_has_lasted(change: dict, lasting: int, said: str) -> None:
    """Without this a run goes on for hours after it is lost; what is seen, and since when, must be said."""
    rows = [USUAL] * 30 + [USUAL | change] * 60
    found = first_diagnosis(rows)
    assert found is not None
    iteration, diagnosis = found
    assert iteration == 30 + lasting and diagnosis.since == 31
    assert said in diagnosis.what and diagnosis.advice
    assert first_diagnosis(rows[: 30 + lasting - 1]) is None


@pytest.mark.parametrize(
    "rows",
    [
        # The loss is a hundredfold, but nothing is known yet to compare it with.
        [USUAL] * 10 + [USUAL | {"loss/value": 2.1}] * 9,
        # An outlier now and then, ten times as large as usual.
        ([USUAL] * 9 + [USUAL | {"loss/value": 0.2}]) * 20,
        # A hundredfold nine times in a row, then healthy again.
        [USUAL] * 30 + ([USUAL | {"loss/value": 2.1}] * 9 + [USUAL]) * 9,
        # Exploration at its lower bound: how a long run ends, and how a policy ends that never moves.
        [USUAL | {"action_std": 0.05, "reward": 0.0}] * 300,
        # Strong exploration, chosen.
        [USUAL | {"action_std": 2.0}] * 300,
        # The learning rate at its floor while the step is as it should be, and a large step that can still shrink.
        [USUAL | {"learning_rate": 1e-5}] * 100,
        [USUAL | {"kl": 0.5}] * 100,
        # An untrained quadruped.
        [USUAL | {"walk/falls": 1.0}] * 300,
        # A robot in twenty, and all of the student's figures, which are fewer.
        [USUAL | {"walk/blown_up": 5.0}] * 300,
        [{"reward": 0.02, "loss/clone": 0.005}] * 300,
    ],
)
def test_healthy_runs_go_on(rows: list[dict]) -> None:
    """A run that learns slowly, or nothing, is a result: stopping it would bias every comparison."""
    assert first_diagnosis(rows) is None


def test_a_run_is_suspicious_from_the_first_bad_iteration() -> None:
    """Its checkpoints must not replace good ones before the verdict is sure."""
    health = Health(100, 0.01)
    for iteration, (row, suspicious) in enumerate(
        [(USUAL, False), (USUAL | {"walk/blown_up": 50.0}, True), (USUAL, False)], 1
    ):
        assert health.check(iteration, row) is None
        assert health.suspicious is suspicious
