"""Dry friction at rest and in motion."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.formats.errors import StictionError
from stiction.joints.friction import Coulomb, dead_band, friction_ratio, friction_torque


def test_friction_brakes_in_motion_and_holds_at_rest() -> None:
    """In motion ∓0.4; at rest it cancels 0.3 and holds back 0.4 of 1.0: sign(v) alone would give 0 at rest."""
    velocity = np.array([2.0, -0.1, 0.0, 0.0, 0.0])
    applied = np.array([9.0, 9.0, 0.3, 1.0, -1.0])
    np.testing.assert_allclose(friction_torque(Coulomb(0.4), velocity, applied), [-0.4, 0.4, -0.3, -0.4, 0.4])


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
