"""Derivatives of a simulated motion by each parameter, against differences of two simulations."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.identify.model import LAWS, Law, Model
from stiction.identify.sensitivity import parameter_torques, strength_torque
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Trajectory, simulate
from stiction.joints.variation import course, vary

STEP = 0.002
TIME = STEP * np.arange(1500)
TARGET = 0.4 * np.sin(np.pi * TIME) + 0.3 * np.sin(4 * np.pi * TIME)
LOAD = 0.5 * np.sin(9 * TIME)
TRUTH = {
    "inertia": 0.0145,
    "viscous_friction": 0.07,
    "viscous_friction_forward": 0.07,
    "viscous_friction_backward": 0.09,
    "coulomb_friction": 0.3,
    "coulomb_friction_forward": 0.44,
    "coulomb_friction_backward": 0.34,
    "offset": -0.05,
    "static_friction": 0.5,
    "stribeck_velocity": 0.4,
    "load_coefficient": 0.1,
    "position_slope": 0.2,
    "position_curvature": 0.3,
    "gravity_sin": 2.0,
    "gravity_cos": 0.5,
}


@pytest.mark.parametrize("limit", [45.0, 1.6], ids=["free", "saturated"])
@pytest.mark.parametrize("gravity", [False, True], ids=["upright", "gravity"])
@pytest.mark.parametrize("law", LAWS)
def test_derivatives_agree_with_differences(law: Law, gravity: bool, limit: float) -> None:
    """Every parameter, the start and the motor's strength; over events, reversals and, at 1.6 N m, saturation."""
    model = Model(law, gravity)
    values = {name: TRUTH[name] for name in model.names} | {"position": 0.05, "velocity": 1.0, "strength": 1.0}

    def run(values: dict[str, float], guess: np.ndarray | None = None) -> Trajectory:
        joint = model.joint([values[name] for name in model.names])
        gains = PDGains(20.0, 0.5, limit, values["strength"])
        return simulate(joint, gains, STEP, TARGET, values["position"], values["velocity"], LOAD, guess)

    made, gains = run(values), PDGains(20.0, 0.5, limit)
    joint = model.joint([values[name] for name in model.names])
    cut = course(joint, gains, STEP, TARGET, made, LOAD)
    torques = parameter_torques(model, values, joint, cut)
    start = np.zeros((2, len(values)))
    start[:, len(model.names) : len(model.names) + 2] = np.eye(2)
    nothing = np.zeros_like(cut.load)
    every = np.stack([*torques.values(), nothing, nothing, strength_torque(gains, cut)], axis=2)
    found = vary(joint, gains, cut, every, start)
    assert (np.abs(made.torque) >= limit).any() == (limit == 1.6)
    for index, name in enumerate(values):
        small = 2e-5 * abs(values[name])
        there, here = (run(values | {name: values[name] + way * small}, made.position) for way in (1, -1))
        for row, signal in enumerate(("position", "velocity")):
            expected = (getattr(there, signal) - getattr(here, signal)) / (2 * small)
            error = np.linalg.norm(found[row, :, index] - expected) / np.linalg.norm(expected)
            assert error < 0.02, (name, signal, error)


def test_a_joint_that_never_moves_depends_on_its_start_alone() -> None:
    """Friction holds: no parameter changes anything, and a change of the start stays as it is."""
    model = Model()
    joint = model.joint([0.01, 0.1, 5.0, 0.0])
    gains = PDGains(20.0, 0.5)
    made = simulate(joint, gains, STEP, 0.1 * TARGET)
    cut = course(joint, gains, STEP, 0.1 * TARGET, made)
    torques = parameter_torques(model, {}, joint, cut)
    start = np.zeros((2, 4))
    start[0, 0] = 1.0
    found = vary(joint, gains, cut, np.stack([*torques.values()], axis=2), start)
    np.testing.assert_array_equal(found[0, :, 0], 1.0)
    np.testing.assert_array_equal(found[:, :, 1:], 0.0)
