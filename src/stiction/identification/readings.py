"""Repeated readings of a log: a log that is faster than the bus holds each reading over several rows.

A reading counts once, at the row in which it changes. A coarse encoder repeats too, and so does a joint at rest: but
they go on by single steps of the encoder, and a held reading by the many steps that the joint has made in between.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from stiction.files.log import SIGNALS, JointSignals, Log
from stiction.identification.filters import low_pass
from stiction.identification.timing import fastest_motion

READINGS = ("position", "velocity", "torque")
"""Roles that are measured; a command is held by its receiver too."""

FEWEST_LARGE = 20
"""Fewest large changes for a column to show whether it is held, if they are a fifth of all changes, too."""


def fresh_rows(time: np.ndarray, values: np.ndarray, excused: np.ndarray | None = None) -> np.ndarray | None:
    """Return the rows with a new reading, None where every row has one.

    time [s], in order, and values: shape (num_samples,). excused: rows whose change another column explains (bool).
    """
    steps = np.diff(values)
    changed = np.flatnonzero(steps) + 1
    if len(changed) < FEWEST_LARGE:
        return None
    sizes = np.abs(steps[changed - 1])
    # Four steps of the sensor no joint makes from one row to the next after standing still for a row.
    large = (sizes >= 4 * np.percentile(sizes, 1)) & (changed > 1)
    if excused is not None:
        large &= ~excused[changed]
    after_repeat = steps[changed[large] - 2] == 0
    if large.sum() < max(FEWEST_LARGE, 0.2 * len(changed)) or after_repeat.mean() < 0.1:
        return None
    # Over more than three usual holds a small step shows a joint at rest, whose readings are equal: taken at the usual
    # hold, they keep the line between them flat.
    rows, hold = [0], float(np.median(np.diff(time[changed])))
    ends = time[changed]
    for start, end, is_large in zip(np.concatenate(([time[0]], ends)), ends, large, strict=False):
        if not is_large and end - start > 3 * hold:
            rows += np.searchsorted(time, np.arange(start + hold, end - 0.5 * hold, hold)).tolist()
    rows += np.searchsorted(time, np.arange(ends[-1] + hold, time[-1], hold)).tolist()
    return np.unique(np.concatenate([rows, changed]).astype(int))


def take_readings(
    time: np.ndarray, table: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, dict[str, np.ndarray], tuple[str, ...]]:
    """Return stamps and signals with every reading once, all at the rows of the slowest one, and notes on it.

    time [s], shape (num_samples,); table: role, or `role.joint` -> signal, same shape.
    """
    if len(time) < 2 or not (np.diff(time) > 0).all():
        return time, dict(table), ()
    fresh: dict[str, np.ndarray] = {}
    for name, values in table.items():
        role, _, joint = name.partition(".")
        if role not in READINGS:
            continue
        target = table.get(f"target.{joint}" if joint else "target")
        excused = None if role != "torque" or target is None else np.append(False, np.diff(target) != 0)
        rows = fresh_rows(time, values, excused if excused is not None and excused.mean() < 0.5 else None)
        if rows is not None:
            fresh[name] = rows
    for name in [name for name in fresh if name.startswith("torque")]:
        position = f"position{name.removeprefix('torque')}"
        if position in table and position not in fresh and _is_command(time, table[position], table[name], fresh[name]):
            del fresh[name]
    if not fresh:
        return time, dict(table), ()
    # The velocity enters no regression, so that the others need not wait for it.
    clocks = {name: rows for name, rows in fresh.items() if not name.startswith("velocity")}
    rows = min(clocks.values(), key=len) if clocks else np.arange(len(time))
    taken = {
        name: values[rows]
        if name not in fresh or np.array_equal(fresh[name], rows)
        else _at(time, values, fresh[name], rows)
        for name, values in table.items()
    }
    named = sorted({name.partition(".")[0] for name in fresh})
    hold = float(np.median([np.median(np.diff(time[rows])) for rows in fresh.values()]))
    note = f"rows repeat the last reading of {' and '.join(named)}: each was used once, one every {hold:.3g} s"
    note += f", {len(rows)} of {len(time)} rows" * bool(clocks)
    return time[rows], taken, (note,)


def read_once(log: Log) -> Log:
    """Return a log whose joints' readings are all taken once, at the rows of the slowest one, for joints in one fit."""
    table = {
        f"{role}.{name}": values
        for name, signals in log.joints.items()
        for role, values in vars(signals).items()
        if values is not None
    }
    time, taken, notes = take_readings(log.time, table)
    joints = {name: JointSignals(**{role: taken.get(f"{role}.{name}") for role in SIGNALS}) for name in log.joints}
    return replace(log, time=time, joints=joints, notes=(*log.notes, *notes)) if notes else log


def _at(time: np.ndarray, values: np.ndarray, fresh: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return a held signal at other rows, by a cubic spline through its readings."""
    # Imported here, for few logs need it, and it takes long.
    from scipy.interpolate import make_interp_spline

    inside = np.clip(time[rows], time[fresh[0]], time[fresh[-1]])
    return make_interp_spline(time[fresh], values[fresh], k=3)(inside)


def _is_command(time: np.ndarray, position: np.ndarray, torque: np.ndarray, fresh: np.ndarray) -> bool:
    """Return True if a held torque acted as it stands: a reading that is held comes half a hold late.

    A command is in time. The lateness t of I θ'' + B θ' + f sign θ' + gravity = τ + t dτ/dt tells, by least squares.
    """
    step = float(np.median(np.diff(time)))
    hold = float(np.median(np.diff(time[fresh])))
    even = np.arange(time[0], time[-1], step)
    angle = np.interp(even, time, position)
    corner = min(0.5 / hold, 5 * (fastest_motion(angle, step) or np.inf))
    corner = min(0.45 / step, corner)
    angle = low_pass(angle, corner, step)
    velocity = np.gradient(angle, step)
    direction = low_pass(np.sign(velocity), corner, step)
    place = np.clip(np.searchsorted(time, even, side="right") - 1, 0, len(time) - 1)
    driven = low_pass(torque[place], corner, step)
    columns = [np.gradient(velocity, step), velocity, direction, np.sin(angle), np.cos(angle), np.ones_like(angle)]
    solution, *_ = np.linalg.lstsq(np.column_stack([*columns, -np.gradient(driven, step)]), driven, rcond=None)
    return float(solution[-1]) < 0.05 * hold
