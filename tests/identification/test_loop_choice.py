"""Friction that is higher at rest, in logs whose slow samples are too few for torque regression."""

from __future__ import annotations

import numpy as np
import pytest

from shanks import ASYMMETRIC, GO1, STRIBECK
from stiction.identification.choice import choose_law, evidence_of
from stiction.identification.example import SATURN_LITE, Motor, example_log
from stiction.identification.pipeline import identify_joint
from stiction.identification.regression import fit_rows
from stiction.identification.runs import make_run
from stiction.identification.setup import IdentifySetup


def test_the_loop_finds_what_regression_does_not() -> None:
    """0.442 in motion, 0.65 at rest, 0.4 rad/s: regression says plain friction; the record must not."""
    log = example_log(STRIBECK, seed=7)
    run = make_run(log, None, IdentifySetup())
    base = fit_rows(run.rows, run.model)
    assert choose_law(run.rows, base).law == "coulomb"
    record = identify_joint(log).record
    law = record.friction_law
    assert law["law"] == "stribeck" and law["method"] == "output_error" and "turning points" in law["text"]
    truth = {"viscous_friction": 0.0704, "coulomb_friction": 0.442, "static_friction": 0.65, "stribeck_velocity": 0.4}
    for name, true in truth.items():
        assert law["parameters"][name]["value"] == pytest.approx(true, rel=0.1), name
    assert record.static_friction.value == law["parameters"]["static_friction"]["value"]
    assert record.dead_band.value == pytest.approx(0.65 / 20, rel=0.02)
    assert {entry["law"]: entry["verdict"] for entry in law["candidates"]}["coulomb"] == "beaten"


@pytest.mark.parametrize("motor", [GO1, SATURN_LITE, ASYMMETRIC], ids=lambda motor: motor.name)
def test_joints_without_it_are_left_alone(motor: Motor) -> None:
    """The estimators agree, so nothing is simulated again; static friction stays null."""
    record = identify_joint(example_log(motor, seed=3)).record
    assert record.friction_law["law"] != "stribeck" and record.static_friction is None


def test_two_signals_by_hand() -> None:
    """400 samples without memory: 400 ln 4 of the signal whose residual is halved, 0 of the other, less 2 ln 800."""
    sign = np.resize([-1.0, 1.0], (2, 400))
    evidence = evidence_of([2 * sign[0], sign[1]], [sign[0], sign[1]], 2)
    assert evidence == pytest.approx(400 * np.log(4) - 2 * np.log(800), rel=1e-9)
    masked = evidence_of([np.append(2 * sign[0], 0.0), sign[1]], [np.append(sign[0], 0.0), sign[1]], 2)
    assert masked != pytest.approx(evidence, rel=1e-4)
