"""The one door: any log that can be read, by the suffix of its file."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from stiction.formats.errors import LogError
from stiction.formats.log import JointSignals, Log, listed, read_table
from stiction.formats.sidecar import LogSetup, read_setup, read_sidecar
from stiction.formats.tables import Columns
from stiction.identify.logs.columns import TOPICS, find_signals
from stiction.identify.logs.matlab import read_mat
from stiction.identify.logs.pace import read_pace
from stiction.identify.logs.ros import read_ros

KINDS = ".csv, .npz, .parquet, .mcap, .pt or .mat"


def open_log(
    path: Path,
    columns: Mapping[str, str] | None = None,
    joint: str | None = None,
    names: Sequence[str] = (),
    rate: float | None = None,
    sidecar: Path | None = None,
) -> Log:
    """Read a log and its sidecar.

    columns: role -> column or pattern (see `find_signals`), or `state` and `command` -> topic for MCAP. joint: the name
    to give a joint whose columns carry none. names: the joints' names, in order, for a log that only numbers them; by
    default the sidecar's. rate: samples per second [Hz] of a log without time stamps; by default the sidecar's.
    sidecar: where it is, by default beside the log. Raises `LogError` with one line for whatever is wrong with the
    file.
    """
    if path.is_dir():
        raise LogError(f"{path} is a directory; expected a log, a {KINDS} file")
    if not path.is_file():
        raise LogError(f"no log at {path}; expected a {KINDS} file")
    setup = read_setup(path) if sidecar is None else read_sidecar(sidecar)
    suffix = path.suffix.lower()
    topics = sorted(set(columns or ()) & set(TOPICS))
    if suffix == ".mcap":
        log = read_ros(path, columns or {})
    elif topics:
        raise LogError(f"{path.name}: {topics[0]}= names a topic of an MCAP file; for this kind of log map columns")
    else:
        log = _from_table(path, columns, joint, setup if rate is None else replace(setup, rate=rate))
    return replace(log, setup=setup, joints=_named(path.name, log.joints, names or setup.names))


def _from_table(path: Path, columns: Mapping[str, str] | None, joint: str | None, setup: LogSetup) -> Log:
    """Read a log whose samples are rows of a table."""
    table: Columns
    names: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    suffix = path.suffix.lower()
    if suffix == ".mat":
        table = read_mat(path)
    elif suffix == ".pt":
        table, names = read_pace(path)
    elif suffix in (".csv", ".npz", ".parquet"):
        table, notes = read_table(path)
    else:
        raise LogError(f"{path.name}: unknown kind of log {path.suffix!r}; expected {KINDS}")
    time, joints = find_signals(path.name, table, columns, joint)
    samples = len(next(iter(table.values())))
    if time is None and setup.rate is None:
        raise LogError(
            f"{path.name}: no column of time; the columns are {listed(table)}; map one, time=NAME, or give the rate of "
            "the log in Hz (--rate)"
        )
    if time is None:
        time = even_time(path.name, samples, setup.rate)
        notes = (*notes, f"the log has no time stamps: {setup.rate:g} Hz was declared, and jitter cannot be seen")
    return Log(path.name, time, _named(path.name, joints, names), notes=notes)


def even_time(source: str, samples: int, rate: float | None) -> np.ndarray:
    """Return stamps at an even rate [Hz] from zero [s], shape (samples,); raise `LogError` for an impossible rate."""
    if rate is None or not 0 < rate < 1e9:
        raise LogError(f"{source}: a rate of {rate} Hz; expected a positive number of samples per second")
    return np.arange(samples) / rate


def _named(source: str, joints: dict[str, JointSignals], names: Sequence[str]) -> dict[str, JointSignals]:
    """Give numbered joints their names; raise `LogError` where the names do not fit the joints."""
    if not names or list(joints) == list(names):
        return joints
    if not all(re.fullmatch(r"joint_\d+", name) for name in joints):
        raise LogError(f"{source}: the log names its joints, {', '.join(joints)}; names are for logs that number them")
    if len(names) != len(joints) or len(set(names)) != len(names):
        raise LogError(f"{source}: {len(names)} names for {len(joints)} joints; expected one different name a joint")
    return dict(zip(names, joints.values(), strict=True))
