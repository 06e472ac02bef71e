"""Does output error waste information? Its variance over many logs against the Cramér–Rao bound."""

from __future__ import annotations

import numpy as np
import pytest

from counts import count
from shanks import GO1
from stiction.identification.checks import Uniform
from stiction.identification.closed_loop import ClosedLoop
from stiction.identification.example import SATURN_LITE, Excitation, Motor, SensorNoise, example_log
from stiction.identification.model import Model
from stiction.identification.output_error import fit_output_error
from stiction.joints.friction import Coulomb
from stiction.joints.simulate import simulate

LOGS, LARGEST_RATIO, LARGEST_BIAS = count(50, 500), 1.0 + 0.01 * count(45, 20), 0.01 * count(40, 20)
"""The variance of 500 logs is known to within 6.3 %, their mean to 0.045 deviations; of 50 to 20 % and 0.14."""

POSITION_NOISE, TORQUE_NOISE = 1e-3, 0.05
"""Standard deviations of the white noise [rad, N m]."""

SHORT = Excitation(duration=3.0, rate=250.0)

BEGIN = 125
"""First sample that is used: the joint is in full motion, and nobody knows its state."""


def part(position: np.ndarray, torque: np.ndarray | None, target: np.ndarray) -> Uniform:
    """Return a log from sample `BEGIN` on."""
    step = 1 / SHORT.rate
    torque = None if torque is None else torque[BEGIN:]
    return Uniform(np.arange(len(target) - BEGIN) * step, step, position[BEGIN:], torque, target[BEGIN:], None)


@pytest.mark.slow
@pytest.mark.parametrize("with_torque", [True, False], ids=["position_and_torque", "position"])
@pytest.mark.parametrize("motor", [GO1, SATURN_LITE], ids=lambda motor: motor.name)
def test_the_variance_is_that_of_the_bound(motor: Motor, with_torque: bool) -> None:
    """White noise of known size, the first sample's state unknown; the bound is from the sensitivities at the truth."""
    model, joint, target = Model(), motor.joint, SHORT.target()[1]
    assert isinstance(joint.friction, Coulomb)
    made = simulate(joint, motor.gains, 1 / SHORT.rate, target, float(target[0]))
    truth = dict(zip(model.names, (joint.inertia, joint.viscous, joint.friction.level, joint.offset)))
    state = {"start_position": made.position[BEGIN], "start_velocity": made.velocity[BEGIN]}
    loop = ClosedLoop(part(made.position, made.torque, target), motor.gains, model, {})
    slopes = loop.derivatives(loop.run(truth | state), truth | state, (*truth, *state))
    information = slopes[0].T @ slopes[0] / POSITION_NOISE**2
    if with_torque:
        information += slopes[1].T @ slopes[1] / TORQUE_NOISE**2
    bound = np.diag(np.linalg.inv(information))[: len(truth)]
    noise = SensorNoise.white(POSITION_NOISE, TORQUE_NOISE)
    found = []
    for seed in range(LOGS):
        log = example_log(motor, SHORT, noise, seed=seed).joints["shank"]
        assert log.position is not None
        signals = part(log.position, log.torque if with_torque else None, target)
        start = {name: 1.1 * value for name, value in truth.items()}
        fit = fit_output_error(signals, motor.gains, model, start, made.velocity[BEGIN:])
        assert fit.unidentified == ()
        found.append([fit.estimates[name].value for name in model.names])
    ratio = np.var(found, axis=0, ddof=1) / bound
    bias = (np.mean(found, axis=0) - list(truth.values())) / np.sqrt(bound)
    print(dict(zip(model.names, ratio.round(3))))
    assert np.all(ratio < LARGEST_RATIO), dict(zip(model.names, ratio))
    assert np.all(np.abs(bias) < LARGEST_BIAS), dict(zip(model.names, bias))
