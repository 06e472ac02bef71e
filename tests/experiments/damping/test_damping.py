"""B and k kd as one number, where that holds and where it does not."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.joints.friction import Coulomb, Stribeck
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Joint, Trajectory, simulate
from stiction_experiments.damping.sampled import fit_net, largest_difference, output_torque, swapped, total_damping

STEP = 0.0005
JOINT = Joint(0.0145, 0.0704, Coulomb(0.442))
GAINS = PDGains(100.0, 2.5, strength=0.9)
TARGET = 0.3 * np.sin(2 * np.pi * 2.0 * STEP * np.arange(2000))


def test_a_swap_keeps_the_sum_and_moves_what_it_says() -> None:
    """0.9 N m s/rad less of k kd is 1.0 less of kd at k = 0.9, and 0.9 more of B."""
    joint, gains = swapped(JOINT, GAINS, 0.9)
    assert joint.viscous == pytest.approx(0.9704)
    assert gains.kd == pytest.approx(1.5)
    assert total_damping(joint, gains) == pytest.approx(0.0704 + 0.9 * 2.5) == total_damping(JOINT, GAINS)


@pytest.mark.parametrize("moved", [-0.08, 2.26])
def test_what_neither_has_cannot_be_moved(moved: float) -> None:
    """A negative kd or B would be another joint, not a swap."""
    with pytest.raises(StictionError, match="expected at least"):
        swapped(JOINT, GAINS, moved)


@pytest.mark.parametrize("friction", [Coulomb(0.0), Coulomb(9.0), Stribeck(0.4, 0.8, 0.5)])
def test_no_friction_law_of_speed_tells_them_apart(friction) -> None:
    """With any f(θ') the motion is the same; the motor's torque differs by what was moved times the speed."""
    joint = Joint(0.0145, 0.0704, friction)
    before = simulate(joint, GAINS, STEP, TARGET)
    after = simulate(*swapped(joint, GAINS, 2.25), STEP, TARGET)
    difference = largest_difference(before, after)
    assert np.ptp(before.position) > 0.1
    assert difference.position < 1e-10
    assert difference.torque == pytest.approx(2.25 * np.abs(before.velocity).max(), rel=1e-6)


def test_at_the_torque_limit_the_derivative_gain_is_cut_and_viscous_friction_is_not() -> None:
    """A motor at its limit of 5 N m drives 0.0145 kg m² at 5/I without B, and less with B, whatever kd asks for."""
    target, bare = np.full(9, 10.0), Joint(0.0145, 0.0, Coulomb(0.0))
    gains = PDGains(100.0, 2.5, torque_limit=5.0)
    kept = simulate(bare, gains, STEP, target)
    moved = simulate(*swapped(bare, gains, 2.5), STEP, target)
    time = STEP * np.arange(9)
    np.testing.assert_allclose(kept.velocity, 5.0 / 0.0145 * time, rtol=1e-9)
    np.testing.assert_allclose(moved.velocity, 2.0 * -np.expm1(-2.5 / 0.0145 * time), rtol=1e-9, atol=1e-12)


def test_a_net_learns_kd_from_the_motor_and_the_sum_from_the_output() -> None:
    """Motor-side logs teach k kp and k kd, output-side logs k kp and B + k kd: the log decides."""
    joint = Joint(0.0145, 0.0704, Coulomb(0.0))
    made = simulate(joint, GAINS, STEP, TARGET)
    motor = fit_net(TARGET - made.position, made.velocity, made.torque)
    output = fit_net(TARGET - made.position, made.velocity, output_torque(joint, made))
    assert (motor.stiffness, motor.damping) == pytest.approx((90.0, 2.25))
    assert (output.stiffness, output.damping) == pytest.approx((90.0, 2.25 + 0.0704))


def test_output_torque_is_what_accelerates() -> None:
    """τ − B θ' ∓ f by hand, and nothing while the joint sticks."""
    joint = Joint(0.01, 0.5, Coulomb(0.4))
    made = Trajectory(np.zeros(3), np.array([2.0, -2.0, 0.0]), np.array([3.0, 3.0, 0.3]))
    np.testing.assert_allclose(output_torque(joint, made), [3 - 1 - 0.4, 3 + 1 + 0.4, 0.0])
    with pytest.raises(StictionError, match="expected Coulomb"):
        output_torque(Joint(0.01, 0.5, Stribeck(0.1, 0.2, 0.3)), made)
