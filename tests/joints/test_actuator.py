"""Inputs and output of an Actuator Net, by hand; its fit; and its analytic baseline."""

from dataclasses import replace

import numpy as np
import pytest

from actuators import pd_net
from stiction.core.errors import StictionError
from stiction.joints.net import (
    ActuatorCfg,
    ActuatorMemory,
    Baseline,
    first_signal,
    fit_baseline,
    perceptron,
    predict,
    windows,
)

GENERATOR = np.random.default_rng(0)


def test_a_window_by_hand() -> None:
    """H = 2 over five samples of one joint: three windows, newest first, errors before velocities."""
    target = np.full((5, 1), 10.0)
    position = np.array([[9.0], [8.0], [7.0], [6.0], [5.0]])
    velocity = np.array([[0.1], [0.2], [0.3], [0.4], [0.5]])
    errors = first_signal("default", target, position)
    inputs = windows(errors, velocity, 2)
    assert inputs.shape == (3, 1, 6)
    np.testing.assert_allclose(inputs[0, 0], [3.0, 2.0, 1.0, 0.3, 0.2, 0.1])
    np.testing.assert_allclose(inputs[2, 0], [5.0, 4.0, 3.0, 0.5, 0.4, 0.3])
    np.testing.assert_array_equal(first_signal("paper", target, position), position)


def test_a_perceptron_by_hand() -> None:
    """Two inputs (1, -3): hidden 1·2 + (-3)·1 + 0 = -1 and 1 + 0 + 1 = 2, softsign -1/2 and 2/3, output
    -1/2 + 3·2/3 - 1 = 1/2.
    """
    hidden = np.array([[2.0, 1.0], [1.0, 0.0]], np.float32), np.array([0.0, 1.0], np.float32)
    last = np.array([[1.0, 3.0]], np.float32), np.array([-1.0], np.float32)
    inputs = np.array([[1.0], [-3.0]], np.float32)
    np.testing.assert_allclose(perceptron((hidden, last), inputs), [0.5], rtol=1e-6)
    many = np.repeat(inputs, 7001, axis=1)
    np.testing.assert_allclose(perceptron((hidden, last), many), np.full(7001, 0.5), rtol=1e-6)


def test_step_by_step_is_the_same_as_all_at_once() -> None:
    """The simulation remembers samples one by one, the errors are of whole logs: one net must be one motor."""
    net = pd_net()
    mixed = tuple(((GENERATOR.standard_normal((1, 8)).astype(np.float32), bias),) for ((_, bias),) in net.layers)
    net = pd_net(layers=mixed)
    signals = [0.1 * GENERATOR.standard_normal((12, 18)) for _ in range(3)]
    memory = ActuatorMemory(net, 2)
    steps = [memory.torque(*(np.stack([s[t], s[11 - t]]) for s in signals)) for t in range(12)]
    limit = np.array(net.torque_limit)
    whole = predict(net, *signals)
    np.testing.assert_allclose(np.clip([step[0] for step in steps], -limit, limit)[3:], whole, rtol=1e-5, atol=1e-4)


def test_a_net_recovers_a_pd_law() -> None:
    """Samples of τ = 100 e - 2.5 θ', clipped at 25 N m: after some seconds the error is under 2 % of the limit, and
    the torque of a sample follows by hand: 100 · 0.1 - 2.5 · 2 = 5 N m. The paper's inputs lack the current velocity.
    """
    pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to fit a net")
    from stiction.learning.actuator import fit_net

    inputs = GENERATOR.uniform(-1, 1, (10_000, 4)) * np.repeat([0.3, 5.0], 2)
    torque = np.clip((100 * inputs[:, 0] - 2.5 * inputs[:, 2]) / 25, -1, 1)
    cfg = ActuatorCfg(history=1, epochs=40, batch=256, learning_rate=2e-2)
    fit = fit_net((inputs[:8000], torque[:8000]), (inputs[8000:], torque[8000:]), cfg, seed=0)
    assert fit.validation[-1] ** 0.5 < 0.02 and fit.training[0] > 10 * fit.training[-1]
    example = np.array([[0.1, 0.0, 2.0, 0.0]], np.float32).T
    np.testing.assert_allclose(25 * perceptron(fit.layers, example), [5.0], atol=0.8)
    blind = fit_net((inputs, torque), (inputs, torque), replace(cfg, inputs="paper", epochs=1), seed=0)
    assert not blind.layers[0][0][:, 2].any() and blind.layers[0][0][:, 3].all()
    inputs[:, 1] = 0.25  # An error that never changed in training: the net must not answer when it does.
    still = fit_net((inputs, torque), (inputs, torque), replace(cfg, epochs=1), seed=0)
    assert not still.layers[0][0][:, 1].any() and still.layers[0][0][:, 0].all()


def test_the_law_beside_it_finds_the_friction() -> None:
    """τ = kp e - kd θ' - f sign(θ') - B θ' with f = 2 N m and B = 0.5, at speeds above the ramp."""
    velocity = GENERATOR.choice([-1, 1], (500, 1)) * GENERATOR.uniform(0.1, 3.0, (500, 1))
    position, target = np.zeros((500, 1)), GENERATOR.uniform(-0.05, 0.05, (500, 1))
    torque = 100 * target - 2.5 * velocity - 2.0 * np.sign(velocity) - 0.5 * velocity
    gains = np.array([100.0]), np.array([2.5]), np.array([25.0])
    law = fit_baseline(gains, [(target, position, velocity, torque)])
    np.testing.assert_allclose([law.coulomb[0], law.viscous[0], law.later[0]], [2.0, 0.5, 0.0], atol=1e-6)
    np.testing.assert_allclose(law.torque(target, position, velocity), torque, atol=1e-9)
    limited = Baseline(*gains, np.array([2.0]), np.array([0.5]), np.array([1.0]))
    pushed = limited.torque(np.array([[1.0], [1.0]]), np.zeros((2, 1)), np.array([[1.0], [3.0]]))
    np.testing.assert_allclose(pushed[:, 0], [25.0 - 2.5, 25.0 - 3.5])


@pytest.mark.parametrize(
    "change",
    [
        {"inputs": "all"},
        {"share": "leg"},
        {"history": 0},
        {"hidden": (0,)},
        {"epochs": 0},
        {"learning_rate": 0.0},
        {"validation_share": 1.0},
        {"seed": -1},
    ],
)
def test_what_cannot_be_fitted_is_refused(change: dict) -> None:
    """One line before any log is read."""
    with pytest.raises(StictionError, match="expected"):
        ActuatorCfg(**change)
