"""Output error on measured records: a drive with torque, and a robot's legs with positions alone."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest

from stiction.identification.checks import Uniform, check_log
from stiction.identification.logs import open_log, parse_columns
from stiction.identification.model import Law, Model
from stiction.identification.output_error import OutputError, fit_output_error
from stiction.identification.prepare import derivatives
from stiction.joints.pd import PDGains

GTAU, KP, KV = 35.15065188, 160.18, 243.45
"""Constants of the EMPS record; see `test_emps`."""

PUBLISHED_ERRORS = {"position": 1.38e-4, "velocity": 2.29e-3, "torque": 5.85e-2}
"""Relative errors of the closed-loop simulation of the symmetric law, by the record's authors."""

PUBLISHED: dict[Law, dict[str, float]] = {
    "coulomb": {
        "inertia": 95.1089,
        "viscous_friction": 203.5034,
        "coulomb_friction": 20.3935,
        "offset": -3.1648,
    },
    "asymmetric": {
        "inertia": 95.154,
        "viscous_friction_forward": 166.706,
        "viscous_friction_backward": 240.424,
        "coulomb_friction_forward": 20.144,
        "coulomb_friction_backward": 20.628,
    },
}


def record(name: str) -> Path:
    """Return a measured record, or skip."""
    folder = os.environ.get("STICTION_DATA")
    path = Path(folder or "") / name
    if not folder or not path.is_file():
        pytest.skip(f"{name} is not here: set STICTION_DATA to the folder that has it")
    return path


def drive(law: Law) -> OutputError:
    """Fit the EMPS drive, whose loop uses a velocity that is one sample late, from 20 % off the published values."""
    log = open_log(
        record("emps/DATA_EMPS.mat"), parse_columns(["time=t", "position=qm", "target=qg", "torque=vir"]), "carriage"
    )
    signals = check_log(log, "carriage", log.joints["carriage"], GTAU)
    velocity, _ = derivatives(signals.position, signals.step, 100.0)
    start = {name: 0.8 * value for name, value in PUBLISHED[law].items()}
    return fit_output_error(
        signals, PDGains(GTAU * KV * KP, GTAU * KV), Model(law), start, velocity, velocity_delay=0.001
    )


@pytest.mark.parametrize("law", ["coulomb", "asymmetric"])
def test_the_simulated_drive_follows_the_measured_one_at_least_as_well_as_published(law: Law) -> None:
    """Position, velocity and force, each at most 1.1 times the published error; the parameters within 1 %."""
    fit = drive(law)
    for signal, published in PUBLISHED_ERRORS.items():
        assert fit.relative_errors[signal] < 1.1 * published, signal
    for name, published in PUBLISHED[law].items():
        assert fit.estimates[name].value == pytest.approx(published, rel=1e-2), name
    print(law, fit.relative_errors, {name: estimate.value for name, estimate in fit.estimates.items()})


def by_regression(signals: Uniform, velocity: np.ndarray, acceleration: np.ndarray, gains: PDGains) -> dict[str, float]:
    """Return a start: least squares of the controller's torque on the equation's terms, where the joint moves."""
    torque = gains.kp * (np.asarray(signals.target) - signals.position) - gains.kd * velocity
    moving = np.abs(velocity) > 0.03
    terms = {
        "inertia": acceleration,
        "viscous_friction": velocity,
        "coulomb_friction": np.sign(velocity),
        "offset": np.ones_like(velocity),
        "gravity_sin": np.sin(signals.position),
        "gravity_cos": np.cos(signals.position),
    }
    table = np.stack([*terms.values()], axis=1)
    values = np.linalg.lstsq(table[moving], torque[moving], rcond=None)[0]
    return dict(zip(terms, (float(value) for value in values)))


def test_legs_in_the_air_from_positions_alone() -> None:
    """A Go2: twelve joints with gravity, each within a second; the calves have more dry friction than all others.

    Hip, thigh and calf of each leg in turn. Their users report 0.16 to 0.195 N m at hips and thighs and 0.5 to 0.74 at
    the calves, from fits of a simulator without gravity's terms.
    """
    log, gains = open_log(record("go2/traj_0.pt")), PDGains(20.0, 1.5)
    friction = []
    for joint, raw in log.joints.items():
        signals = check_log(log, joint, raw)
        velocity, acceleration = derivatives(signals.position, signals.step, 20.0)
        start = by_regression(signals, velocity, acceleration, gains)
        began = time.process_time()
        fit = fit_output_error(signals, gains, Model(gravity=True), start, velocity)
        assert time.process_time() - began < 1.0, joint
        assert fit.unidentified == (), joint
        assert 0.02 < fit.estimates["inertia"].value < 0.06 and fit.relative_errors["position"] < 0.02, joint
        friction.append(fit.estimates["coulomb_friction"])
    low = [estimate.interval95[0] for estimate in friction[2::3]]
    high = [estimate.interval95[1] for estimate in (*friction[0::3], *friction[1::3])]
    assert len(friction) == 12 and min(low) > max(high)
