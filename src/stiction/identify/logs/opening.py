"""The one door: any log that can be read, by the suffix of its file.

A mapping gives a role a column, `position=qm`, for one joint; or a pattern, `position=q_{joint}`, for several, where
`{joint}` stands for the joint's number or name.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from stiction.core.errors import LogError, unknown_name
from stiction.formats.log import (
    SIGNALS,
    UNNAMED,
    JointSignals,
    Log,
    LogSetup,
    by_joint,
    listed,
    read_setup,
    read_sidecar,
    read_table,
)
from stiction.formats.tables import Columns
from stiction.identify.logs.matlab import read_mat
from stiction.identify.logs.pace import read_pace
from stiction.identify.logs.ros import read_ros

PLACE = "{joint}"
"""What stands for the joint in a pattern."""

ROLES = ("time", *SIGNALS)
"""What a mapping may map in a table."""

TOPICS = ("state", "command")
"""What a mapping may map in a file of messages."""

WIDE = {
    "position": ("joint_pos_{joint}", "dof_pos_{joint}"),
    "velocity": ("joint_vel_{joint}", "dof_vel_{joint}"),
    "target": ("joint_pos_target_{joint}", "des_dof_pos_{joint}"),
    "torque": ("tau_est_{joint}", "tau_{joint}", "torques_{joint}", "torque_{joint}"),
}
"""Role -> patterns, the first that fits counts. `joint_pos_0`, `tau_est_0` and so on are written by public scripts that
log for actuator networks, where `torques` is what the controller asked for and `tau_est` what the motor reports;
`dof_pos` and `des_dof_pos` are the matrices of PACE's files."""

TIMES = ("time", "timestamps", "timestamp", "t")
"""Names that the time has where no mapping says otherwise, the first that fits counts."""


def parse_columns(words: Sequence[str]) -> dict[str, str]:
    """Turn `position=qm` words into role -> column, pattern or topic; raise `LogError` for anything else."""
    mapping: dict[str, str] = {}
    for word in words:
        role, equals, name = word.partition("=")
        if equals and role not in (*ROLES, *TOPICS):
            raise LogError(f"column mapping {word!r}: {unknown_name('role', role, (*ROLES, *TOPICS))}")
        if not equals or not name or role in mapping:
            raise LogError(
                f"column mapping {word!r}: expected ROLE=NAME, once each, ROLE one of {', '.join(ROLES)}, or state and "
                "command for topics"
            )
        mapping[role] = name
    return mapping


def find_signals(
    source: str, table: Columns, columns: Mapping[str, str] | None, joint: str | None
) -> tuple[np.ndarray | None, dict[str, JointSignals]]:
    """Return the time stamps, None where there are none, and joint -> signals; arrays of shape (num_samples,).

    columns: role -> column or pattern, or None to go by names. joint: the name to give a joint whose columns carry
    none. Joints that have only a number are called `joint_0`, `joint_1`, ... Raises `LogError`.
    """
    if columns:
        return _mapped(source, table, columns, joint)
    joints = by_joint(table, joint) or _by_patterns(source, table, _wide_patterns(table))
    if not joints:
        raise LogError(
            f"{source}: no column position, velocity, target or torque; the columns are {listed(table)}; name them "
            "position.<joint> and so on, or map them: position=NAME, or position=NAME_{joint} for several joints"
        )
    return _time(table), joints


def _time(table: Columns) -> np.ndarray | None:
    """Return the time stamps by the usual names; None where there are none."""
    return next((table[name] for name in TIMES if name in table), None)


def _mapped(
    source: str, table: Columns, columns: Mapping[str, str], joint: str | None
) -> tuple[np.ndarray | None, dict[str, JointSignals]]:
    """Follow a mapping."""
    unknown = set(columns) - set(ROLES)
    if unknown:
        raise LogError(unknown_name("role", min(unknown), ROLES))
    signals = {role: name for role, name in columns.items() if role != "time"}
    patterns = {role: name for role, name in signals.items() if PLACE in name}
    if patterns and len(patterns) != len(signals):
        plain = next(role for role in signals if role not in patterns)
        raise LogError(f"{source}: {plain}={signals[plain]} names one column, the others patterns; expected one kind")
    missing = [name for role, name in columns.items() if role not in patterns and name not in table]
    if missing:
        raise LogError(f"{source}: no column {missing[0]!r}; the columns are {listed(table)}")
    time = table[columns["time"]] if "time" in columns else _time(table)
    if patterns:
        return time, _by_patterns(source, table, patterns)
    if not signals:
        raise LogError(f"{source}: the mapping names no signal; expected one of {', '.join(SIGNALS)}, as position=NAME")
    return time, {joint or UNNAMED: JointSignals(**{role: table[name] for role, name in signals.items()})}


def _wide_patterns(table: Columns) -> dict[str, str]:
    """Return role -> the first of its patterns that fits some column."""
    found = {}
    for role, patterns in WIDE.items():
        fitting = next((pattern for pattern in patterns if _match(pattern, table)), None)
        if fitting:
            found[role] = fitting
    return found


def _match(pattern: str, table: Columns, label: str = r"\d{1,4}") -> dict[str, str]:
    """Return label -> column for the columns that fit a pattern.

    label: regular expression of what stands for the joint, by default its number.
    """
    before, _, after = pattern.partition(PLACE)
    expression = re.compile(f"{re.escape(before)}({label}){re.escape(after)}")
    return {match[1]: name for name in table if (match := expression.fullmatch(name))}


def _by_patterns(source: str, table: Columns, patterns: Mapping[str, str]) -> dict[str, JointSignals]:
    """Group columns by joint. A pattern stands for numbered joints if some column has a number there, else for names.

    A column that fits several patterns by a name belongs to the longest one.
    """
    found: dict[str, Columns] = {}
    taken: set[str] = set()
    for role, pattern in sorted(patterns.items(), key=lambda item: -len(item[1])):
        if pattern.count(PLACE) != 1:
            raise LogError(f"{source}: {role}={pattern} has {PLACE} more than once; expected one place for the joint")
        numbered = _match(pattern, table)
        matches = numbered or {label: name for label, name in _match(pattern, table, ".+").items() if name not in taken}
        if not matches:
            raise LogError(f"{source}: no column fits {role}={pattern}; the columns are {listed(table)}")
        taken |= set(matches.values())
        for label, name in matches.items():
            found.setdefault(f"joint_{int(label)}" if numbered else label, {})[role] = table[name]
    order = sorted(found, key=lambda name: (len(name), name) if name.startswith("joint_") else (0, ""))
    return {name: JointSignals(**found[name]) for name in order}


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
    if time is None:
        rate = setup.rate
        if rate is None:
            raise LogError(
                f"{path.name}: no column of time; the columns are {listed(table)}; map one, time=NAME, or give the "
                "rate of the log in Hz (--rate)"
            )
        if not 0 < rate < 1e9:
            raise LogError(f"{path.name}: a rate of {rate} Hz; expected a positive number of samples per second")
        time = np.arange(len(next(iter(table.values())))) / rate
        notes = (*notes, f"the log has no time stamps: {rate:g} Hz was declared, and jitter cannot be seen")
    return Log(path.name, time, _named(path.name, joints, names), notes=notes)


def _named(source: str, joints: dict[str, JointSignals], names: Sequence[str]) -> dict[str, JointSignals]:
    """Give numbered joints their names; raise `LogError` where the names do not fit the joints."""
    if not names or list(joints) == list(names):
        return joints
    if not all(re.fullmatch(r"joint_\d+", name) for name in joints):
        raise LogError(f"{source}: the log names its joints, {', '.join(joints)}; names are for logs that number them")
    if len(names) != len(joints) or len(set(names)) != len(names):
        raise LogError(f"{source}: {len(names)} names for {len(joints)} joints; expected one different name a joint")
    return dict(zip(names, joints.values(), strict=True))
