"""Logs that must be refused, each with one line that says why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stiction.core.errors import LogError
from stiction.files.log import JointSignals, Log
from stiction.identification.checks import check_excitation, check_log
from stiction.identification.contradictions import unit_findings

TIME = np.arange(400) * 0.002
WAVE = np.sin(20 * TIME)
SIGNALS = JointSignals(position=WAVE, torque=2 * WAVE, target=WAVE)


def check(time: np.ndarray = TIME, signals: JointSignals = SIGNALS, scale: float = 1.0):
    """Check a log of one joint named knee."""
    return check_log(Log("x.csv", time, {"knee": signals}), "knee", signals, scale)


def changed(values: np.ndarray, place: int, value: float) -> np.ndarray:
    """Return a copy with one entry replaced."""
    copy = values.copy()
    copy[place] = value
    return copy


@pytest.mark.parametrize(
    ("time", "signals", "message"),
    [
        (TIME, replace(SIGNALS, torque=None, target=None), "joint 'knee' has no torque and no target"),
        (TIME, replace(SIGNALS, torque=None, target=0 * WAVE), r"target of joint 'knee' is \(nearly\) constant at 0"),
        (TIME, replace(SIGNALS, position=None), "joint 'knee' has no position"),
        (TIME, replace(SIGNALS, torque=changed(WAVE, 7, np.nan)), "torque of joint 'knee' has 1 values .* sample 8;"),
        (TIME, replace(SIGNALS, target=changed(WAVE, 0, np.inf)), "target of joint 'knee' .* sample 1;"),
        (changed(TIME, 3, np.nan), SIGNALS, "time of joint 'knee' .* sample 4;"),
        (TIME[:100], JointSignals(WAVE[:100], None, None, WAVE[:100]), "100 samples .* at least 200"),
        (TIME, replace(SIGNALS, position=np.full(400, 0.3)), "position .* constant at 0.3; the joint must move"),
        (TIME, replace(SIGNALS, torque=changed(WAVE, 8, 1e12)), "torque .* beyond 1e.09, the first in sample 9"),
        (TIME, replace(SIGNALS, torque=changed(WAVE, 8, 90.0)), "torque of joint 'knee' jumps .* to 90 at sample 9"),
        (TIME, replace(SIGNALS, position=WAVE + 6.28 * (TIME > 0.4)), "position .* jumps .* at sample 202"),
        (TIME, replace(SIGNALS, position=1e-200 * WAVE), "position of joint 'knee' is .nearly. constant"),
        (TIME, replace(SIGNALS, torque=np.zeros(400)), "constant at 0; the driver seems not to report it: .* --kp and"),
    ],
)
def test_bad_logs_are_refused(time: np.ndarray, signals: JointSignals, message: str) -> None:
    """Faults that make the fit meaningless are named before it."""
    with pytest.raises(LogError, match=message):
        check(time, signals)


def test_jittered_signals_are_put_on_an_even_grid() -> None:
    """Stamps that are 20 % of a step off are used as they are: the sine must come out at even times."""
    uneven = TIME + 0.2 * 0.002 * np.random.default_rng(0).uniform(-0.5, 0.5, 400)
    even = check(uneven, replace(SIGNALS, position=np.sin(20 * uneven)))
    np.testing.assert_allclose(even.position, np.sin(20 * (even.time + uneven[0])), atol=2e-7)
    assert even.step == pytest.approx(0.002, rel=1e-3) and even.valid.all()
    assert even.timing and even.timing.jitter == pytest.approx(0.2 * np.sqrt(2 / 12), rel=0.1)


def test_a_spike_is_no_motion_and_a_short_burst_is_no_spike() -> None:
    """Three damaged samples once cost all others, and the advice was to move further; a joint may rest and then run."""
    time = np.arange(10000) * 0.002
    wave, spike = np.sin(5 * time), np.zeros(10000)
    spike[2000:2003] = 0.4
    signals = replace(SIGNALS, position=wave + spike, torque=wave, target=wave)
    with pytest.raises(LogError, match=r"position of joint 'knee' jumps from .* at sample 2001, over 20 times"):
        check(time, signals)
    # At most 60 times the usual step, and at most 6 more from step to step.
    burst = 1e-4 * wave + np.cumsum(1e-4 * 0.6 * np.interp(time, (9.98, 10.0, 10.02), (0.0, 1.0, 0.0)))
    assert np.ptp(check(time, replace(signals, position=burst)).position) > 1e-4


def test_degrees_and_strange_torques_are_noticed() -> None:
    """A slip of units is said, for a joint could do it; metres have no such limits."""
    assert [*unit_findings(check())] == []
    degrees = check(signals=JointSignals(position=57.3 * WAVE, target=WAVE, torque=5000 * WAVE))
    texts, remedies = zip(*((one.seen, one.remedy) for one in unit_findings(degrees)), strict=True)
    assert len(texts) == 3
    assert "in degrees, or at the motor" in texts[0] and "is the position in degrees" in texts[1] and "N mm" in texts[2]
    assert "--position-scale 0.0174533" in remedies[0] and "--torque-scale" in remedies[2]
    assert "convert the position to rad in the log, for --position-scale is of both" in remedies[1]
    assert "is the target in degrees" in next(unit_findings(check(signals=replace(SIGNALS, target=57.3 * WAVE)))).seen
    assert [*unit_findings(degrees, "linear")] == []


def test_motion_in_one_direction_is_refused() -> None:
    """Without turning round, friction and offset are one number."""
    with pytest.raises(LogError, match="turns round 0 times"):
        check_excitation("x.csv", 2 + np.sin(3 * np.arange(2000) * 0.002), 0.002)


def test_slow_sampling_is_refused() -> None:
    """At 8 samples a period derivatives are guesses."""
    time = np.arange(1000) / 80
    with pytest.raises(LogError, match=r"sampled at 80 Hz, but the motion reaches 10"):
        check_excitation("x.csv", np.cos(2 * np.pi * 10 * time), 1 / 80)
