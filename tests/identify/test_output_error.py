"""Closed-loop output error on its own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stiction.formats.errors import StictionError
from stiction.formats.joints import PARAMETERS
from stiction.identify.checks import Uniform
from stiction.identify.model import Model
from stiction.identify.output_error import OutputError, fit_output_error
from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains, pd_torque
from stiction.joints.simulate import Joint, simulate

STEP = 0.002
TIME = np.arange(4000) * STEP
TARGET = 0.4 * np.sin(np.pi * TIME) + 0.3 * np.sin(4 * np.pi * TIME)
GAINS = PDGains(20.0, 0.5, 45.0)
TRUTH = (0.0145, 0.0704, 0.442, -0.05)


def late_log(delay: float) -> Uniform:
    """Simulate a controller whose velocity is late by a whole number of steps, sample by sample in small pieces."""
    inertia, viscous, coulomb, offset = TRUTH
    pieces = 40
    step, back = STEP / pieces, round(delay / STEP * pieces)
    position = velocity = 0.0
    past = [0.0] * (back + 1)
    positions, torques = [], []
    for index in range(len(TIME)):
        for piece in range(pieces):
            goal = np.interp(TIME[index] + piece * step, TIME, TARGET) if piece else TARGET[index]
            torque = GAINS.kp * (goal - position) - GAINS.kd * past[-1 - back]
            if piece == 0:
                positions.append(position)
                torques.append(torque)
            moved = velocity + step * (torque - offset - viscous * velocity) / inertia
            moved = np.sign(moved) * max(abs(moved) - step * coulomb / inertia, 0.0)
            position += 0.5 * step * (velocity + moved)
            velocity = moved
            past.append(velocity)
    return Uniform(TIME, STEP, np.array(positions), np.array(torques), TARGET, None)


def fitted(signals: Uniform, start: dict[str, float], **options: Any) -> OutputError:
    """Fit the Coulomb model by default; the joint starts from rest."""
    model = options.pop("model", Model())
    velocity = np.gradient(signals.position, STEP)
    velocity[0] = 0.0
    return fit_output_error(signals, options.pop("gains", GAINS), model, start, velocity, **options)


def test_it_finds_the_truth_from_a_poor_start() -> None:
    """Half and twice the true values are close enough to start from; a local minimum would show here."""
    inertia, viscous, coulomb, offset = TRUTH
    made = simulate(Joint(inertia, viscous, Coulomb(coulomb), offset), GAINS, STEP, TARGET)
    signals = Uniform(TIME, STEP, made.position, made.torque, TARGET, None)
    fit = fitted(signals, dict(zip(PARAMETERS, (2 * inertia, 0.5 * viscous, 1.5 * coulomb, 0.0))))
    assert [fit.estimates[name].value for name in PARAMETERS] == pytest.approx(TRUTH, rel=1e-3)
    assert fit.relative_errors["torque"] < 1e-3 and fit.unidentified == ()


def test_a_declared_velocity_delay_takes_the_bias_off_the_inertia() -> None:
    """6 ms late at kd 0.5 hides 0.003 of 0.0145 kg m² from the position; declared, the inertia is within 3 %."""
    signals, start = late_log(0.006), dict(zip(PARAMETERS, TRUTH))
    undeclared = fitted(signals, start)
    declared = fitted(signals, start, velocity_delay=0.006)
    assert undeclared.estimates["inertia"].value < 0.95 * TRUTH[0]
    assert declared.estimates["inertia"].value == pytest.approx(TRUTH[0], rel=0.03)
    assert declared.relative_errors["torque"] < 0.5 * undeclared.relative_errors["torque"]


def test_a_delay_that_eats_the_inertia_is_refused() -> None:
    """δ kd = 0.01 of an inertia of 0.0145 kg m²: beyond what a first-order delay can describe."""
    signals = Uniform(TIME, STEP, TARGET, pd_torque(GAINS, TARGET, TARGET, TARGET), TARGET, None)
    with pytest.raises(StictionError, match=r"velocity delay 0.02 s.*0 to 0.0145 s"):
        fitted(signals, dict(zip(PARAMETERS, TRUTH)), velocity_delay=0.02)
