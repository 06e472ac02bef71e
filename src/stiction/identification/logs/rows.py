"""Meaning of a log's rows: the unit of their stamps, the part that is used, and rows without a measurement.

Cells without a value, rows that come twice, angles that wrap, zeros in place of readings, a last reading that is
repeated: each is mended where there is one way to mend it, and noted in the log, a sentence each.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import isfinite
from typing import Any

import numpy as np

from stiction.core.errors import LogError
from stiction.files.log import JointSignals, Log, LogSetup
from stiction.identification.logs.titles import TIME_UNITS, unit_of_time
from stiction.identification.timing import LONGEST_STEP, SHORTEST_STEP, stands_out

USUAL_STEPS, EPOCH = (5e-5, 5e-2), (1e9, 4e9)
"""Least and largest step of a log without a unit of time [s]: a thousand apart, so that one unit fits; and seconds
from 1970 to 2001 and to 2096."""

HELD = ("target", "disturbance")
"""Signals that keep their value until the next one is written."""

MEASURED = ("position", "velocity", "torque")
"""Roles that an absent drive reports as zero, and a dead one as it was last."""

TURNS, NEAR_TURN = (2 * np.pi, 1.0, 360.0, *(float(2**bits) for bits in range(8, 25))), 0.15
"""Ranges over which an encoder counts: radians, turns, degrees, and steps of a binary one; and share of one by which a
jump of a wrapped angle may miss it: the motion of the joint in a row."""

JUMP, FAR, MOST_ZEROS = 20.0, 3.0, 0.2
"""Usual steps that a position does not make in one row; usual steps about zero within which a reading of zero may be
real; and share of rows that may be missing as zeros: more is no log of this joint."""

FROZEN, FEWEST_FROZEN = 0.25, 50
"""Time [s], and rows, for which all readings repeat to the last digit before the log is taken to be dead."""

NOISY = 0.5
"""Share of second differences that change their sign above which a torque has noise: two thirds in white noise."""


def check_stamps(source: str, setup: LogSetup) -> None:
    """Raise `LogError` for an impossible rate, unit or part of stamps, also where the log has no use for it."""
    if setup.rate is not None and not 0 < setup.rate < 1e9:
        raise LogError(f"{source}: a rate of {setup.rate} Hz; expected a positive number of samples per second")
    if setup.time_scale is not None and not 1e-12 <= setup.time_scale <= 1e6:
        raise LogError(
            f"{source}: a time scale of {setup.time_scale}; expected seconds per unit of the stamps, 1e-3 for ms"
        )
    for name, value in (("from", setup.begin), ("to", setup.end)):
        if value is not None and not isfinite(value):
            raise LogError(f"{source}: {name} is {value}; expected seconds from the first stamp, such as 2.5")


def seconds(time: np.ndarray, name: str, scale: float | None) -> tuple[np.ndarray, float, tuple[str, ...]]:
    """Return stamps in seconds, shape (num_samples,), their start [s], and notes on assumptions.

    name: name of the column, which may contain its unit; scale: seconds per unit if known. Large stamps in another
    unit count from the first, which keeps digits; those of a counter that begins again go on.
    """
    scale, notes = _unit(time, name) if scale is None else (scale, ())
    start = 0.0
    if scale != 1.0:
        finite = time[np.isfinite(time)]
        start = float(finite[0]) if len(finite) and abs(float(finite[0])) > 1e9 else 0.0
        time = (time - start) * scale
    time, turned = _unwrapped(time)
    return time, start * scale, notes + turned


def _unit(time: np.ndarray, name: str) -> tuple[float, tuple[str, ...]]:
    """Return the seconds in a unit of stamps, and a note on its source.

    The source is the name of their column; else, where they cannot be seconds, their size since 1970, or the step of
    whole numbers. In steps of one these may count samples, and nothing is guessed.
    """
    step, named = _step(time), unit_of_time(name)
    words = {TIME_UNITS[word]: word for word in ("ms", "µs", "ns")}
    if named is not None and SHORTEST_STEP <= step * named <= LONGEST_STEP:
        return named, (f"the time is in {words[named]}, as its column {name!r} says",) if named in words else ()
    # Not `<=`, so that NaN, where no two stamps differ, ends here too.
    if not step > LONGEST_STEP:
        return 1.0, ()
    known = time[np.isfinite(time)]
    dated = [unit for unit in words if EPOCH[0] <= float(known[0]) * unit < EPOCH[1]]
    whole = step >= 2 and bool((known == np.rint(known)).all())
    least, most = (SHORTEST_STEP, LONGEST_STEP) if dated else USUAL_STEPS
    fitting = [unit for unit in dated or words if least <= step * unit <= most]
    if len(fitting) != 1 or not (dated or whole):
        return 1.0, ()
    guess = (
        f"the time stamps were taken to be in {words[fitting[0]]}, one sample every {step * fitting[0]:.4g} s; if that "
        "is wrong, say what they are: --time-scale"
    )
    return fitting[0], (guess,)


def _step(time: np.ndarray) -> float:
    """Return the median step between different stamps; NaN where there is none."""
    steps = np.diff(np.sort(time[np.isfinite(time)]))
    steps = steps[steps > 0]
    return float(np.median(steps)) if len(steps) else float("nan")


def _unwrapped(time: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the unwrapped stamps [s] of a counter that began again, and a note on it.

    A step back is a counter's where, on top of its range, it is a usual step, and the stamps cover no more than it.
    """
    steps, usual = np.diff(time), _step(time)
    # Of 32 or 16 bits, in ns, µs or ms.
    for counter in (2**bits * unit for bits in (32, 16) for unit in (1e-9, 1e-6, 1e-3)):
        back = steps < -0.5 * counter
        if not back.any() or counter <= 100 * usual or np.ptp(time) > counter:
            continue
        if (np.abs(steps[back] + counter - usual) <= 20 * usual).all() and (steps[~back] > -20 * usual).all():
            turns = np.concatenate(([0], np.cumsum(back)))
            return time + counter * turns, (f"the clock's counter begins again after {counter:.6g} s: unwrapped",)
    return time, ()


def with_signals(log: Log, change: Callable[[str, np.ndarray], np.ndarray]) -> Log:
    """Return a log with every signal changed; change: function of a role, or `body's signals`, and the values."""
    joints = {
        name: JointSignals(
            **{role: change(role, values) for role, values in vars(signals).items() if values is not None}
        )
        for name, signals in log.joints.items()
    }
    return replace(log, joints=joints, body=log.body and log.body.each(partial(change, "body's signals")))


def take(log: Log, rows: np.ndarray, note: str) -> Log:
    """Return some samples of a log, with a note on the reason."""
    taken = with_signals(log, lambda _, values: values[rows])
    return replace(taken, time=log.time[rows], notes=(*log.notes, note))


def cut(log: Log, begin: float | None, end: float | None) -> Log:
    """Return the part of a log between two times from its first stamp [s]; raise `LogError` where that is empty."""
    if begin is None and end is None:
        return log
    since = log.time - np.nanmin(log.time)
    first, last = (begin if begin is not None else 0.0), (end if end is not None else np.inf)
    rows = (since >= first) & (since <= last)
    if not rows.any():
        raise LogError(
            f"{log.source}: nothing between {first:g} and {last:g} s; the log goes from 0 to {np.nanmax(since):.6g} s"
        )
    note = f"{int(rows.sum())} of {len(rows)} samples are used, from {first:g} to {min(last, np.nanmax(since)):.6g} s"
    return take(log, rows, note)


def complete_rows(log: Log) -> Log:
    """Return the rows in which every joint has a position, all else brought onto them, with a note.

    Tools that merge topics leave cells empty where a topic had nothing to say. A target is held from its last row, as
    its receiver did; velocity and torque are interpolated between theirs. Raises `LogError` where too little is left.
    """
    positions = [signals.position for signals in log.joints.values() if signals.position is not None]
    complete = np.isfinite(np.column_stack([log.time, *positions])).all(axis=1)
    if complete.mean() < 0.05 or not positions:
        raise LogError(
            f"{log.source}: {int(complete.sum())} of {len(complete)} rows have a time and the position of every joint; "
            "give one joint at a time, --columns position=NAME, or log again"
        )
    left, moved = complete.copy(), set()

    def filled(role: str, values: np.ndarray) -> np.ndarray:
        if not np.isfinite(values[complete]).all():
            moved.add(role)
            # A signal of the body has several columns.
            values = np.apply_along_axis(_held if role in HELD else partial(_between, log.time), 0, values)
            # Each may cost rows before its first value.
            left[:] &= np.isfinite(values).reshape(len(values), -1).all(axis=1)
        return values

    full = with_signals(log, filled)
    if not left.any():
        raise LogError(
            f"{log.source}: no row is left in which every signal is known; its columns do not overlap in time"
        )
    note = f"{int((~left).sum())} of {len(left)} rows have empty cells and are left out"
    for role in sorted(moved):
        note += f"; the {role} stands in other rows: {'held' if role in HELD else 'interpolated'} between them"
    return take(full, left, note)


def _held(values: np.ndarray) -> np.ndarray:
    """Return values with each empty cell filled by the last value before it; NaN before the first."""
    last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), -1))
    return np.where(last >= 0, values[np.maximum(last, 0)], np.nan)


def _between(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values interpolated in time where they are empty; NaN beyond their first and last."""
    known = np.flatnonzero(np.isfinite(values) & np.isfinite(time))
    if not len(known):
        return values
    known = known[np.argsort(time[known], kind="stable")]
    filling = np.interp(time, time[known], values[known], left=np.nan, right=np.nan)
    return np.where(np.isfinite(values), values, filling)


def mend(log: Log) -> Log:
    """Return a log without oddities of encoders and loggers that show in the signals; each leaves a note."""
    for step in (_without_repeats, _without_zeros, _turned, _alive):
        if len(log.time) > 2:
            log = step(log)
    return log


def _without_repeats(log: Log) -> Log:
    """Leave out rows that equal another one in its stamp and in every signal: a message that was sent twice."""
    steps = np.diff(log.time)
    if (steps > 0).all() or (steps < 0).all():
        return log
    signals = [values for joint in log.joints.values() for values in vars(joint).values() if values is not None]
    _, first = np.unique(np.column_stack([log.time, *signals]), axis=0, return_index=True)
    repeats = len(log.time) - len(first)
    if not repeats or len(first) < 3:
        return log
    return take(log, np.sort(first), f"{repeats} rows repeat another one exactly, and were left out")


def _without_zeros(log: Log) -> Log:
    """Leave out rows in which a position is zero and its neighbours are not near it, or jumps there and back."""
    missing = np.zeros(len(log.time), bool)
    for signals in log.joints.values():
        position = signals.position
        if position is None or not np.isfinite(position).all():
            continue
        known = np.flatnonzero(position)
        steps = np.abs(np.diff(position[known]))
        if len(known) < 3 or not steps.any():
            continue
        usual = float(np.percentile(steps[steps > 0], 99))
        between = np.interp(np.arange(len(position)), known, position[known])
        missing |= (position == 0) & (np.abs(between) > FAR * usual)
        missing |= stands_out(position, JUMP * usual, FAR * usual)
    if not missing.any() or missing.mean() > MOST_ZEROS:
        return log
    note = (
        f"{int(missing.sum())} samples have a position of zero far from their neighbours', or one that jumps there and "
        f"back, first sample {int(np.argmax(missing)) + 1}: readings were missing, and they were left out"
    )
    return take(log, ~missing, note)


def _turned(log: Log) -> Log:
    """Unwrap angles that jump by a whole turn; the target is brought to the same turn as the position."""
    for name, signals in log.joints.items():
        if signals.position is None or (turn := _turn(signals.position)) is None:
            continue
        changed: dict[str, Any] = {"position": np.unwrap(signals.position, period=turn)}
        if signals.target is not None:
            target = np.unwrap(signals.target, period=turn)
            changed["target"] = target - turn * np.rint(np.median(target - changed["position"]) / turn)
        note = f"the position of joint {name!r} wraps at {turn:.6g}, and was unwrapped"
        log = replace(log, joints=log.joints | {name: replace(signals, **changed)}, notes=(*log.notes, note))
    return log


def _turn(position: np.ndarray) -> float | None:
    """Return the range at which a position wraps; None where it does not."""
    if not np.isfinite(position).all():
        return None
    steps = np.abs(np.diff(position))
    jumps = steps > JUMP * np.percentile(steps, 98)
    if not jumps.any() or jumps.mean() > 0.02:
        return None
    for turn in TURNS:
        miss = np.abs(steps[jumps] - turn)
        if np.ptp(position) <= 1.001 * turn and (miss < NEAR_TURN * turn).all() and steps[jumps].max() <= 1.001 * turn:
            rest = np.abs(np.diff(np.unwrap(position, period=turn)))
            return turn if rest.max() <= JUMP * np.percentile(rest, 99) else None
    return None


def _alive(log: Log) -> Log:
    """Leave out stretches in which position and torque of every joint repeat to the last digit, though they could not.

    A joint at rest repeats its position, and in a simulation its torque; not while the target moves, nor in noise.
    """
    joints = log.joints.values()
    torques = [joint.torque for joint in joints if joint.torque is not None]
    if not torques:
        return log
    measured = [values for joint in joints for role in MEASURED if (values := getattr(joint, role)) is not None]
    same = (np.diff(np.column_stack(measured), axis=0) == 0).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], same, [False])).astype(int))).reshape(-1, 2)
    since = np.abs(log.time[edges[:, 1]] - log.time[edges[:, 0]])
    long = edges[(edges[:, 1] - edges[:, 0] >= FEWEST_FROZEN) & (since >= FROZEN)]
    rest = np.ones(len(same), bool)
    for start, end in long:
        rest[start:end] = False
    turns = [np.sign(np.diff(np.diff(torque)[rest])) for torque in torques]
    noisy = any(len(values) > FEWEST_FROZEN and np.mean(values[1:] * values[:-1] < 0) > NOISY for values in turns)
    moves = [np.diff(joint.target) != 0 for joint in joints if joint.target is not None]
    dead = np.zeros(len(log.time), bool)
    for start, end in long:
        if noisy or any(np.mean(values[start:end]) > NOISY for values in moves):
            # Of a dead stretch the first reading is one, but at the begin of the log.
            dead[start + (start > 0) : end + 1] = True
    if not dead.any() or dead.all():
        return log
    note = (
        f"{int(dead.sum())} samples repeat the reading before them to the last digit, first at "
        f"{log.time[np.argmax(dead)] - log.time[0]:.4g} s: nothing was read there, and they were left out"
    )
    return take(log, ~dead, note)
