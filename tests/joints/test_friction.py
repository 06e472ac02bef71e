"""The two numbers that say how large friction is, and numbers that friction cannot have."""

from __future__ import annotations

import pytest

from stiction.formats.errors import StictionError
from stiction.joints.friction import Coulomb, dead_band, friction_ratio


def test_dead_band_and_ratio_are_the_papers() -> None:
    """Saturn Lite's shank: 0.442 / 45 = 0.98 % of its torque, and 0.442 / 40 = 0.011 rad at kp 40."""
    assert friction_ratio(0.442, 45.0) == pytest.approx(0.0098, abs=5e-5)
    assert dead_band(0.442, 40.0) == pytest.approx(0.01105)


def test_impossible_values_are_refused() -> None:
    """Negative friction would drive the joint; NaN would spread."""
    for level in (-0.1, float("nan")):
        with pytest.raises(StictionError, match="not negative"):
            Coulomb(level)
    with pytest.raises(StictionError, match="positive limit"):
        friction_ratio(0.1, 0.0)
    with pytest.raises(StictionError, match="positive gain"):
        dead_band(0.1, 0.0)
