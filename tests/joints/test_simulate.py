"""One simulated joint against solutions that are known."""

from __future__ import annotations

import numpy as np
import pytest

from small_steps import STEP, small_steps
from stiction.core.errors import StictionError
from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Joint, simulate

WEAK = PDGains(kp=1e-9, kd=0.0)
"""A controller that does nothing."""


def test_coasting_stops_where_theory_says() -> None:
    """Without viscosity a joint with 2 rad/s and f/I = 10 rad/s² stops after 0.2 s and 0.2 rad, and stays there."""
    joint = Joint(0.01, 0.0, Coulomb(0.1))
    made = simulate(joint, WEAK, STEP, np.zeros(300), velocity=2.0)
    assert made.velocity[99] == pytest.approx(2.0 - 10 * 99 * STEP, rel=1e-6)
    np.testing.assert_allclose(made.position[101:], 0.2, rtol=1e-6)
    assert np.all(made.velocity[101:] == 0.0)


def test_viscous_decay_is_exact() -> None:
    """Speed is v0 exp(−B t / I), whatever the step."""
    joint = Joint(0.01, 0.05, Coulomb(0.0))
    made = simulate(joint, WEAK, STEP, np.zeros(200), velocity=1.0)
    np.testing.assert_allclose(made.velocity, np.exp(-5 * STEP * np.arange(200)), rtol=1e-6)


def test_it_holds_at_90_percent_and_breaks_away_when_the_pull_reaches_friction() -> None:
    """A target that creeps at 1 rad/s under kp 10 reaches f = 0.4 after 0.04 s; nothing moves before, at all."""
    joint = Joint(0.01, 0.1, Coulomb(0.4))
    made = simulate(joint, PDGains(10.0, 0.0), STEP, STEP * np.arange(100))
    assert np.all(made.velocity[:21] == 0.0) and np.all(made.position[:21] == 0.0)
    assert np.all(made.velocity[21:60] > 0.0)
    held = simulate(joint, PDGains(10.0, 0.0), STEP, np.full(5000, 0.036))
    assert np.all(held.position == 0.0)
    np.testing.assert_allclose(held.torque, 0.36)


def test_break_away_inside_a_sample_is_exact() -> None:
    """The pull, 10 t, passes 0.405 at t = 0.0405 s; then v' ≈ (10 (t − 0.0405)) / I, so v = 500 (t − 0.0405)²."""
    joint = Joint(0.01, 0.0, Coulomb(0.405))
    made = simulate(joint, PDGains(10.0, 0.0), STEP, STEP * np.arange(30))
    assert made.velocity[21] == pytest.approx(500 * 0.0015**2, rel=1e-3)


@pytest.mark.parametrize(
    ("joint", "gains", "amplitude"),
    [
        (Joint(0.0121, 0.0342, Coulomb(0.0481), 0.01), PDGains(20.0, 0.5, 35.55), 0.6),
        (Joint(0.0145, 0.0704, Coulomb(0.442), -0.05), PDGains(20.0, 0.5, 45.0), 0.5),
        (Joint(0.0145, 0.0704, Coulomb(0.442)), PDGains(20.0, 0.5), 0.05),
        (Joint(0.0145, 0.0704, Coulomb(0.442)), PDGains(20.0, 0.5, 2.0), 0.5),
    ],
    ids=["go1", "saturn_lite", "mostly_stuck", "saturated"],
)
def test_it_agrees_with_small_steps(joint: Joint, gains: PDGains, amplitude: float) -> None:
    """A sine of the target against 200 times smaller steps of another method, within that method's own error."""
    target = amplitude * np.sin(4 * np.pi * STEP * np.arange(500))
    made = simulate(joint, gains, STEP, target)
    position, velocity = small_steps(joint, gains, target, lambda *_: joint.friction.level)
    assert np.abs(made.position - position).max() < 2e-3 * np.abs(position).max()
    assert np.abs(made.velocity - velocity).max() < 5e-3 * np.abs(velocity).max()


def test_nonsense_is_refused() -> None:
    """NaN in a target must not come out as NaN in a fit."""
    with pytest.raises(StictionError, match="finite samples"):
        simulate(Joint(0.01, 0.1, Coulomb(0.1)), WEAK, STEP, np.array([0.0, np.nan]))
    with pytest.raises(StictionError, match="positive inertia"):
        Joint(0.0, 0.1, Coulomb(0.1))
