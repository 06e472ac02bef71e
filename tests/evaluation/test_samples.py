"""Rows of methods.csv: means over training seeds with their intervals, and trials of rates."""

import pytest

from stiction.evaluation.samples import Evidence, Row, samples
from stiction.evaluation.table import Sample


def row(seed: int, command: str, **columns: object) -> Row:
    """Return a row of a method on flat ground in PhysX."""
    return {
        **{"method": "none", "engine": "physx", "friction_law": "coulomb", "friction_level": 0.1, "terrain": "flat"},
        **{"seed": seed, "command": command, "speed_ratio": None, "tracking_error": 0.1, "joint_jitter": 50.0},
        **{"flight_share": None, "tripod_share": None, "steps_climbed": None, "fall_rate": 0.0, "crossed": None},
        **{"episodes": 10},
        **columns,
    }


def sampled(*rows: Row) -> dict[tuple[str, str], Sample]:
    """Return samples by command and column."""
    return {(sample.command, sample.column): sample for sample in samples(Evidence.of(rows))}


def test_a_sample_has_mean_interval_and_every_seed() -> None:
    """0.9 and 1.1: mean 1, half-width 12.706 · 0.1; the seeds 3 and 5 as they are called."""
    sample = sampled(row(5, "vx=0.5", speed_ratio=1.1), row(3, "vx=0.5", speed_ratio=0.9))["vx=0.5", "speed_ratio"]
    assert (sample.seeds, sample.each, sample.mean, sample.trials) == ("3 5", "0.9 1.1", pytest.approx(1.0), None)
    assert (sample.low, sample.high) == (pytest.approx(-0.2706, abs=1e-4), pytest.approx(2.2706, abs=1e-4))


def test_one_seed_has_no_interval_and_its_walks_are_trials() -> None:
    """No fall in ten walks is compatible with 28 %: 3.8415 / 13.8415."""
    sample = sampled(row(0, "vx=0.5", speed_ratio=1.0))["vx=0.5", "fall_rate"]
    assert (sample.low, sample.high, sample.trials, sample.trials_low) == (None, None, 10, pytest.approx(0.0, abs=1e-9))
    assert sample.trials_high == pytest.approx(0.27753, abs=1e-5)
