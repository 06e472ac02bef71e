"""The motions that the search is made of."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.identification.excite.pattern import Pattern, sine

PATTERN = Pattern(0.5, 0.4, 0.6, (0.5, 2.0), (1.0, 0.5), (0.3, 1.0), 0.4)


def test_both_parts_start_and_end_at_rest_and_keep_their_peaks() -> None:
    """A controller that is handed a jump kicks the joint."""
    offsets = PATTERN.offsets(2000, 200.0)
    slow, fast = offsets[:1000], offsets[1000:]
    assert np.abs(slow).max() == pytest.approx(0.6, rel=0.01) and np.abs(fast).max() == pytest.approx(0.4, rel=1e-9)
    for part in (slow, fast):
        assert part[0] == 0.0
        assert abs(part[-1]) < 0.01 and abs(part[1] - part[0]) < 0.001 and abs(part[-1] - part[-2]) < 0.02


def test_the_slow_part_moves_at_an_even_speed() -> None:
    """Two whole periods in five seconds go 8 × 0.6 rad; most of the time at 0.96 rad/s, give or take the corners."""
    slow = PATTERN.offsets(2000, 200.0)[:1000]
    speed = np.abs(np.diff(slow)) * 200.0
    assert np.median(speed) == pytest.approx(0.96, rel=0.2)
    assert np.mean(np.abs(speed - np.median(speed)) < 0.3 * np.median(speed)) > 0.7


def test_a_sine_is_a_pattern_without_a_slow_part() -> None:
    """In the middle, where the window is one, it is A sin(ωt)."""
    offsets = sine(1.0, 0.3).offsets(1000, 100.0)
    time = np.arange(1000) / 100.0
    assert offsets[300:700] == pytest.approx(0.3 * np.sin(2 * np.pi * time[300:700]), abs=1e-3)
