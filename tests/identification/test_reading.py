"""Signals between the samples of a log: held targets, late loops, torque logged late or early."""

from __future__ import annotations

import numpy as np
import pytest

from held import INERTIA, KD, KP, VISCOUS, sampled_log
from stiction.files.joints import JointRecord
from stiction.identification.checks import Uniform
from stiction.identification.pipeline import identify_joint
from stiction.identification.reading import Reading, controller_torque, cut, refine, torque_lag

TRUTH = {"inertia": INERTIA, "viscous_friction": VISCOUS, "coulomb_friction": 0.3}


def check(record: JointRecord, viscous: float = 0.03) -> None:
    """Assert that a record is valid and right: inertia and dry friction within 0.5 %, and every interval."""
    assert record.objections == (), record.objections
    for name, true in TRUTH.items():
        estimate = getattr(record, name)
        assert estimate.value == pytest.approx(true, rel=viscous if name.startswith("viscous") else 5e-3), name
        assert estimate.interval95[0] <= true <= estimate.interval95[1], name


@pytest.mark.parametrize("torque", [True, False], ids=["torque", "positions"])
@pytest.mark.parametrize("rate", [50, 100])
def test_a_target_that_is_held_between_samples_is_read_so(rate: int, torque: bool) -> None:
    """A held target is read as held; straight lines shift viscous friction by half and more."""
    record = identify_joint(sampled_log(0.3, 0.3, rate=rate, held=True, torque=torque)).record
    assert record.diagnostics["reading"]["held"]
    check(record)


@pytest.mark.parametrize("rate", [100, 200, 500])
def test_a_target_that_moves_between_samples_is_read_straight(rate: int) -> None:
    """The same joint at the same rates, its target a line."""
    record = identify_joint(sampled_log(0.3, 0.3, rate=rate)).record
    assert not record.diagnostics["reading"]["held"]
    check(record)


@pytest.mark.parametrize("lag", [0.008, -0.005])
def test_torque_that_is_logged_late_or_early_misleads_nobody(lag: float) -> None:
    """The fit finds the delay of the torque, where regression alone is off by more than its intervals."""
    record = identify_joint(sampled_log(0.3, 0.3, lag=lag)).record
    assert record.diagnostics["reading"]["torque_lag"] == pytest.approx(lag, abs=1e-3)
    check(record)


def test_a_late_loop_is_simulated_late() -> None:
    """6 ms and half of the controller's millisecond."""
    record = identify_joint(sampled_log(0.3, 0.3, delay=0.006)).record
    assert record.delay is not None and record.delay.value == pytest.approx(0.0065, abs=5e-4)
    check(record)


def even(position: np.ndarray, target: np.ndarray, step: float) -> Uniform:
    """Return signals of a joint on an even grid."""
    time = np.arange(len(position)) * step
    return Uniform(time=time, step=step, position=position, torque=None, target=target, velocity=None)


def test_the_mean_torque_of_a_held_target_by_hand() -> None:
    """Torque of the spring alone: 20 before a sample and 60 after it are 40 about it, less half of the jump's step."""
    target = np.array([1.0, 1.0, 3.0, 3.0, 3.0])
    signals = even(np.zeros(5), target, 0.01)
    mean = controller_torque(signals, KP, KD, Reading(held=True))
    # The jump takes one of ten fine steps, before the sample: 0.5 of a step is missing of five.
    np.testing.assert_allclose(mean[1:4], [20.0, 42.0, 60.0], atol=1e-9)
    np.testing.assert_allclose(controller_torque(signals, KP, KD, Reading()), KP * target)


def test_finer_signals_count_at_the_samples_of_the_log_alone() -> None:
    """Two steps in each interval: the target is held, or the spline through its samples."""
    signals = even(np.arange(5.0), np.arange(5.0) ** 2, 0.01)
    held, straight = (refine(signals, way, 2) for way in (True, False))
    np.testing.assert_array_equal(held.target, [0, 0, 1, 1, 4, 4, 9, 9, 16])
    np.testing.assert_allclose(straight.target[1::2], [0.25, 2.25, 6.25, 12.25])
    np.testing.assert_array_equal(held.valid, [True, False] * 4 + [True])
    assert held.step == 0.005 and len(cut(signals, slice(3)).time) == 3


def test_the_lag_of_a_sine_by_hand() -> None:
    """3 ms late with a constant on top, and 2 ms early."""
    time = np.arange(2000) / 500
    true = np.sin(5 * time) + 0.4 * np.sin(13 * time)
    everything = np.ones(len(time), bool)
    for lag in (0.003, -0.002):
        logged = np.interp(time - lag, time, true) + 0.1
        assert torque_lag(time, logged, true, everything) == pytest.approx(lag, abs=5e-5)
