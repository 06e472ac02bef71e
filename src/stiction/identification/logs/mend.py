"""Oddities of encoders and loggers that show in the signals themselves, mended where there is one way to mend them.

Rows that come twice, angles that wrap, zeros in place of missing readings, a last reading that is repeated to the end.
What was done is noted in the log, a sentence each.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from stiction.files.log import JointSignals, Log
from stiction.identification.logs.cells import take

MEASURED = ("position", "velocity", "torque")
"""Roles that an absent drive reports as zero, and a dead one as it was last."""

TURNS = (2 * np.pi, 1.0, 360.0, *(float(2**bits) for bits in range(8, 25)))
"""Ranges over which an encoder counts: radians, turns, degrees, and steps of a binary one."""

NEAR_TURN = 0.15
"""Share of a turn by which a jump of a wrapped angle may miss the whole turn: what the joint moved in a row."""

JUMP = 20.0
"""Usual steps (99th percentile) that a position does not make in one row."""

FAR = 3.0
"""Usual steps within which a reading of zero is where the joint passes zero."""

MOST_ZEROS = 0.2
"""Share of rows that may be missing as zeros; more is no log of this joint."""

FROZEN = 0.25
"""Time for which position and torque repeat to the last digit before the log is taken to be dead [s]."""

FEWEST_FROZEN = 50
"""Rows of a dead stretch."""

NOISY = 0.5
"""Share of second differences that change their sign, from which on a torque has noise: two thirds in white noise."""


def mend(log: Log) -> Log:
    """Return a log without the oddities; each leaves a note."""
    for step in (_without_repeats, _without_zeros, _unwrapped, _alive):
        if len(log.time) > 2:
            log = step(log)
    return log


def _signals(log: Log) -> np.ndarray:
    """Return all signals side by side, shape (num_samples, num_signals)."""
    return np.column_stack([one for joint in log.joints.values() for one in vars(joint).values() if one is not None])


def _without_repeats(log: Log) -> Log:
    """Leave out rows that another one equals in its stamp and in every signal: a message that was sent twice."""
    steps = np.diff(log.time)
    if (steps > 0).all() or (steps < 0).all():
        return log
    rows = np.column_stack([log.time, _signals(log)])
    _, first = np.unique(rows, axis=0, return_index=True)
    if len(first) == len(rows) or len(first) < 3:
        return log
    kept = np.zeros(len(rows), bool)
    kept[first] = True
    return take(log, kept, (f"{len(rows) - len(first)} rows repeat another one exactly, and were left out",))


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
        # One row alone, out of line with those on either side, which are in line with each other.
        there, back = np.diff(position)[:-1], np.diff(position)[1:]
        alone = (np.minimum(np.abs(there), np.abs(back)) > JUMP * usual) & (np.abs(there + back) < FAR * usual)
        missing[1:-1] |= alone
    if not missing.any() or missing.mean() > MOST_ZEROS:
        return log
    note = (
        f"{int(missing.sum())} samples have a position of zero far from their neighbours', or one that jumps there and "
        f"back, first sample {int(np.argmax(missing)) + 1}: readings were missing, and they were left out"
    )
    return take(log, ~missing, (note,))


def _unwrapped(log: Log) -> Log:
    """Unwrap angles that jump by a whole turn; the target is brought to the same turn as the position."""
    joints: dict[str, JointSignals] = {}
    notes: tuple[str, ...] = ()
    for name, signals in log.joints.items():
        turn = None if signals.position is None else _turn(signals.position)
        if turn is None or signals.position is None:
            joints[name] = signals
            continue
        changed: dict[str, Any] = {"position": np.unwrap(signals.position, period=turn)}
        if signals.target is not None:
            target = np.unwrap(signals.target, period=turn)
            changed["target"] = target - turn * np.rint(np.median(target - changed["position"]) / turn)
        joints[name] = replace(signals, **changed)
        notes += (f"the position of joint {name!r} wraps at {turn:.6g}, and was unwrapped",)
    return replace(log, joints=joints, notes=(*log.notes, *notes)) if notes else log


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
    measured = [one for joint in log.joints.values() for role in MEASURED if (one := getattr(joint, role)) is not None]
    torques = [joint.torque for joint in log.joints.values() if joint.torque is not None]
    targets = [joint.target for joint in log.joints.values() if joint.target is not None]
    if not torques:
        return log
    same = (np.diff(np.column_stack(measured), axis=0) == 0).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], same, [False])).astype(int))).reshape(-1, 2)
    long = [
        (start, end)
        for start, end in edges
        if end - start >= FEWEST_FROZEN and abs(log.time[end] - log.time[start]) >= FROZEN
    ]
    rest = np.ones(len(same), bool)
    for start, end in long:
        rest[start:end] = False
    turns = [np.sign(np.diff(np.diff(one)[rest])) for one in torques]
    noisy = any(len(one) > FEWEST_FROZEN and np.mean(one[1:] * one[:-1] < 0) > NOISY for one in turns)
    dead = np.zeros(len(log.time), bool)
    for start, end in long:
        if noisy or any(np.mean(np.diff(one[start : end + 1]) != 0) > NOISY for one in targets):
            # Of a dead stretch the first reading is one, but at the begin of the log.
            dead[start + (start > 0) : end + 1] = True
    if not dead.any() or dead.all():
        return log
    note = (
        f"{int(dead.sum())} samples repeat the reading before them to the last digit, first at "
        f"{log.time[np.argmax(dead)] - log.time[0]:.4g} s: nothing was read there, and they were left out"
    )
    return take(log, ~dead, (note,))
