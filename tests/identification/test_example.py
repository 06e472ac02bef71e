"""Example logs: the effects between the joint and the log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stiction.identification.example import SATURN_LITE, Excitation, SensorNoise, example_log

SHORT = Excitation(duration=2.0)


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
