"""Filtering, differentiation, and the choice of samples."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from stiction.identification.checks import Uniform
from stiction.identification.filters import choose_cutoff, low_pass
from stiction.identification.prepare import prepare

STEP = 0.002
TIME = np.arange(5000) * STEP
RATE = 2 * np.pi * 1.5


def signals(noise: float = 0.0) -> Uniform:
    """Return a sine of 1.5 Hz, with torque equal to its exact acceleration."""
    angle = np.sin(RATE * TIME) + noise * np.random.default_rng(0).standard_normal(len(TIME))
    return Uniform(TIME, STEP, angle, -(RATE**2) * np.sin(RATE * TIME), None, None)


def test_derivatives_have_no_delay_and_the_right_size() -> None:
    """Derivatives have no delay: one sample of it makes 2 % of the inertia's torque viscous friction."""
    prepared = prepare(signals(), np.asarray(signals().torque), cutoff=40.0)
    inner = slice(100, -100)
    np.testing.assert_allclose(prepared.velocity[inner], RATE * np.cos(RATE * TIME)[inner], atol=3e-3 * RATE)
    np.testing.assert_allclose(prepared.acceleration[inner], prepared.torque[inner], atol=3e-3 * RATE**2)


def test_samples_near_reversals_are_left_out() -> None:
    """Within one period of the corner around each reversal nothing enters: 25 ms at 40 Hz."""
    prepared = prepare(signals(), np.asarray(signals().torque), cutoff=40.0)
    turns = (np.arange(30) + 0.5) / 3.0
    distance = np.abs(TIME[prepared.used, None] - turns[None]).min(axis=1)
    assert distance.min() > 0.024
    assert np.abs(prepared.velocity[prepared.used]).min() > prepared.threshold
    assert len(prepared.used) > 500
    np.testing.assert_allclose(np.abs(prepared.direction[prepared.used]), 1.0, atol=0.05)


def test_more_noise_lowers_the_corner() -> None:
    """Clean signals keep a quarter of the rate; noise of 1e-3 rad lowers the corner."""
    assert choose_cutoff(signals().position, STEP, 0.0) == pytest.approx(125.0)
    corners = [choose_cutoff(signals(noise).position, STEP, noise) for noise in (1e-4, 1e-3, 1e-2)]
    assert 125 > corners[0] > corners[1] > corners[2] > 5


@pytest.mark.parametrize("cutoff", [5.0, 20.0, 100.0])
def test_the_filter_is_the_usual_one_and_its_ends_reach_no_sample_that_counts(cutoff: float) -> None:
    """The filter equals SciPy's Butterworth, both ways, to a millionth from two periods of the corner off the ends."""
    time = np.arange(5000) / 500
    signal = 0.5 * np.sin(2.5 * time + 1) + 0.2 * np.sin(8.0 * time) + 0.1 * time
    usual = sosfiltfilt(butter(4, 2 * cutoff / 500, output="sos"), signal, padlen=2000)
    end = int(2 * 500 / cutoff)
    np.testing.assert_allclose(low_pass(signal, cutoff, 1 / 500)[end:-end], usual[end:-end], atol=1e-6)
