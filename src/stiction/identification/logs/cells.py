"""What a table's rows mean: the unit of its stamps, the part that was asked for, and cells in which nothing stands."""

from __future__ import annotations

from dataclasses import replace
from math import isfinite

import numpy as np

from stiction.core.errors import LogError
from stiction.files.log import BODY, SIGNALS, JointSignals, Log
from stiction.identification.logs.naming import unit_of_time
from stiction.identification.timing import LONGEST_STEP, SHORTEST_STEP

UNITS = {"ms": 1e-3, "µs": 1e-6, "ns": 1e-9}
"""Unit that stamps may have -> seconds."""

USUAL_STEPS = 5e-5, 5e-2
"""Between these lies the step of a log whose unit nobody named [s]: a thousand apart, so that one unit fits."""

EPOCH = 1e9, 4e9
"""Seconds from 1970 to 2001 and to 2096."""

HELD = ("target", "disturbance")
"""Signals that keep their value until the next one is written."""

MOST_LEFT_OUT = 0.95
"""Share of rows without a position beyond which the file is no log of positions."""


def check_stamps(source: str, rate: float | None, scale: float | None, begin: float | None, end: float | None) -> None:
    """Raise `LogError` for numbers that no stamps have, whether or not a log has use for them.

    rate: samples per second [Hz]; scale: seconds per unit of the stamps; begin, end: from the first stamp [s].
    """
    if rate is not None and not 0 < rate < 1e9:
        raise LogError(f"{source}: a rate of {rate} Hz; expected a positive number of samples per second")
    if scale is not None and not 1e-12 <= scale <= 1e6:
        raise LogError(f"{source}: a time scale of {scale}; expected seconds per unit of the stamps, 1e-3 for ms")
    for name, value in (("from", begin), ("to", end)):
        if value is not None and not isfinite(value):
            raise LogError(f"{source}: {name} is {value}; expected seconds from the first stamp, such as 2.5")


def seconds(time: np.ndarray, name: str, scale: float | None) -> tuple[np.ndarray, float, tuple[str, ...]]:
    """Return stamps in seconds, shape (num_samples,), when they begin, and what was taken for granted.

    name: the column's, which may say its unit; scale: seconds per unit where somebody knows. Where nobody does and the
    stamps cannot be seconds, the unit is found from their size since 1970, or from the step of whole numbers; one by
    one they may count samples, and nothing is guessed.
    """
    if scale is not None:
        return (*_scaled(time, scale), ())
    step = _step(time)
    named = unit_of_time(name)
    if named is not None and SHORTEST_STEP <= step * named <= LONGEST_STEP:
        word = next((word for word, unit in UNITS.items() if unit == named), "")
        return (*_scaled(time, named), (f"the time is in {word}, as its column {name!r} says",) if word else ())
    # Nobody said: stamps that can be seconds are. Not `<=`, so that NaN, where no two stamps differ, ends here too.
    if not step > LONGEST_STEP:
        return time, 0.0, ()
    known = time[np.isfinite(time)]
    start, whole = float(known[0]), step >= 2 and bool((known == np.rint(known)).all())
    # By their size since 1970, where that fits a unit; other whole numbers by a step that one unit alone makes usual.
    dated = [word for word, unit in UNITS.items() if EPOCH[0] <= start * unit < EPOCH[1]]
    fitting = [
        word
        for word, unit in UNITS.items()
        if (SHORTEST_STEP <= step * unit <= LONGEST_STEP and word in dated)
        or (not dated and whole and USUAL_STEPS[0] <= step * unit <= USUAL_STEPS[1])
    ]
    if len(fitting) != 1:
        return time, 0.0, ()
    unit = UNITS[fitting[0]]
    said = (
        f"the time stamps were taken to be in {fitting[0]}, one sample every {step * unit:.4g} s; if that is wrong, "
        "say what they are: --time-scale",
    )
    return (*_scaled(time, unit), said)


COUNTERS = tuple(2**bits * unit for bits in (32, 16) for unit in (1e-9, 1e-6, 1e-3))
"""Time after which a counter of 32 or 16 bits begins again, in ns, µs or ms [s]."""


def unwrapped(time: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return stamps [s] of a counter that did not begin again, and a note where it had.

    A step back is a counter's where, on top of its range, it is a usual step, and the stamps cover no more than it.
    """
    steps = np.diff(time)
    usual = _step(time)
    for counter in COUNTERS:
        back = steps < -0.5 * counter
        if not back.any() or counter <= 100 * usual or np.ptp(time) > counter:
            continue
        if (np.abs(steps[back] + counter - usual) <= 20 * usual).all() and (steps[~back] > -20 * usual).all():
            turns = np.concatenate(([0], np.cumsum(back)))
            return time + counter * turns, (f"the clock's counter begins again after {counter:.6g} s: unwrapped",)
    return time, ()


def _scaled(time: np.ndarray, scale: float) -> tuple[np.ndarray, float]:
    """Return stamps in seconds, and what was taken off them: large ones count from the first, which keeps digits."""
    if scale == 1.0:
        return time, 0.0
    finite = time[np.isfinite(time)]
    start = float(finite[0]) if len(finite) and abs(float(finite[0])) > 1e9 else 0.0
    return (time - start) * scale, start * scale


def _step(time: np.ndarray) -> float:
    """Return the median step between different stamps; NaN where there is none."""
    steps = np.diff(np.sort(time[np.isfinite(time)]))
    steps = steps[steps > 0]
    return float(np.median(steps)) if len(steps) else float("nan")


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
    return take(log, rows, (note,))


def take(log: Log, rows: np.ndarray, notes: tuple[str, ...] = ()) -> Log:
    """Return some samples of a log."""
    joints = {
        name: JointSignals(**{role: None if values is None else values[rows] for role, values in vars(signals).items()})
        for name, signals in log.joints.items()
    }
    body = None if log.body is None else log.body.each(lambda values: values[rows])
    return replace(log, time=log.time[rows], joints=joints, notes=(*log.notes, *notes), body=body)


def complete_rows(log: Log) -> Log:
    """Return the rows in which every joint has a position, all else brought onto them; what was done is noted.

    Tools that merge topics leave cells empty where a topic had nothing to say. A target is held from its last row, as
    its receiver did; velocity and torque are interpolated between theirs. Raises `LogError` where too little is left.
    """
    positions = [signals.position for signals in log.joints.values() if signals.position is not None]
    # Keep the rows in which every joint has a position.
    there = np.isfinite(log.time)
    for values in positions:
        there &= np.isfinite(values)
    if there.sum() < (1 - MOST_LEFT_OUT) * len(there) or not positions:
        raise LogError(
            f"{log.source}: {int(there.sum())} of {len(there)} rows have a time and the position of every joint; give "
            "one joint at a time, --columns position=NAME, or log again"
        )
    # Bring all other signals onto them; each may cost rows before its first value.
    filled: dict[str, dict[str, np.ndarray | None]] = {}
    interpolated = set()
    for name, signals in log.joints.items():
        filled[name] = dict(vars(signals))
        for role in SIGNALS[1:]:
            values = getattr(signals, role)
            if values is None or np.isfinite(values[there]).all():
                continue
            found = _held(values) if role in HELD else _between(log.time, values, there)
            filled[name][role] = found
            interpolated.add(role)
            there &= np.isfinite(found)
    body = log.body
    if body is not None:
        known = [getattr(body, name) for name in BODY if getattr(body, name) is not None]
        if not all(np.isfinite(values[there]).all() for values in known):
            interpolated.add("body's signals")
            body = body.each(lambda values: np.stack([_between(log.time, one, there) for one in values.T], axis=1))
            known = [getattr(body, name) for name in BODY if getattr(body, name) is not None]
        for values in known:
            there &= np.isfinite(values).all(axis=1)
    if not there.any():
        raise LogError(
            f"{log.source}: no row is left in which every signal is known; its columns do not overlap in time"
        )
    joints = {name: JointSignals(**signals) for name, signals in filled.items()}
    note = f"{int((~there).sum())} of {len(there)} rows have empty cells and are left out"
    for role in sorted(interpolated):
        note += f"; the {role} stands in other rows: {'held' if role in HELD else 'interpolated'} between them"
    return take(replace(log, joints=joints, body=body), there, (note,))


def _held(values: np.ndarray) -> np.ndarray:
    """Return values with each empty cell as the last before it; NaN before the first."""
    last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), -1))
    return np.where(last >= 0, values[np.maximum(last, 0)], np.nan)


def _between(time: np.ndarray, values: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Return values interpolated in time where they are empty; NaN beyond their first and last."""
    known = np.isfinite(values) & np.isfinite(time)
    if not known.any():
        return values
    order = np.argsort(time[known], kind="stable")
    stamps, numbers = time[known][order], values[known][order]
    found = np.interp(time, stamps, numbers, left=np.nan, right=np.nan)
    return np.where(np.isfinite(values), values, np.where(there, found, np.nan))
