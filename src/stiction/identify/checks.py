"""What a log must be before anything is estimated from it; every refusal is one line that names the row or column."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.formats.log import JointSignals, Log, LogError

FEWEST_SAMPLES = 200
"""Below this no interval can be trusted."""

LARGEST_JITTER = 0.05
"""Largest departure of a sample interval from the median, as a share of it; more calls for resampling."""

LARGEST_VALUE = 1e9
"""In SI units no joint has more of anything."""

LARGEST_TIME = 1e20
"""Stamps may count from 1970, in whatever unit: what is not in seconds is refused by its own message."""

SMALLEST_RANGE = 1e-12
"""Less than this between the extremes of a signal, in SI units, is no motion."""

LARGEST_JUMP = 50.0
"""A step from sample to sample this many times the 99th percentile of all steps is a damaged sample, not physics."""

FEWEST_REVERSALS = 4
"""The velocity must change sign this often: friction and offset differ only in what they do when the joint turns."""

FEWEST_PER_CYCLE = 20
"""Samples per period of the fastest motion; with fewer, derivatives are guesses."""


@dataclass(frozen=True)
class Uniform:
    """Signals of one joint on an even grid, torque in N m; arrays of shape (num_samples,)."""

    time: np.ndarray
    """From zero [s]."""
    step: float
    """Time between samples [s]."""
    position: np.ndarray
    """θ [rad]."""
    torque: np.ndarray
    """τ [N m]."""
    target: np.ndarray | None
    """a [rad], or None if it was not logged."""
    velocity: np.ndarray | None
    """θ' as logged [rad/s], or None."""


def check_log(log: Log, joint: str, signals: JointSignals, torque_scale: float = 1.0) -> Uniform:
    """Check one joint's signals and put them on an even grid.

    torque_scale: N m per unit of the torque column. Raises `LogError`.
    """
    for role in ("position", "torque"):
        if getattr(signals, role) is None:
            raise LogError(
                f"{log.source}: joint {joint!r} has no {role}; log {role}.{joint} or map a column to it: {role}=NAME"
            )
    table = {
        "time": log.time,
        **{name: values for name, values in vars(signals).items() if values is not None},
    }
    for name, values in table.items():
        limit = LARGEST_TIME if name == "time" else LARGEST_VALUE
        bad = np.flatnonzero(~(np.abs(values) <= limit))
        if len(bad):
            raise LogError(
                f"{log.source}: {name} of joint {joint!r} has {len(bad)} values that are not finite or beyond "
                f"{limit:.0e}, the first in sample {bad[0] + 1}; cut those rows out or log again"
            )
    if len(log.time) < FEWEST_SAMPLES:
        raise LogError(f"{log.source}: {len(log.time)} samples; at least {FEWEST_SAMPLES} are needed")
    step = _check_time(log)
    for name in ("position", "torque"):
        _check_signal(f"{log.source}: {name} of joint {joint!r}", table[name])
    grid = np.arange(len(log.time)) * step
    elapsed = log.time - log.time[0]
    even = {name: np.interp(grid, elapsed, values) for name, values in table.items() if name != "time"}
    return Uniform(
        grid, step, even["position"], torque_scale * even["torque"], even.get("target"), even.get("velocity")
    )


def _check_signal(name: str, values: np.ndarray) -> None:
    """Refuse a signal that hardly varies, and one with a sample that is out of line with its neighbours."""
    if len(np.unique(values)) < 10 or np.ptp(values) < SMALLEST_RANGE:
        raise LogError(
            f"{name} is (nearly) constant at {values[0]:.6g}; "
            "the joint must move: log a sine of the target at two frequencies"
        )
    steps = np.abs(np.diff(values))
    usual = float(np.percentile(steps, 99))
    worst = int(np.argmax(steps))
    if usual > 0 and steps[worst] > LARGEST_JUMP * usual:
        raise LogError(
            f"{name} jumps from {values[worst]:.6g} to {values[worst + 1]:.6g} at sample {worst + 2}, over "
            f"{LARGEST_JUMP:.0f} times its usual step; cut damaged samples out or log again"
        )


def _check_time(log: Log) -> float:
    """Return the sampling step [s]; refuse time that stands, runs backwards, jumps or is not in seconds."""
    intervals = np.diff(log.time)
    wrong = np.flatnonzero(intervals <= 0)
    if len(wrong):
        what = "stands still" if intervals[wrong[0]] == 0 else "runs backwards"
        raise LogError(f"{log.source}: time {what} at sample {wrong[0] + 2}; expected strictly increasing stamps")
    middle = float(np.median(intervals))
    if not 1e-5 <= middle <= 0.1:
        raise LogError(
            f"{log.source}: one sample every {middle:.3g} s; expected 1e-5 s to 0.1 s: are the stamps in seconds?"
        )
    uneven = np.flatnonzero(np.abs(intervals / middle - 1) > LARGEST_JITTER)
    if len(uneven):
        raise LogError(
            f"{log.source}: {len(uneven)} sample intervals differ from {middle:.4g} s by over {LARGEST_JITTER:.0%}, "
            f"the first at sample {uneven[0] + 2} ({intervals[uneven[0]]:.4g} s); cut the gap out or resample evenly"
        )
    return float((log.time[-1] - log.time[0]) / (len(log.time) - 1))


def check_excitation(source: str, velocity: np.ndarray, step: float) -> None:
    """Refuse motion from which friction cannot be told from offset, or that is sampled too slowly.

    velocity: filtered θ' [rad/s]; step [s].
    """
    spectrum = np.abs(np.fft.rfft(velocity - velocity.mean())) ** 2
    share = np.cumsum(spectrum) / spectrum.sum()
    fastest = float(np.fft.rfftfreq(len(velocity), step)[np.searchsorted(share, 0.95)])
    if fastest * FEWEST_PER_CYCLE > 1 / step:
        raise LogError(
            f"{source}: sampled at {1 / step:.4g} Hz, but the motion reaches {fastest:.3g} Hz; expected at least "
            f"{FEWEST_PER_CYCLE} samples a period: log faster or move more slowly"
        )
    moving = velocity[np.abs(velocity) > 0.05 * np.abs(velocity).max()]
    reversals = int(np.count_nonzero(np.diff(np.sign(moving))))
    if reversals < FEWEST_REVERSALS:
        raise LogError(
            f"{source}: excitation too poor: the joint turns round {reversals} times; expected at least "
            f"{FEWEST_REVERSALS}: log several periods of a sine of the target"
        )
