"""Fisher information of the closed loop against what can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.identification.excite.fisher import information, sensitivities
from stiction.identification.excite.setup import ExciteSetup
from stiction.joints.pd import PDGains

JOINT = np.array([0.0145, 0.07, 0.44, 0.0])
GAINS = PDGains(20.0, 0.5)
RATE = 250.0


def ramp(speed: float) -> np.ndarray:
    """Return a target that moves at an even speed [rad/s] for two seconds, shape (500,)."""
    return speed * np.arange(500) / RATE


def swing(frequency: float, amplitude: float = 0.4, seconds: float = 8.0) -> np.ndarray:
    """Return one sine."""
    return amplitude * np.sin(2 * np.pi * frequency * np.arange(round(seconds * RATE)) / RATE)


def test_a_ramp_has_the_sensitivities_of_statics() -> None:
    """At an even speed v: kp (a − θ) = (B + kd) v + f + offset, so ∂θ/∂f = −1/kp, ∂θ/∂B = −v/kp, and ∂τ/∂f = 1."""
    speed = 0.5
    slopes = sensitivities(JOINT, GAINS, 1 / RATE, ramp(speed))[:, :, -1]
    assert slopes[:, 0] == pytest.approx([0.0, -speed / 20, -1 / 20, -1 / 20], abs=1e-6)
    assert slopes[:, 1] == pytest.approx([0.0, speed, 1.0, 1.0], abs=1e-4)


def test_an_encoder_counts_as_noise_of_its_step_over_the_root_of_twelve() -> None:
    """3-4-5: noise 3e-4 and a step of 4e-4 √12 are 5e-4 together."""
    assert ExciteSetup(noise_position=3e-4, resolution=4e-4 * 12**0.5).position_std == pytest.approx(5e-4)


def test_positions_alone_are_about_combinations() -> None:
    """B and k kd have one sum: the positions tell their sum alone, under its own name."""
    blind = information(JOINT, GAINS, 1 / RATE, swing(0.5), (1e-4, None))
    assert blind.names[1] == "(viscous_friction+k*kd)/k" and blind.values[1] == pytest.approx(0.57)
    assert blind.names[2] == "coulomb_friction/k" and blind.values[2] == 0.44


def test_a_joint_that_never_moves_tells_nothing() -> None:
    """A joint at rest has infinite deviations without an error: a search meets such motions."""
    held = information(JOINT, GAINS, 1 / RATE, swing(0.5, amplitude=0.01), (1e-4, 0.05))
    assert np.isinf(held.worst) and held.d_criterion == np.inf


def test_gravity_can_be_told_from_an_offset() -> None:
    """Two more parameters, known to less than a tenth, in a motion of ±1 rad; the sum of the others' stays finite."""
    values = np.array([0.02, 0.07, 0.2, 0.0, 1.0, 0.3])
    info = information(values, GAINS, 1 / RATE, swing(0.5, 1.0), (1e-4, 0.05))
    assert info.names[4:] == ("gravity_sin", "gravity_cos")
    assert (info.std[4:] < 0.1 * values[4:]).all() and np.isfinite(info.covariance).all()
