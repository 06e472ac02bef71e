"""Instrumental variables against least squares, where the noise of the encoder goes round the loop."""

from __future__ import annotations

from functools import partial

import numpy as np

from stiction.identification.example import SATURN_LITE, SensorNoise, example_log
from stiction.identification.model import Model
from stiction.identification.regression import Fit, fit_instrumental, fit_rows
from stiction.identification.runs import Run, make_run
from stiction.identification.setup import IdentifySetup
from stiction.joints.simulate import simulate

TRUTH = np.array([0.0145, 0.0704, 0.442, -0.05])
LOUD = SensorNoise(position=3e-4, resolution=0.0, velocity=0.0, torque=0.05, ripple=0.0)
"""Three times the example's noise in the angle that the controller acts on."""


def prepared(noise: SensorNoise, seed: int = 0, cutoff: float | None = None) -> tuple[Run, Fit]:
    """Return a log of Saturn Lite's shank, ready, and its least squares."""
    run = make_run(example_log(SATURN_LITE, noise=noise, seed=seed), None, IdentifySetup(cutoff=cutoff))
    return run, fit_rows(run.rows, run.model)


def followed(run: Run, values: np.ndarray) -> np.ndarray:
    """Simulate the loop of the log with these values."""
    target = np.asarray(run.signals.target)
    return simulate(Model().joint(values.tolist()), SATURN_LITE.gains, run.signals.step, target).position


def test_without_noise_instruments_change_nothing() -> None:
    """Then the simulation is the log, the instruments are the regressors, and the two estimators are one."""
    run, squares = prepared(SensorNoise.white(0.0, 0.0))
    found = fit_instrumental(run.prepared, None, squares, partial(followed, run))
    assert found is not None and found.instrument is not None
    np.testing.assert_allclose(found.values, squares.values, rtol=1e-5)
    np.testing.assert_allclose(found.values, TRUTH, rtol=0.01)


def test_noise_in_the_loop_biases_least_squares_and_not_instruments() -> None:
    """At a corner of 60 Hz, twice what the program would choose, over 24 logs: least squares finds 3.6 % too little
    inertia and 1 % too little viscous friction, many standard errors; instruments stay within three of the truth.
    """
    squares, instruments = [], []
    for seed in range(24):
        run, fit = prepared(LOUD, seed, 60.0)
        found = fit_instrumental(run.prepared, None, fit, partial(followed, run))
        assert found is not None
        squares.append(fit.values / TRUTH - 1)
        instruments.append(found.values / TRUTH - 1)
    (biased, error), (free, rest) = (
        (np.mean(each, axis=0), np.std(each, axis=0, ddof=1) / np.sqrt(24)) for each in (squares, instruments)
    )
    assert biased[0] < -0.03 and biased[0] < -20 * error[0]
    assert biased[1] < -3 * error[1]
    assert np.all(np.abs(free) < 3 * rest + 0.001), (free, rest)
    assert rest[0] < 0.001


def test_its_intervals_hold_the_truth_that_least_squares_misses() -> None:
    """Of 24 logs least squares' scatter misses the inertia in all; widened by its regressor's noise it holds it."""
    inside, scatter = [0, 0], 0
    for seed in range(24):
        run, fit = prepared(LOUD, seed, 60.0)
        found = fit_instrumental(run.prepared, None, fit, partial(followed, run))
        assert found is not None
        for index, one in enumerate((fit, found)):
            low, high = one.estimates()["inertia"].interval95
            inside[index] += low <= TRUTH[0] <= high
        scatter += abs(fit.values[0] - TRUTH[0]) < 3 * np.sqrt(fit.covariance[0, 0])
    assert scatter == 0 and inside[0] >= 22 and inside[1] >= 20
