"""Sensors: steps, offsets and filters by hand, noise by its size."""

from dataclasses import replace

import numpy as np
import pytest

from stiction.core.rotation import about, roll_pitch
from stiction.virtual.hardware import Encoders, Imu, SensorErrors

PERFECT = SensorErrors.perfect(1)


def test_an_encoder_counts_whole_steps_from_its_own_zero() -> None:
    """0.1234 rad, counted from an offset of 0.01 in steps of 0.05, is 0.15."""
    encoders = Encoders(replace(PERFECT, encoder_step=0.05, encoder_offset=np.array([0.01])), 0.001)
    encoders.reset(np.array([0.1234]))
    assert encoders.angle[0] == pytest.approx(0.15)
    perfect = Encoders(PERFECT, 0.001)
    perfect.reset(np.array([0.1234]))
    perfect.follow(np.array([0.2]), np.array([3.0]))
    assert (perfect.angle[0], perfect.velocity[0]) == (0.2, 3.0)


def test_a_controller_knows_velocity_as_a_smoothed_difference_of_counted_angles() -> None:
    """At an even speed it comes to the speed, 63 % of it after one time constant, with the offset out of it."""
    errors = replace(PERFECT, encoder_offset=np.array([0.3]), velocity_filter=0.01)
    encoders = Encoders(errors, 0.001)
    encoders.reset(np.zeros(1))
    for step in range(1, 101):
        encoders.follow(np.array([2.0 * step * 0.001]), np.array([99.0]))
        if step == 10:
            assert encoders.velocity[0] == pytest.approx(2.0 * (1 - np.exp(-1)))
    assert encoders.velocity[0] == pytest.approx(2.0 * (1 - np.exp(-10)))


def test_an_imu_that_is_mounted_askew_reads_a_constant_tilt_and_rate() -> None:
    """Roll and pitch that the policy computes are off by the bias, at any heading; the rate by the gyroscope's."""
    errors = replace(PERFECT, tilt_bias=np.array([0.02, -0.01]), gyroscope_bias=np.array([0.1, 0.2, 0.3]))
    imu = Imu(errors, 0.002, np.random.default_rng(0))
    for heading in (0.0, 2.0):
        quaternion, rate = imu.read(about(2, heading), np.array([1.0, 0.0, 0.0]))
        np.testing.assert_allclose(roll_pitch(quaternion), [0.02, -0.01], atol=2e-4)
        np.testing.assert_allclose(rate, [1.1, 0.2, 0.3])


def test_noise_has_the_size_that_it_says_and_the_tilt_wanders_slowly() -> None:
    """White noise of the rate; a tilt that has its spread, and changes between readings as its memory says."""
    errors = replace(PERFECT, gyroscope_noise=0.05, tilt_wander=0.01)
    imu = Imu(errors, 0.2, np.random.default_rng(0))
    read = [imu.read(np.array([1.0, 0, 0, 0]), np.zeros(3)) for _ in range(3000)]
    rates = np.array([rate for _, rate in read])
    tilts = roll_pitch(np.array([quaternion for quaternion, _ in read]))
    np.testing.assert_allclose(rates.std(axis=0), 0.05, rtol=0.03)
    np.testing.assert_allclose(tilts.std(axis=0), 0.01, rtol=0.1)
    np.testing.assert_allclose(np.diff(tilts, axis=0).std(axis=0), 0.01 * np.sqrt(2 * (1 - np.exp(-0.2))), rtol=0.05)
