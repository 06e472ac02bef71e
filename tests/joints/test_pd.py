"""The joint controller."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.joints.pd import PDGains, pd_torque


def test_torque_by_hand() -> None:
    """0.8 (20 (0.5 − 0.2) − 0.5 · 2) = 0.8 (6 − 1) = 4; with the paper's printed sign it would be −5.6."""
    gains = PDGains(20.0, 0.5, strength=0.8)
    assert pd_torque(gains, np.array(0.5), np.array(0.2), np.array(2.0)) == pytest.approx(4.0)


def test_the_motor_has_a_limit_in_both_directions() -> None:
    """Beyond the limit a motor gives the limit, not more."""
    gains = PDGains(100.0, 0.0, torque_limit=5.0)
    np.testing.assert_array_equal(pd_torque(gains, np.array([1.0, -1.0, 0.01]), np.zeros(3), np.zeros(3)), [5, -5, 1])


@pytest.mark.parametrize("bad", [{"kp": 0}, {"kd": -1}, {"torque_limit": 0}, {"strength": 0}, {"kp": float("nan")}])
def test_impossible_gains_are_refused(bad: dict) -> None:
    """A zero gain would divide by zero far from its cause."""
    with pytest.raises(StictionError, match="must be positive"):
        PDGains(**{"kp": 20.0, "kd": 0.5, **bad})
