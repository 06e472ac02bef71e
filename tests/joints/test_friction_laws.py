"""Simulated joints with each friction law, under load and gravity, against hand-computed values and small steps."""

from __future__ import annotations

import numpy as np
import pytest

from small_steps import STEP, Size, small_steps
from stiction.core.errors import StictionError
from stiction.joints.friction import Asymmetric, Coulomb, Stribeck
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Gravity, Joint, simulate

TIME = STEP * np.arange(500)
GAINS = PDGains(20.0, 0.5, 45.0)
WEAK = PDGains(1e-9, 0.0)
"""A controller that does nothing."""

CASES: dict[str, tuple[Joint, Size]] = {
    "asymmetric": (
        Joint(0.0145, 0.0, Asymmetric(0.5, 0.3, 0.04, 0.1)),
        lambda direction, speed, load, angle: 0.5 + 0.04 * speed if direction > 0 else 0.3 + 0.1 * speed,
    ),
    "stribeck": (
        Joint(0.0145, 0.0704, Stribeck(0.3, 0.5, 0.4), -0.05),
        lambda direction, speed, load, angle: 0.3 + 0.2 * np.exp(-((speed / 0.4) ** 2)),
    ),
    "load": (
        Joint(0.0145, 0.0704, Coulomb(0.2, 0.1), 0.02),
        lambda direction, speed, load, angle: 0.2 + 0.1 * abs(load),
    ),
    "load_and_gravity": (
        Joint(0.02, 0.07, Coulomb(0.2, 0.1), 0.02, Gravity(2.5, -0.8)),
        lambda direction, speed, load, angle: 0.2 + 0.1 * abs(load),
    ),
    "stribeck_and_gravity": (
        Joint(0.02, 0.07, Stribeck(0.1, 0.3, 0.2), 0.02, Gravity(2.5, 1.5)),
        lambda direction, speed, load, angle: 0.1 + 0.2 * np.exp(-((speed / 0.2) ** 2)),
    ),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("limit", [45.0, 2.5])
def test_each_law_agrees_with_small_steps(name: str, limit: float) -> None:
    """Steps of 1e-5 s of another method, under a load that jumps; the Gaussian is a chain of secants here only."""
    joint, size = CASES[name]
    target = 0.4 * np.sin(4 * np.pi * TIME) + 0.2 * np.sin(22 * TIME)
    load = np.where(TIME < 0.4, 0.0, 1.2) + 0.5 * np.sin(9 * TIME)
    gains = PDGains(20.0, 0.5, limit)
    made = simulate(joint, gains, STEP, target, load=load)
    position, velocity = small_steps(joint, gains, target, size, load)
    assert np.abs(made.position - position).max() < 2e-3 * np.abs(position).max()
    assert np.abs(made.velocity - velocity).max() < 6e-3 * np.abs(velocity).max()


def test_secants_stay_within_one_percent_of_the_gaussian() -> None:
    """With f = 0.3 + 0.2 exp(−(v/0.4)²): b_s at rest, b_c at high speed, and 0.002 N m off at most in between."""
    law, speed = Stribeck(0.3, 0.5, 0.4), np.linspace(1e-6, 3.0, 4000)
    gaussian = 0.3 + 0.2 * np.exp(-((speed / 0.4) ** 2))
    for way in (1, -1):
        pieces = law.pieces(way)
        starts, levels, slopes = np.array(pieces).T
        piece = np.searchsorted(starts, speed, "right") - 1
        assert np.abs(levels[piece] + slopes[piece] * speed - gaussian).max() < 0.01 * 0.2
        assert pieces[0].level == 0.5 and pieces[-1].level == pytest.approx(0.3) and pieces[-1].slope == 0.0


def test_an_asymmetric_joint_coasts_further_where_friction_is_less() -> None:
    """From ±2 rad/s without viscosity: v²/(2 f/I) = 0.2 rad under 0.1 N m forward, 0.4 rad under 0.05 N m backward."""
    joint = Joint(0.01, 0.0, Asymmetric(0.1, 0.05))
    forward = simulate(joint, WEAK, STEP, np.zeros(500), velocity=2.0)
    backward = simulate(joint, WEAK, STEP, np.zeros(500), velocity=-2.0)
    assert forward.position[-1] == pytest.approx(0.2, rel=1e-6)
    assert backward.position[-1] == pytest.approx(-0.4, rel=1e-6)


def test_static_friction_lets_go_with_a_jerk() -> None:
    """Held to b_s = 0.5 N m; once it slides friction falls to 0.1, so it overshoots where Coulomb friction would not.

    A creeping target makes it stick and slip: it must come to rest again and again, and break away each time at 0.5.
    """
    joint, gains = Joint(0.01, 0.02, Stribeck(0.1, 0.5, 0.05)), PDGains(10.0, 0.1)
    target = 0.1 * STEP * np.arange(5000)
    made = simulate(joint, gains, STEP, target)
    assert np.flatnonzero(made.velocity)[0] == 251
    resting = made.velocity == 0
    starts = np.flatnonzero(resting[1:-1] & ~resting[2:]) + 1
    assert len(starts) > 5 and 0.2 < resting.mean() < 0.99
    pulls = gains.kp * (target[starts] - made.position[starts])
    assert np.all(pulls <= 0.5) and np.all(pulls > 0.5 - 2 * gains.kp * 0.1 * STEP)


def test_a_load_step_moves_what_friction_does_not_hold() -> None:
    """At kp 10, f 0.4: 0.3 N m from outside moves nothing; 1.0 N m until the spring and friction hold it, at 0.06 rad.

    Without overshoot (kd 1 over I 0.01 is overdamped) it creeps up to (1.0 − 0.4)/10 from below.
    """
    joint, gains = Joint(0.01, 0.0, Coulomb(0.4)), PDGains(10.0, 1.0)
    made = simulate(joint, gains, STEP, np.zeros(1500), load=np.where(np.arange(1500) < 200, 0.3, 1.0))
    assert np.all(made.position[:200] == 0.0)
    assert made.position[-1] == pytest.approx(0.06, abs=1e-6)
    assert made.torque[-1] == pytest.approx(-0.6, abs=1e-5)


def test_load_dependent_friction_holds_more_under_load() -> None:
    """b_c 0.1 and c 0.2: a load of 1.0 N m raises the break-away to 0.3, so from 0.8 of pull nothing is seen before it.

    The outside torque of 1.0 is balanced by the target's −0.1 rad at kp 10; the pull then grows by 10 N m/s.
    """
    joint, gains = Joint(0.01, 0.1, Coulomb(0.1, 0.2)), PDGains(10.0, 0.0)
    made = simulate(joint, gains, STEP, -0.1 + TIME[:40], load=np.ones(40))
    assert np.flatnonzero(made.velocity)[0] == 16


def test_a_pendulum_hangs_where_the_motor_holds_it() -> None:
    """2 sin θ + 0.5 cos θ N m under kp 20, target 0.5 rad, no friction: θ solves 20 (0.5 − θ) = 2 sin θ + 0.5 cos θ."""
    gravity = Gravity(2.0, 0.5)
    made = simulate(Joint(0.02, 0.1, Coulomb(0.0), 0.0, gravity), PDGains(20.0, 1.0), STEP, np.full(3000, 0.5))
    held = made.position[-1]
    assert 20 * (0.5 - held) == pytest.approx(float(gravity.torque(held)), abs=1e-6)
    assert made.torque[-1] == pytest.approx(float(gravity.torque(held)), abs=1e-6)


def test_a_free_pendulum_keeps_its_energy() -> None:
    """Released at 1 rad without friction or control, ½ I θ'² − 2 cos θ stays what it was, there and back."""
    joint = Joint(0.05, 0.0, Coulomb(0.0), 0.0, Gravity(2.0))
    made = simulate(
        joint, PDGains(1e-3, 0.0), 5e-4, np.zeros(2000), position=1.0, guess=np.cos(6.0 * np.arange(2000) * 5e-4)
    )
    energy = 0.5 * joint.inertia * made.velocity**2 - 2.0 * np.cos(made.position) + 0.5e-3 * made.position**2
    np.testing.assert_allclose(energy, energy[0], atol=2e-4)
    assert made.position.min() < -0.99 and made.velocity[-1] > 1.0


@pytest.mark.parametrize("law", [Coulomb(0.05), Asymmetric(0.05, 0.08), Stribeck(0.03, 0.08, 0.1)])
def test_no_law_adds_energy(law: Coulomb | Asymmetric | Stribeck) -> None:
    """Released from 0.3 rad at target zero, kinetic and spring energy together never grow, and it comes to rest."""
    joint, gains = Joint(0.01, 0.0, law), PDGains(5.0, 0.0)
    made = simulate(joint, gains, STEP, np.zeros(2000), position=0.3)
    energy = 0.5 * joint.inertia * made.velocity**2 + 0.5 * gains.kp * made.position**2
    assert np.all(np.diff(energy) <= 1e-12)
    assert made.velocity[-1] == 0.0 and abs(gains.kp * made.position[-1]) <= 0.08


def test_impossible_laws_are_refused() -> None:
    """Negative or undefined friction would drive the joint; a load of another length is not this log's."""
    for make in (
        lambda: Asymmetric(-0.1, 0.1),
        lambda: Asymmetric(0.1, 0.1, float("nan")),
        lambda: Stribeck(0.1, 0.2, 0.0),
        lambda: Coulomb(0.1, -1.0),
        lambda: Gravity(float("nan")),
    ):
        with pytest.raises(StictionError, match="expected"):
            make()
    with pytest.raises(StictionError, match="load of shape"):
        simulate(Joint(0.01, 0.1, Coulomb(0.1)), GAINS, STEP, np.zeros(10), load=np.zeros(9))
