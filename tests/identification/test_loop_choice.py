"""Friction that is higher at rest, in logs whose slow samples are too few for torque regression."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from shanks import ASYMMETRIC, GO1, STRIBECK
from stiction.identification import choice
from stiction.identification.choice import choose_in_loop, choose_law, evidence_of
from stiction.identification.example import SATURN_LITE, Motor, example_log
from stiction.identification.in_loop import InLoop, close_loop
from stiction.identification.intervals import correlation_time
from stiction.identification.pipeline import identify_joint
from stiction.identification.regression import fit_rows, predict_torque
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


def test_without_a_loop_there_is_no_answer() -> None:
    """No gains: nothing can be simulated."""
    run = make_run(example_log(STRIBECK), None, IdentifySetup())
    base = fit_rows(run.rows, run.model)
    assert choose_in_loop(run, base, InLoop()) is None


def test_a_law_that_cannot_be_simulated_costs_the_joint_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Under high friction the first guess falls so steeply that the joint would run away; the symmetric law stands."""
    run = make_run(example_log(STRIBECK, seed=7), None, IdentifySetup())
    base = fit_rows(run.rows, run.model)
    loop = close_loop(run, base, base)
    assert choose_in_loop(run, base, loop) is not None
    monkeypatch.setattr(choice, "START_STATIC_RATIO", 100.0)
    assert choose_in_loop(run, base, loop) is None


def test_samples_in_a_gap_are_no_evidence() -> None:
    """A log with a hole of a seventh of its length: the criterion is that of the other samples, worked out here."""
    log = example_log(STRIBECK, seed=7)
    seen = np.r_[0 : 3 * len(log.time) // 7, 4 * len(log.time) // 7 : len(log.time)]
    joint = next(iter(log.joints.values()))
    cut = {name: value[seen] for name, value in vars(joint).items() if isinstance(value, np.ndarray)}
    holed = replace(log, time=log.time[seen], joints={next(iter(log.joints)): replace(joint, **cut)})
    run = make_run(holed, None, IdentifySetup())
    base = fit_rows(run.rows, run.model)
    loop = close_loop(run, base, base)
    found = choose_in_loop(run, base, loop)
    assert found is not None and loop.symmetric is not None
    counted = loop.symmetric.counted & found.found.counted
    assert 0.13 < np.mean(~counted) < 0.3
    expected, samples = 0.0, 0.0
    for name, plain in loop.symmetric.residuals.items():
        before, after = plain[counted], found.found.residuals[name][counted]
        assert not plain[~loop.symmetric.counted].any()
        independent = len(before) / max(correlation_time(before), correlation_time(after))
        expected += independent * np.log(np.sum(before**2) / np.sum(after**2))
        samples += independent
    assert found.evidence == pytest.approx(expected - 2 * np.log(samples), rel=1e-12)


def test_two_signals_by_hand() -> None:
    """400 samples without memory: 400 ln 4 of the signal whose residual is halved, 0 of the other, less 2 ln 800."""
    sign = np.resize([-1.0, 1.0], (2, 400))
    evidence = evidence_of([2 * sign[0], sign[1]], [sign[0], sign[1]], 2)
    assert evidence == pytest.approx(400 * np.log(4) - 2 * np.log(800), rel=1e-9)
    masked = evidence_of([np.append(2 * sign[0], 0.0), sign[1]], [np.append(sign[0], 0.0), sign[1]], 2)
    assert masked != pytest.approx(evidence, rel=1e-4)


def test_the_equation_holds_the_simulations_values() -> None:
    """Prediction and figures draw what is stated."""
    run = make_run(example_log(STRIBECK), None, IdentifySetup())
    base = fit_rows(run.rows, run.model)
    found = choose_in_loop(run, base, close_loop(run, base, base))
    assert found is not None and found.gain.certain and found.evidence > 6
    stated = [found.found.estimates[name].value for name in found.fit.names]
    assert found.fit.values.tolist() == stated
    residual = run.rows.torque - predict_torque(found.fit, run.rows)
    assert residual.tolist() == found.fit.residual.tolist()
