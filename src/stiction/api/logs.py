"""Logs for identification: from a file of any kind, or from arrays and data frames that are in memory already."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from stiction.api.options import public, several
from stiction.core.errors import LogError, unknown_name
from stiction.core.names import kind_of
from stiction.files.log import SIGNALS, UNNAMED, Log, LogSetup, by_joint, setup_from_dict
from stiction.identification.logs import open_log, parse_columns

SOURCE = "the arrays"
"""Name in messages for a log that was not read from a file."""

OF_FRAME = (*SIGNALS, "time")
"""Names allowed for columns of a data frame, before the dot."""

LONGEST_JOINT_POSITION = 1000.0
"""Angles beyond this are hardly radians [rad]."""


@public
def load_log(
    path: str | Path,
    *,
    columns: Mapping[str, str] | str | Sequence[str] | None = None,
    joint: str | None = None,
    names: str | Sequence[str] = (),
    rate: float | None = None,
    sidecar: str | Path | None = None,
    time_scale: float | None = None,
    begin: float | None = None,
    end: float | None = None,
) -> Log:
    """Read a log of joints: CSV, NPZ, Parquet, JSON, MCAP, `.db3`, `.bag`, `.pt` or MAT, with its sidecar `LOG.json`.

    Args:
        path: the file.
        columns: role -> column, where they are not called `time`, `position.hip`: `{"position": "q_{joint}"}`.
        joint: name to give the joint of a log without names.
        names: names of the joints, in order, of a log that only numbers them.
        rate: samples per second of a log without time stamps [Hz].
        sidecar: a sidecar that does not lie beside the log.
        time_scale: seconds per unit of the stamps.
        begin: where to begin, from the first stamp [s].
        end: where to end, from the first stamp [s].

    Nothing in the file is executed. Raises `LogError` with one line for whatever is wrong with it, and for a setting
    that this kind of log has no use for.

    >>> import stiction
    >>> stiction.load_log("missing.csv")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    stiction.core.errors.LogError: no log at missing.csv; expected a .csv ...

    """
    roles = columns if isinstance(columns, Mapping) else parse_columns(several(columns or ()))
    sidecar_path = None if sidecar is None else Path(sidecar)
    return open_log(Path(path), roles, joint, several(names), rate, sidecar_path, time_scale, begin, end)


def from_arrays(frame: Any = None, **arrays: Any) -> Log:
    """Return a log of what is in memory: arrays, or a data frame of pandas, polars or pyarrow.

    Args:
        frame: in place of the arrays: a table, or a mapping from column to array such as an `.npz` file that is open,
            with the columns `time`, `position.<joint>`, `velocity.<joint>`, `target.<joint>`, `torque.<joint>`. None of
            these libraries is needed.
        arrays: `time` [s], shape (T,), rising; `position` [rad], `velocity` [rad/s], `target` [rad], `torque` [N m],
            `disturbance`, `feedforward` [N m]: an array of shape (T,) for one joint, of shape (T, joints) for several,
            which `names`, or `joints`, names in the order of the columns, or a mapping from joint to array.
            And what a sidecar says: `kp` [N m/rad], `kd` [N m s/rad], `torque_limit` [N m], `test_condition`, ...:
            a number, one a joint in the order of their names, or a mapping from joint to number.

    Raises `LogError`: an array of another shape than (T,) or (T, joints), values that are no numbers or not finite,
    time that does not rise, an angle that can hardly be in radians, a name that there is not.

    >>> import numpy as np
    >>> import stiction
    >>> time = np.arange(1000) / 500
    >>> log = stiction.from_arrays(time=time, position={"hip": np.sin(time)}, torque={"hip": np.cos(time)}, kp=20.0)
    >>> list(log.joints), log.setup.kp
    (['hip'], 20.0)
    >>> both = np.stack((np.sin(time), np.cos(time)), axis=1)  # shape (T, joints)
    >>> log = stiction.from_arrays(time=time, position=both, target=both, names=["hip", "knee"], kp=[20.0, 30.0])
    >>> log.setup_of("knee").kp
    30.0
    >>> stiction.from_arrays(time=time, position=np.zeros(999))
    Traceback (most recent call last):
    stiction.core.errors.LogError: the arrays: position of joint 'joint' has the shape (999,); expected (1000,), as time

    """
    table = {} if frame is None else _columns_of(frame)
    known = ("time", *SIGNALS, *(item.name for item in fields(LogSetup)))
    for name in arrays:
        if name not in known:
            raise LogError(f"{SOURCE}: {unknown_name('name', name, known)}")
    names = _take_names(arrays)
    counts = [np.shape(arrays[name])[1] for name in SIGNALS if np.ndim(arrays.get(name, 0)) == 2]
    names = names or tuple(f"joint_{index}" for index in range(max(counts, default=0)))
    for name in OF_FRAME:
        value = arrays.pop(name, None)
        if value is None:
            continue
        whose = list(value.items()) if isinstance(value, Mapping) else [(None, value)]
        if whose[0][0] is None and name != "time" and np.ndim(value) < 3:
            matrix = np.reshape(value, (-1, 1)) if np.ndim(value) < 2 else np.asarray(value)
            whose = _by_column(name, matrix, names) if names else whose
        for joint, array in whose:
            table[name if joint is None else f"{name}.{joint}"] = array
    if "time" not in table:
        raise LogError(f"{SOURCE}: no time; expected time [s], a value a sample")
    time = _checked_time(_numbers("time", table.pop("time")))
    checked = {name: _signal(name, values, len(time)) for name, values in table.items()}
    if not checked:
        raise LogError(f"{SOURCE}: no signal of a joint; expected position, and target or torque, of at least one")
    joints = by_joint(checked, None)
    return Log(SOURCE, time, joints, _setup(arrays, joints))


def _take_names(arrays: dict[str, Any]) -> tuple[str, ...]:
    """Take the names of the joints out of the arguments, and turn numbers in their order into mappings."""
    key = "names" if "names" in arrays else "joints"
    if isinstance(arrays.get(key, {}), Mapping):
        return ()
    names = several(arrays.pop(key))
    for field, value in arrays.items():
        numbers = isinstance(value, list | tuple | np.ndarray) and np.asarray(value).dtype.kind in "fiu"
        if numbers and field not in OF_FRAME and np.size(value) > 1:
            if np.shape(value) != (len(names),):
                raise LogError(
                    f"{SOURCE}: {field} has the shape {np.shape(value)}; expected ({len(names)},), a number a joint"
                )
            arrays[field] = {joint: each.item() if hasattr(each, "item") else each for joint, each in zip(names, value)}
    return names


def _by_column(name: str, matrix: np.ndarray, joints: Sequence[str]) -> list[tuple[str | None, Any]]:
    """Return the columns of a signal of several joints, shape (T, joints), by joint."""
    if len(joints) != matrix.shape[1]:
        turn = f"; do: {name}.T" if len(joints) == len(matrix) else ""
        raise LogError(
            f"{SOURCE}: {name} has the shape {matrix.shape} and names has {len(joints)}; expected (T, joints), "
            f"and a name for each{turn}"
        )
    return list(zip(joints, matrix.T, strict=True))


def _columns_of(frame: Any) -> dict[str, Any]:
    """Return the columns of a table that a log has; pandas, polars, pyarrow and mappings agree on this much."""
    names = getattr(frame, "column_names", None)  # of pyarrow, whose `columns` are the data
    names = list(getattr(frame, "columns", frame if isinstance(frame, Mapping) else ()) if names is None else names)
    if not names or not all(isinstance(name, str) for name in names):
        raise LogError(
            f"{SOURCE}: {type(frame).__name__} is no table with named columns; expected a data frame of pandas, polars "
            "or pyarrow, a mapping, or arrays by name: time=..., position=..."
        )
    columns = {name: frame[name] for name in names if name.partition(".")[0] in OF_FRAME}
    if "time" not in columns:
        raise LogError(f"{SOURCE}: no column time among {', '.join(names[:20])}; rename it")
    return columns


def _numbers(name: str, values: Any) -> np.ndarray:
    """Return values as an array of numbers of shape (T,), all finite."""
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise LogError(
            f"{SOURCE}: {name} is {type(values).__name__}, not numbers ({error}); expected an array"
        ) from error
    if array.ndim != 1 or not len(array):
        raise LogError(f"{SOURCE}: {name} has the shape {array.shape}; expected (T,), one value a sample")
    bad = np.flatnonzero(~np.isfinite(array))
    if len(bad):
        raise LogError(
            f"{SOURCE}: {name} is {array[bad[0]]} at sample {bad[0]}, and at {len(bad) - 1} more; expected finite "
            "numbers: leave those samples out of all arrays"
        )
    return array


def _checked_time(time: np.ndarray) -> np.ndarray:
    """Return the stamps; refuse those that do not rise, and what can hardly be seconds."""
    steps = np.diff(time)
    if len(time) < 2 or (steps <= 0).any():
        where = int(np.argmax(steps <= 0)) + 1 if len(time) > 1 else 0
        raise LogError(
            f"{SOURCE}: time does not rise at sample {where}; expected at least two stamps, each later than the one "
            "before: sort the samples, and leave out doubled ones"
        )
    if np.median(steps) > 0.1:
        raise LogError(
            f"{SOURCE}: samples are {np.median(steps):.4g} apart; in seconds that is too slow for a joint: is time in "
            "ms or µs? Expected [s]"
        )
    return time - time[0]


def _signal(name: str, values: Any, count: int) -> np.ndarray:
    """Return one signal of one joint."""
    role, _, joint = name.partition(".")
    label = f"{role} of joint {joint or UNNAMED!r}"
    array = _numbers(label, values)
    if len(array) != count:
        raise LogError(f"{SOURCE}: {label} has the shape {array.shape}; expected ({count},), as time")
    if role in ("position", "target") and np.ptp(array) > LONGEST_JOINT_POSITION:
        raise LogError(
            f"{SOURCE}: {label} spans {np.ptp(array):.4g}; expected [rad]: is it in counts? Multiply it by rad per "
            "count"
        )
    return array


def _setup(settings: dict[str, Any], joints: Mapping[str, Any]) -> LogSetup:
    """Return what a sidecar would say; a mapping from joint, or its kind, to value is what is different for each."""
    own = settings.pop("joints", {})
    data: dict[str, Any] = {"joints": dict(own) if isinstance(own, Mapping) else own}
    for name, value in settings.items():
        if isinstance(value, Mapping) and name != "columns":
            for joint, one in value.items():
                data["joints"].setdefault(joint, {})[name] = one
        else:
            data[name] = value
    for joint in data["joints"] if isinstance(own, Mapping) else ():
        if joint not in {*joints, *map(kind_of, joints)}:
            raise LogError(f"{SOURCE}: {unknown_name('joint', str(joint), joints)}")
    return setup_from_dict(data, SOURCE)


def as_log(log: Any) -> Log:
    """Return a log: itself, a file's by its path, or a data frame's."""
    if isinstance(log, Log):
        return log
    if log is None:
        raise LogError("no log given; expected one of load_log or from_arrays, a path, or a data frame")
    return load_log(log) if isinstance(log, str | Path) else from_arrays(log)


__all__ = ["Log", "as_log", "from_arrays", "load_log"]
