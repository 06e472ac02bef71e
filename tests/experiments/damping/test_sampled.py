"""A PD controller that holds its torque, against solutions that are known."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.joints.friction import Coulomb, Stribeck
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Joint, simulate
from stiction_experiments.damping.sampled import Sampling, growth, hold, simulate_sampled


def test_a_held_torque_stops_turns_and_goes_on_inside_one_period() -> None:
    """Without viscosity: 1 rad/s against (−0.2 − 0.1)/0.01 = −30 rad/s² stops after 1/30 s, then −10 rad/s² back."""
    joint = Joint(0.01, 0.0, Coulomb(0.1))
    position, velocity = hold(joint, -0.2, 0.1, (0.0, 1.0), 0.1)
    left = 0.1 - 1 / 30
    assert velocity == pytest.approx(-10.0 * left)
    assert position == pytest.approx(1 / 60 - 5.0 * left**2)
    assert hold(joint, -0.1, 0.1, (0.0, 1.0), 0.1) == pytest.approx((1 / 40, 0.0))


def test_viscous_decay_under_a_held_torque_is_exact() -> None:
    """θ' = τ/B (1 − exp(−B t/I)), at any B; a stop under B comes at I/B ln(1 + B θ'/f)."""
    joint = Joint(0.01, 0.05, Coulomb(0.0))
    position, velocity = hold(joint, 0.1, 0.0, (0.0, 0.0), 0.3)
    assert velocity == pytest.approx(2.0 * -np.expm1(-1.5))
    assert position == pytest.approx(2.0 * (0.3 + 0.2 * np.expm1(-1.5)))
    moment = 0.2 * np.log(1 + 0.05 * 3.0 / 0.2)
    before, after = (hold(joint, 0.0, 0.2, (0.0, 3.0), moment + late)[1] for late in (-1e-6, 1e-6))
    assert 0.0 < before < 1e-4 and after == 0.0


def test_fast_sampling_is_the_pd_law() -> None:
    """At 10 µs the sampled joint does what the exact one does, stick and slip included."""
    joint, gains, step = Joint(0.0145, 0.07, Coulomb(4.5)), PDGains(100.0, 2.5, torque_limit=20.0), 1e-5
    target = 0.3 * np.sin(4 * np.pi * step * np.arange(50_000))
    made, exact = simulate_sampled(joint, gains, Sampling(step), target), simulate(joint, gains, step, target)
    assert (exact.velocity == 0).mean() > 0.05
    assert np.abs(made.position - exact.position).max() < 2e-5


def test_a_late_derivative_gain_takes_inertia_off() -> None:
    """Held and late by a period, kd acts as −kd 1.5 T of inertia; kp, held, takes kp T/2 off the damping."""
    joint, gains, period = Joint(0.0145, 0.07, Coulomb(0.0)), PDGains(100.0, 2.0), 2e-4
    target = 0.3 * np.sin(4 * np.pi * period * np.arange(5000))
    made = simulate_sampled(joint, gains, Sampling(period, late=1), target)
    felt = Joint(0.0145 - 2.0 * 1.5 * period, 0.07 - 100.0 * 0.5 * period, Coulomb(0.0))
    delayed = np.interp(np.arange(5000) - 0.5, np.arange(5000), target)
    model = simulate(felt, gains, period, delayed)
    plain = simulate(joint, gains, period, delayed)
    gap, naive = (np.abs(made.position - other.position).max() for other in (model, plain))
    assert gap < 0.15 * naive


def test_growth_is_what_the_simulation_does() -> None:
    """The radius that is computed is the factor by which the simulated loop, filtered and late, runs away."""
    joint, gains = Joint(0.0145, 0.0, Coulomb(0.0)), PDGains(100.0, 2.5)
    sampling = Sampling(0.008, late=1, cutoff=60.0)
    made = simulate_sampled(joint, gains, sampling, np.where(np.arange(400) == 0, 1e-6, 0.0))
    size = np.hypot(made.position, 0.01 * made.velocity)
    early, last = size[100:200].max(), size[300:400].max()
    assert growth(joint, gains, sampling) == pytest.approx((last / early) ** (1 / 200), rel=2e-3)


def test_a_filter_passes_a_share_of_the_newest_velocity() -> None:
    """The first torque after a sudden speed shows 1 − exp(−2π f T) of it."""
    joint, gains = Joint(1.0, 0.0, Coulomb(0.0)), PDGains(1.0, 1.0)
    sampling = Sampling(0.01, cutoff=10.0)
    made = simulate_sampled(joint, gains, sampling, np.array([100.0, 0.0]))
    share = 1 - np.exp(-0.2 * np.pi)
    assert made.velocity[1] == pytest.approx(1.0)
    assert made.torque[1] == pytest.approx(-made.position[1] - share * 1.0)


def test_effort_adds_friction_with_the_torque() -> None:
    """0.1 + 0.5 of 2 N m holds against 1 N m of push but not against 2: 2 − 1.1 N m are left."""
    joint, gains = Joint(1.0, 0.0, Coulomb(0.1)), PDGains(1.0, 0.0)
    made = simulate_sampled(joint, gains, Sampling(0.1), np.array([2.0, 2.0]), effort=0.5)
    assert made.velocity[1] == pytest.approx(0.09)
    assert simulate_sampled(joint, gains, Sampling(0.1), np.full(3, 2.0), effort=0.96).velocity[2] == 0.0


def test_what_is_not_simulated_is_refused() -> None:
    """A Stribeck law taken as Coulomb's would be wrong without a word."""
    with pytest.raises(StictionError, match="Coulomb"):
        simulate_sampled(Joint(1.0, 0.0, Stribeck(0.1, 0.2, 0.3)), PDGains(1.0, 0.0), Sampling(0.1), np.zeros(2))
    with pytest.raises(StictionError, match="positive period"):
        Sampling(0.0)
