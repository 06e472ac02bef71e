"""The one door: any log that can be read, by the suffix of its file; whatever cannot is told the nearest way in."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import wraps
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from stiction.core.errors import LogError
from stiction.core.files import near_file
from stiction.files.log import (
    BODY,
    TEXT,
    JointSignals,
    Log,
    LogSetup,
    listed,
    read_setup,
    read_sidecar,
    read_table,
    suffix_of,
)
from stiction.files.run_log import find_run_log, joint_log, read_run_log
from stiction.files.tables import Table
from stiction.identification.logs.apart import log_apart, table_apart
from stiction.identification.logs.body import find_body
from stiction.identification.logs.cells import check_stamps, complete_rows, cut, seconds, unwrapped
from stiction.identification.logs.mend import mend
from stiction.identification.logs.naming import TOPICS, find_signals
from stiction.identification.logs.records import read_records
from stiction.identification.timing import stands_still

KINDS = ".csv (.tsv, .txt, .gz), .npz, .parquet, .json, .jsonl, .mcap, .db3, .bag, .pt or .mat"
"""What can be read."""

BAGS = (".mcap", ".db3", ".bag")
"""Files of messages."""

APART = (".mat", ".pt", ".parquet")
"""Tables whose parsers run in a process of their own."""

JSONS = (".json", ".jsonl", ".ndjson", ".json.gz", ".jsonl.gz", ".ndjson.gz")
"""Records as text."""

ELSEWHERE = {
    ".ulg": "a log of PX4: ulog2csv FILE",
    ".h5": "HDF5: in Python numpy.savez('log.npz', time=..., position=...)",
    ".hdf5": "HDF5: in Python numpy.savez('log.npz', time=..., position=...)",
    ".pkl": "a pickle, which would run code and is never opened: where it was made, numpy.savez('log.npz', ...)",
    ".pickle": "a pickle, which would run code and is never opened: where it was made, numpy.savez('log.npz', ...)",
    ".xlsx": "a spreadsheet: save it as CSV",
    ".feather": "Arrow's own file: write it as .parquet",
    ".npy": "one array without names: numpy.savez('log.npz', time=..., position=...)",
    "": "a name without an ending: call it .csv if it is a table of text",
}
"""Suffix that is not read -> what it is, and the nearest way in."""

READ = (*BAGS, *JSONS, *TEXT, *APART, ".npz")
"""How the names of files end that are read."""


Read = TypeVar("Read")


def _unquoted(reader: Callable[..., Read]) -> Callable[..., Read]:
    """Return a reader whose refusal quotes nothing of a file that was reached through a link.

    A log from a stranger may be a link to a file of the reader's, whose words would end in a report.
    """

    @wraps(reader)
    def read(path: Path, *arguments: Any, **named: Any) -> Read:
        try:
            return reader(path, *arguments, **named)
        except LogError as error:
            if not path.is_symlink() or not path.exists():
                raise
            raise LogError(
                f"{path.name}: a link to what cannot be read as this log; give the file itself, whose refusal says why"
            ) from error

    return read


@_unquoted
def open_log(
    path: Path,
    columns: Mapping[str, str] | None = None,
    joint: str | None = None,
    names: Sequence[str] = (),
    rate: float | None = None,
    sidecar: Path | None = None,
    time_scale: float | None = None,
    begin: float | None = None,
    end: float | None = None,
    body: bool = False,
) -> Log:
    """Read a log and its sidecar.

    columns: role -> column or pattern (see `naming`), or `state` and `command` -> topic for bags. joint: the name to
    give a joint whose columns carry none. names: the joints' names, in order, for a log that only numbers them. rate:
    samples per second [Hz] of a log without time stamps. time_scale: seconds per unit of the stamps. begin, end: what
    to take of the log, from its first stamp [s]. Each of these is the sidecar's where it is not given. sidecar: where
    that is, by default beside the log. body: whether to look for the IMU and the feet of a walking robot. Raises
    `LogError` with one line for whatever is wrong with the file, and for what was given of a log that says it itself.
    """
    stamps = {"rate": rate, "time_scale": time_scale}
    check_stamps(path.name, rate, time_scale, begin, end)
    run = find_run_log(path)
    if run is not None and not body:
        own = {"columns": columns, "names": names, "sidecar": sidecar, **stamps}
        _refuse(path.name, own, "is a log of a run, which says it itself")
        log = joint_log(path.name, read_run_log(run))
        return cut(log, begin, end)
    if path.is_dir():
        raise LogError(_of_directory(path))
    if not path.is_file():
        raise LogError(f"no log at {path}{near_file(path) or ';'} expected a {KINDS} file")
    _refuse_kind(path)
    setup = _beside(path) if sidecar is None else read_sidecar(sidecar)
    given: dict[str, Any] = {**stamps, "begin": begin, "end": end}
    setup = replace(setup, **{name: value for name, value in given.items() if value is not None})
    check_stamps(path.name, setup.rate, setup.time_scale, setup.begin, setup.end)
    columns = columns or setup.columns
    suffix = suffix_of(path)
    topics = sorted(set(columns) & set(TOPICS))
    if not body and (odd := sorted({*columns} & {*BODY, "imu"})):
        raise LogError(f"{path.name}: {odd[0]}= is of a walking robot's body; for that kind of log: identify walk")
    if suffix in BAGS:
        _refuse(path.name, stamps, "is a bag, whose messages have stamps")
        log = log_apart(path, columns, body)
    elif topics:
        raise LogError(f"{path.name}: {topics[0]}= names a topic of a bag; for this kind of log map columns")
    else:
        log = _from_table(path, columns, joint, setup, body, stamps)
    log = mend(cut(log, setup.begin, setup.end))
    joints = _named(path.name, log.joints, names or setup.names)
    for name, by_title in zip(joints, map(log.setup.of_joint, log.joints), strict=True):
        known = setup.of_joint(name).to_dict() | {"columns": {}}
        if scales := {key: value for key, value in by_title.to_dict().items() if key not in known}:
            of_joint = replace(setup.joints.get(name, LogSetup()), **scales)
            setup = replace(setup, joints={**setup.joints, name: of_joint})
    return replace(log, setup=setup, joints=joints)


def _beside(path: Path) -> LogSetup:
    """Return what the sidecar beside a log says; what is wrong with it is said of both."""
    try:
        return read_setup(path)
    except LogError as error:
        raise LogError(f"{path.name}, its sidecar: {error}") from error


def _refuse_kind(path: Path) -> None:
    """Refuse a file that is of no kind that is read, and say the nearest way in."""
    if suffix_of(path) not in READ:
        nearest = ELSEWHERE.get(suffix_of(path), "call it .csv if it is a table of text")
        raise LogError(
            f"{path.name}: unknown kind of log {path.suffix!r}; expected {KINDS}. {nearest[0].upper()}{nearest[1:]}"
        )


def _refuse(source: str, given: Mapping[str, Any], why: str) -> None:
    """Raise `LogError` for what was given, and would be of no effect; why: what `source` is or has."""
    for name, value in given.items():
        if value not in (None, (), {}):
            raise LogError(f"{source}: {why}; leave {name} out (--{name.replace('_', '-')})")


def _of_directory(path: Path) -> str:
    """Say what to do with a folder: a bag has its messages in a file."""
    inside = sorted(name for name in path.iterdir() if name.suffix in (*BAGS, ".parquet", ".csv"))
    if inside:
        return f"{path} is a directory; expected a log: name the file in it, {inside[0]}"
    return f"{path} is a directory; expected a log, a {KINDS} file"


@_unquoted
def read_rows(path: Path) -> Table:
    """Read a file whose samples are rows of a table."""
    _refuse_kind(path)
    suffix = suffix_of(path)
    if suffix in APART:
        return table_apart(path, suffix[1:])
    if suffix in JSONS:
        return read_records(path)
    return read_table(path)


def _from_table(
    path: Path,
    columns: Mapping[str, str],
    joint: str | None,
    setup: LogSetup,
    body: bool,
    stamps: Mapping[str, float | None],
) -> Log:
    """Read a log whose samples are rows of a table. stamps: of `setup`, what the caller gave and no sidecar."""
    table = read_rows(path)
    of_body = {role: name for role, name in columns.items() if role in BODY}
    found = find_signals(path.name, table, {role: columns[role] for role in columns if role not in BODY}, joint)
    measured, used = find_body(path.name, table, of_body) if body else (None, ())
    notes = (*table.notes, *found.notes)
    # Empty cells of columns that nobody uses cost no row.
    blank = any(name in table.blanks for name in (*found.used, *used))
    # Stamps of too few digits are as good as none to whoever knows the rate, if each row is a sample.
    standing = found.time is not None and setup.rate is not None and not blank and stands_still(found.time)
    if found.time is None or standing:
        rate = setup.rate
        if rate is None:
            raise LogError(
                f"{path.name}: no column of time; the columns are {listed(table.columns)}; map one, time=NAME, or give "
                "the rate of the log in Hz (--rate)"
            )
        _refuse(path.name, {"time_scale": stamps["time_scale"]}, "has no time stamps to scale")
        time = np.arange(len(next(iter(table.columns.values())))) / rate
        start = 0.0
        why = f"the stamps in {found.time_name} stand still" if standing else "the log has no time stamps"
        said: tuple[str, ...] = (f"{why}: {rate:g} Hz was declared, and jitter cannot be seen",)
    else:
        _refuse(path.name, {"rate": stamps["rate"]}, f"has time stamps, {found.time_name}, and a rate of its own")
        time, start, said = seconds(found.time, found.time_name, setup.time_scale)
        time, wrapped = unwrapped(time)
        said += wrapped
        start += table.starts.get(found.time_name, 0.0)
    joints = _named(path.name, found.joints, table.names)
    setups = {new: found.setups[old] for new, old in zip(joints, found.joints, strict=True) if old in found.setups}
    titled = LogSetup(joints=setups)
    log = Log(path.name, time, joints, titled, (*notes, *said), start, measured)
    return complete_rows(log) if blank else log


def _named(source: str, joints: dict[str, JointSignals], names: Sequence[str]) -> dict[str, JointSignals]:
    """Give numbered joints their names; raise `LogError` where the names do not fit the joints."""
    if not names or list(joints) == list(names):
        return joints
    if not all(re.fullmatch(r"joint_\d+", name) for name in joints):
        raise LogError(f"{source}: the log names its joints, {', '.join(joints)}; names are for logs that number them")
    if len(names) != len(joints) or len(set(names)) != len(names):
        raise LogError(f"{source}: {len(names)} names for {len(joints)} joints; expected one different name a joint")
    return dict(zip(names, joints.values(), strict=True))


def join_logs(logs: Sequence[Log]) -> Log:
    """Return several files, the parts of one log in order, as one log; raise `LogError` where they are not that.

    The stamps must go on from file to file: what begins again at zero is another run.
    """
    first = logs[0]
    if len(logs) == 1:
        return first
    for before, after in pairwise(logs):
        begins, ends = after.start + after.time.min(), before.start + before.time.max()
        if begins <= ends:
            raise LogError(
                f"{after.source}: begins at {begins:.12g} s, and {before.source} ends at {ends:.12g} s: these are "
                "several runs, not parts of one log; leave --join out"
            )
        if list(after.joints) != list(first.joints):
            raise LogError(f"{after.source}: has other joints than {first.source}; expected parts of one log")
    # Every signal is in all parts or in none: joined otherwise, its samples would not be the time's.
    joints = {}
    for name, signals in first.joints.items():
        parts = [log.joints[name] for log in logs]
        present = {role: [getattr(part, role) for part in parts] for role in vars(signals)}
        for role, arrays in present.items():
            if len({array is None for array in arrays}) > 1:
                raise LogError(f"{logs[-1].source}: {role} of joint {name!r} is in some of the files; expected in all")
        joints[name] = JointSignals(
            **{role: None if arrays[0] is None else np.concatenate(arrays) for role, arrays in present.items()}
        )
    notes = dict.fromkeys(note for log in logs for note in log.notes)
    note = f"{len(logs)} files were read as one log: {', '.join(log.source for log in logs)[:160]}"
    return replace(
        first,
        time=np.concatenate([log.start - first.start + log.time for log in logs]),
        joints=joints,
        notes=(note, *notes),
    )
