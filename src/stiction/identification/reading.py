"""Reading of a log between its samples: a straight or held target, and delays of loop and torque.

A policy at 50 Hz, or the bus of a hobby servo, holds each target until the next one comes, while the motor's own loop
runs at a kilohertz and more. A log at the rate of the targets shows neither; read as straight lines it is another
controller, whose viscous friction is off by half and more. Both readings are simulated, and the log says which it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stiction.identification.checks import Uniform

FINE_STEP = 1e-3
"""Step on which a held target is simulated [s]: its jump takes one such step."""

LONGEST_STRAIGHT = 6e-3
"""Sampling step up to which the target between two samples is a straight line in simulation [s]."""

FASTEST_HELD = 600.0
"""Sampling rate up to which a held target is tried [Hz]: at a kilohertz it is a delay of half a millisecond."""


@dataclass(frozen=True)
class Reading:
    """Behaviour of target and torque between the samples of a log."""

    held: bool = False
    """True if the target keeps its value from each sample to the next; else it is a straight line."""
    delay: float = 0.0
    """Lateness of the controller's torque against target and angle [s]."""
    torque_lag: float = 0.0
    """Lateness of the logged torque against the angle, negative where it is early [s]."""


def may_hold(signals: Uniform) -> bool:
    """Return True if a held target would show at this sampling rate."""
    return signals.step * FASTEST_HELD >= 1.0


def fine_steps(signals: Uniform, held: bool) -> int:
    """Return the number of steps that a sample interval is cut into to be simulated."""
    if not held and signals.step <= LONGEST_STRAIGHT:
        return 1
    return max(2, int(np.ceil(signals.step / FINE_STEP - 1e-9)))


def refine(signals: Uniform, held: bool, pieces: int) -> Uniform:
    """Return signals with `pieces` steps in each sample interval; only the samples of the log count.

    The target is held between the samples, or a cubic spline through them; one step is the signals as they are.
    """
    if pieces == 1:
        return signals
    time = np.arange((len(signals.time) - 1) * pieces + 1) * (signals.step / pieces)
    latest = np.arange(len(time)) // pieces
    valid = np.zeros(len(time), bool)
    valid[::pieces] = signals.valid
    target = np.asarray(signals.target)
    if held:
        target = target[latest]
    else:
        # Imported here: few logs are so slow, and it takes as long to import as to simulate them.
        from scipy.interpolate import CubicSpline

        target = CubicSpline(signals.time, target)(time)

    def straight(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else np.interp(time, signals.time, values)

    return replace(
        signals,
        time=time,
        position=np.interp(time, signals.time, signals.position),
        velocity=straight(signals.velocity),
        torque=straight(signals.torque),
        disturbance=straight(signals.disturbance),
        feedforward=straight(signals.feedforward),
        step=signals.step / pieces,
        target=target,
        valid=valid,
        bridged=signals.bridged[latest],
    )


def cut(signals: Uniform, part: slice) -> Uniform:
    """Return some of the samples of signals, their time from zero."""
    arrays: dict[str, Any] = {
        name: values[part] for name, values in vars(signals).items() if isinstance(values, np.ndarray)
    }
    return replace(signals, **arrays | {"time": arrays["time"] - arrays["time"][0]})


def controller_torque(signals: Uniform, kp: float, kd: float, reading: Reading) -> np.ndarray:
    """Return the torque that the controller asked for around each sample, without a limit [N m], shape (num_samples,).

    For a held target it is the mean over one sample interval, for between two samples the torque falls by as much as it
    jumps at them.
    """
    velocity = np.gradient(signals.position, signals.step)
    if not reading.held:
        torque = kp * (np.asarray(signals.target) - signals.position) - kd * velocity
        return np.interp(signals.time - reading.delay, signals.time, torque)
    fine = refine(signals, True, fine_steps(signals, True))
    torque = kp * (np.asarray(fine.target) - fine.position) - kd * np.interp(fine.time, signals.time, velocity)
    late = np.interp(fine.time - reading.delay, fine.time, torque)
    # The mean from half an interval before each sample to half an interval after it, by trapezoids.
    total = np.concatenate([[0.0], np.cumsum(0.5 * (late[1:] + late[:-1]))])
    ends = np.clip(np.stack([signals.time - 0.5 * signals.step, signals.time + 0.5 * signals.step]), 0, fine.time[-1])
    low, high = np.interp(ends, fine.time, total)
    return (high - low) / np.maximum((ends[1] - ends[0]) / fine.step, 1e-9)


def torque_lag(time: np.ndarray, logged: np.ndarray, true: np.ndarray, valid: np.ndarray) -> float:
    """Return the lateness of a logged torque against the one that acted [s], negative where it is early.

    time [s], logged and true [N m], valid: samples that count; shape (num_samples,) each. By Gauss-Newton on
    logged(t) = true(t − lag) + constant.
    """
    lag, step = 0.0, float(time[1] - time[0])
    slope = np.gradient(true, step)
    for _ in range(5):
        moved, rate = np.interp(time - lag, time, true)[valid], np.interp(time - lag, time, slope)[valid]
        rest = logged[valid] - moved
        rate = rate - rate.mean()
        change = -float(rate @ (rest - rest.mean())) / max(float(rate @ rate), 1e-300)
        lag = float(np.clip(lag + change, -0.1, 0.1))
        if abs(change) < 0.01 * step:
            break
    return lag
