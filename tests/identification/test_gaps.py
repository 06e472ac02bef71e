"""Effects of a gap in the log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from shanks import GO1
from stiction.files.log import JointSignals, Log
from stiction.identification.checks import Uniform, check_log
from stiction.identification.closed_loop import controller_mismatch
from stiction.identification.example import Motor, example_log
from stiction.identification.model import Model
from stiction.identification.output_error import OutputError, fit_output_error
from stiction.identification.prepare import prepare
from stiction.identification.timing import near, settling
from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains, pd_torque

SIX = [(1100, 50), (2650, 70), (4200, 90), (5700, 110), (7250, 130), (8800, 150)]
"""First sample and length of gaps in a log of 10,000 samples."""


def without(log: Log, gaps: list[tuple[int, int]]) -> Log:
    """Return a log of one joint that lacks some samples."""
    kept = np.ones(len(log.time), bool)
    for first, length in gaps:
        kept[first : first + length] = False
    ((name, signals),) = log.joints.items()
    less = {key: values[kept] for key, values in vars(signals).items() if values is not None}
    return replace(log, time=log.time[kept], joints={name: JointSignals(**less)})


def fitted(log: Log, motor: Motor) -> OutputError:
    """Fit the Coulomb model to positions alone, from 10 % off."""
    signals = check_log(log, "shank", replace(log.joints["shank"], torque=None))
    spring = motor.gains.kp * (np.asarray(signals.target) - signals.position)
    joint, velocity = motor.joint, prepare(signals, spring).velocity
    assert isinstance(joint.friction, Coulomb)
    values = (1.1 * joint.inertia, 0.9 * joint.viscous, 1.1 * joint.friction.level, 0.0)
    model = Model()
    return fit_output_error(signals, motor.gains, model, dict(zip(model.names, values)), velocity)


def test_what_is_near_a_gap_by_hand() -> None:
    """Two samples to either side."""
    gap = np.zeros(12, bool)
    gap[5:7] = True
    assert np.flatnonzero(near(gap, 2)).tolist() == [3, 4, 5, 6, 7, 8]
    assert np.flatnonzero(near(gap, 0)).tolist() == [5, 6]


def test_a_joint_settles_in_motion_and_not_at_rest() -> None:
    """Three samples of motion after each gap; rest in between is waited out; the log's end ends it."""
    gap, moving = np.zeros(30, bool), np.ones(30, bool)
    gap[4:6] = gap[28] = True
    moving[7:10] = False
    assert np.flatnonzero(settling(gap, moving, 3)).tolist() == [6, 7, 8, 9, 10, 11, 29]
    assert not settling(np.zeros(30, bool), moving, 3).any()


def test_what_the_target_did_in_a_gap_does_not_bias_output_error() -> None:
    """Six gaps of 0.1 to 0.3 s: without waiting for the joint to settle, friction was 30 % off, known to ±100 %."""
    log = example_log(GO1, seed=2)
    whole, broken = fitted(log, GO1), fitted(without(log, SIX), GO1)
    joint = GO1.joint
    assert isinstance(joint.friction, Coulomb)
    for name, truth in (("viscous_friction", joint.viscous), ("coulomb_friction", joint.friction.level)):
        estimate, alone = broken.estimates[name], whole.estimates[name]
        low, high = estimate.interval95
        assert low <= truth <= high, name
        assert estimate.value == pytest.approx(truth, rel=0.04), name
        assert high - low < 1.5 * (alone.interval95[1] - alone.interval95[0]), name


def test_gaps_do_not_accuse_the_controller() -> None:
    """Six gaps of 0.1 s: torque, angle and target are straight lines there, and velocity rings beside them."""
    gains, time = PDGains(20.0, 0.5, 45.0), 0.002 * np.arange(10_000)
    log = example_log(GO1)
    broken = without(log, [(first, 50) for first, _ in SIX])
    sizes = []
    for one in (log, broken):
        signals = check_log(one, "shank", one.joints["shank"])
        made = prepare(signals, np.asarray(signals.torque))
        sizes.append(controller_mismatch(signals, gains, made.velocity, made.cutoff).size)
    assert sizes[1] == pytest.approx(sizes[0], rel=0.05)
    wave = np.sin(3 * time)
    torque = pd_torque(gains, wave, 0.9 * wave, 2.7 * np.cos(3 * time))
    all_gaps = Uniform(time, 0.002, 0.9 * wave, torque, wave, None, bridged=np.arange(10_000) % 20 == 0)
    assert controller_mismatch(all_gaps, gains, 2.7 * np.cos(3 * time), 20.0).size < 0.01
