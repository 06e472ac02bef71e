"""Do 95 % intervals hold the truth in 95 % of logs? Simulated logs: noise in the loop, stairs, jitter."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from counts import count
from shanks import GO1
from stiction.files.joints import PARAMETERS, Estimate
from stiction.files.log import Log
from stiction.identification.example import SATURN_LITE, Excitation, Motor, SensorNoise, example_log
from stiction.identification.in_loop import fit_in_loop
from stiction.identification.regression import fit_rows
from stiction.identification.runs import make_run
from stiction.identification.setup import IdentifySetup

LOGS = count(40, 300)
"""Logs a motor."""

MARGIN = (300 / LOGS) ** 0.5
"""Binomial spread, 1.3 % for 300 logs, over that."""

FIRST_SEED = 1000
"""The filter's defaults were chosen on seeds below 60; these logs had no part in it."""

SINE = Excitation(amplitudes=(0.6,), frequencies=(1.5,), duration=10.0)
"""The paper's excitation."""

NOISE = SensorNoise(jitter=0.02)
"""The example's noise and encoder steps, and samples taken up to some 2 % of a step off their time."""


@cache
def logged(motor: Motor, seed: int) -> Log:
    """Return a log, the same with its torque and without."""
    return example_log(motor, SINE, NOISE, seed)


def estimates(motor: Motor, seed: int, torque: bool) -> dict[str, dict[str, Estimate]]:
    """Return estimator -> estimates on one log; without torque, output error alone, in units of k = 1."""
    log = logged(motor, seed)
    if not torque:
        log = replace(log, joints={name: replace(one, torque=None) for name, one in log.joints.items()})
    run = make_run(log, None, IdentifySetup())
    fit = fit_rows(run.rows, run.model)
    simulated = fit_in_loop(run, fit)
    assert simulated is not None
    if not torque:
        return {"output error": simulated.estimates}
    return {"output error": simulated.estimates, "regression": fit.estimates()}


@pytest.mark.slow
@pytest.mark.parametrize("torque", [True, False], ids=["torque", "position_only"])
@pytest.mark.parametrize("motor", [GO1, SATURN_LITE], ids=lambda motor: motor.name)
def test_intervals_of_the_stated_estimators_cover_the_truth(motor: Motor, torque: bool) -> None:
    """Coverage of 300 logs is between 90 and 98 % for each parameter."""
    joint = motor.joint
    truth = (joint.inertia, joint.viscous, joint.friction.level, joint.offset)
    hits: dict[str, np.ndarray] = {}
    for seed in range(FIRST_SEED, FIRST_SEED + LOGS):
        for method, result in estimates(motor, seed, torque).items():
            inside = [
                result[name].interval95[0] < true < result[name].interval95[1]
                for name, true in zip(PARAMETERS, truth, strict=True)
            ]
            hits[method] = hits.get(method, np.zeros(len(PARAMETERS))) + inside
    coverage = {method: dict(zip(PARAMETERS, (count / LOGS).tolist())) for method, count in hits.items()}
    print(coverage)
    for method, shares in coverage.items():
        assert all(0.95 - 0.05 * MARGIN <= share <= 0.95 + 0.03 * MARGIN for share in shares.values()), (method, shares)
