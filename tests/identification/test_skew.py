"""Torque that is logged earlier than it acts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stiction.files.log import Log
from stiction.identification.consistency import compare_timing
from stiction.identification.example import SATURN_LITE, example_log
from stiction.identification.pipeline import identify_joint
from stiction.identification.regression import fit_rows
from stiction.identification.runs import make_run
from stiction.identification.setup import IdentifySetup


def early(log: Log, time: float) -> Log:
    """Return the log with its torque written `time` seconds before it acts."""
    signals = log.joints["shank"]
    torque = np.interp(log.time + time, log.time, np.asarray(signals.torque))
    return replace(log, joints={"shank": replace(signals, torque=torque, target=None)})


def test_the_time_is_found() -> None:
    """1 ms early, half of an update at 500 Hz: found to a few tenths of a millisecond."""
    run = make_run(early(example_log(), 1e-3), None, IdentifySetup())
    compared = compare_timing(run.prepared, fit_rows(run.rows, run.model))
    assert compared is not None
    assert float(compared.parts[1].split()[1]) == pytest.approx(1.0, abs=0.5)


def test_intervals_admit_what_early_torque_does_to_viscous_friction() -> None:
    """At 2 ms B is 6 % low, five deviations, and without a target nothing tells when the torque acted.

    The interval must hold the truth, and the reader know why it is wide.
    """
    plain = identify_joint(example_log()).record
    assert all(not one["disputed"] for one in plain.diagnostics["comparisons"])
    record = identify_joint(early(example_log(), 2e-3)).record
    truth = SATURN_LITE.joint.viscous
    seen = record.diagnostics["seen"]["viscous_friction"]
    assert seen["interval95"][1] < truth
    assert record.viscous_friction.interval95[0] < truth < record.viscous_friction.interval95[1]
    assert any("not of the same instant" in text for text in record.warnings)


def test_torque_in_time_is_not_disputed() -> None:
    """Torque in time is disputed in at most one of ten logs."""
    disputed = 0
    for seed in range(10):
        run = make_run(example_log(seed=seed), None, IdentifySetup())
        compared = compare_timing(run.prepared, fit_rows(run.rows, run.model))
        disputed += bool(compared is not None and compared.disputed)
    assert disputed <= 1
