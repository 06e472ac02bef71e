"""Logs that must be refused, each with one line that says why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stiction.formats.log import JointSignals, Log, LogError
from stiction.identify.checks import check_excitation, check_log

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
    ("time", "signals", "said"),
    [
        (TIME, replace(SIGNALS, torque=None), "joint 'knee' has no torque"),
        (TIME, replace(SIGNALS, position=None), "joint 'knee' has no position"),
        (TIME, replace(SIGNALS, torque=changed(WAVE, 7, np.nan)), "torque of joint 'knee' has 1 values .* sample 8;"),
        (TIME, replace(SIGNALS, target=changed(WAVE, 0, np.inf)), "target of joint 'knee' .* sample 1;"),
        (changed(TIME, 3, np.nan), SIGNALS, "time of joint 'knee' .* sample 4;"),
        (TIME[:100], JointSignals(WAVE[:100], None, None, WAVE[:100]), "100 samples; at least 200"),
        (changed(TIME, 5, TIME[4]), SIGNALS, "time stands still at sample 6"),
        (changed(TIME, 5, TIME[3]), SIGNALS, "time runs backwards at sample 6"),
        (TIME[::-1], SIGNALS, "time runs backwards at sample 2"),
        (np.where(TIME > 0.4, TIME + 0.05, TIME), SIGNALS, "1 sample intervals differ .* sample 202"),
        (1000 * TIME, SIGNALS, "one sample every 2 s.*in seconds"),
        (TIME, replace(SIGNALS, position=np.full(400, 0.3)), r"position of joint 'knee' is \(nearly\) constant at 0.3"),
        (TIME, replace(SIGNALS, torque=changed(WAVE, 8, 1e12)), "torque .* beyond 1e.09, the first in sample 9"),
        (TIME, replace(SIGNALS, torque=changed(WAVE, 8, 90.0)), "torque of joint 'knee' jumps .* to 90 at sample 9"),
        (TIME, replace(SIGNALS, position=1e-200 * WAVE), "position of joint 'knee' is .nearly. constant"),
        (TIME, replace(SIGNALS, torque=np.zeros(400)), r"torque of joint 'knee' is \(nearly\) constant"),
    ],
)
def test_bad_logs_are_refused(time: np.ndarray, signals: JointSignals, said: str) -> None:
    """Everything that would make the fit meaningless is named before the fit."""
    with pytest.raises(LogError, match=said):
        check(time, signals)


def test_small_jitter_is_put_on_an_even_grid() -> None:
    """Stamps that are 2 % of a step off are used as they are: the sine must come out at even times."""
    jitter = 0.02 * 0.002 * np.random.default_rng(0).uniform(-0.5, 0.5, 400)
    uneven = TIME + jitter
    even = check(uneven, replace(SIGNALS, position=np.sin(20 * uneven)))
    np.testing.assert_allclose(even.position, np.sin(20 * (even.time + uneven[0])), atol=3e-4)
    assert even.step == pytest.approx(0.002, rel=1e-4)


def test_stamps_may_count_from_1970() -> None:
    """Loggers write Unix time: the seconds are used, not their distance from 1970; other units are named as such."""
    even = check(TIME + 1.7e9)
    assert even.time[0] == 0 and even.step == pytest.approx(0.002, rel=1e-4)
    with pytest.raises(LogError, match="in seconds"):
        check(1e9 * (TIME + 1.7e9))


def test_torque_is_scaled_to_newton_metres() -> None:
    """Volts times a torque constant."""
    np.testing.assert_allclose(check(scale=-3.0).torque, -6 * WAVE)


def test_motion_in_one_direction_is_refused() -> None:
    """Without turning round, friction and offset are one number."""
    with pytest.raises(LogError, match="turns round 0 times"):
        check_excitation("x.csv", 2 + np.sin(3 * np.arange(2000) * 0.002), 0.002)


def test_slow_sampling_is_refused() -> None:
    """At 8 samples a period derivatives are guesses."""
    time = np.arange(1000) / 80
    with pytest.raises(LogError, match=r"sampled at 80 Hz, but the motion reaches 10"):
        check_excitation("x.csv", np.cos(2 * np.pi * 10 * time), 1 / 80)
