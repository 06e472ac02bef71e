"""The example logs: what stands between the joint and the log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from shanks import ASYMMETRIC, GO1, LOADED_LEG, STRIBECK
from stiction.core.errors import StictionError
from stiction.identification.example import LEG, SATURN_LITE, Excitation, Motor, SensorNoise, example_log
from stiction.joints.simulate import simulate

SHORT = Excitation(duration=2.0)


@pytest.mark.parametrize("motor", [GO1, SATURN_LITE, ASYMMETRIC, STRIBECK, LEG, LOADED_LEG], ids=lambda m: m.name)
def test_white_noise_is_added_to_the_log_and_does_not_move_the_joint(motor: Motor) -> None:
    """Position and torque differ from the simulation by noise of the size asked for, uncorrelated in time."""
    made = simulate(motor.joint, motor.gains, 0.002, SHORT.target()[1])
    log = example_log(motor, SHORT, SensorNoise.white(1e-3, 0.05)).joints["shank"]
    assert log.position is not None and log.torque is not None
    for logged, true, size in ((log.position, made.position, 1e-3), (log.torque, made.torque, 0.05)):
        noise = logged - true
        assert np.std(noise) == pytest.approx(size, rel=0.1)
        assert abs(np.mean(noise[1:] * noise[:-1])) < 0.1 * size**2


def test_samples_are_taken_off_the_grid_and_stamped_as_asked() -> None:
    """2 % of jitter: true stamps wander by that, and the angle is that of the true instant, whatever the stamp says."""
    quiet = SensorNoise.white(0.0, 0.0)
    grid = example_log(SATURN_LITE, SHORT, quiet)
    true = example_log(SATURN_LITE, SHORT, replace(quiet, jitter=0.02))
    even = example_log(SATURN_LITE, SHORT, replace(quiet, jitter=0.02, stamps="even"))
    wander = true.time - grid.time
    assert np.std(wander) == pytest.approx(0.02 * 0.002, rel=0.1)
    np.testing.assert_array_equal(even.time, grid.time)
    np.testing.assert_array_equal(even.joints["shank"].position, true.joints["shank"].position)
    moved = np.asarray(true.joints["shank"].position) - np.asarray(grid.joints["shank"].position)
    speed = np.gradient(np.asarray(grid.joints["shank"].position), 0.002)
    assert np.std(moved - speed * wander) < 0.1 * np.std(moved)


def test_jitter_that_reorders_samples_is_refused() -> None:
    """A standard deviation of half a step would put samples out of order."""
    with pytest.raises(StictionError, match=r"jitter 0\.5"):
        SensorNoise(jitter=0.5)
