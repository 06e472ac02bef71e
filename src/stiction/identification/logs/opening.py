"""Opening of any supported log by the suffix of its file, with advice for the other kinds."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import LogError
from stiction.core.files import near_file
from stiction.files.log import (
    BODY,
    SIGNALS,
    TEXT,
    JointSignals,
    Log,
    LogSetup,
    listed,
    read_setup,
    read_sidecar,
    read_table,
    sidecar_of,
    suffix_of,
)
from stiction.files.tables import Table
from stiction.identification.logs.naming import TOPICS, find_body, find_signals
from stiction.identification.logs.rows import check_stamps, complete_rows, cut, mend, seconds
from stiction.identification.timing import stands_still

KINDS = ".csv (.tsv, .txt, .gz), .npz, .parquet, .json, .jsonl, .mcap, .db3, .bag, .mat or .pt"
"""Supported kinds of file."""

BAGS = (".mcap", ".db3", ".bag")
APART = (".mat", ".parquet", ".pt", *BAGS)
JSONS = (".json", ".jsonl", ".ndjson", ".json.gz", ".jsonl.gz", ".ndjson.gz")
"""Suffixes of files of messages, of files that are read in a process of their own, and of records as text."""

ELSEWHERE = {
    ".ulg": "a log of PX4: ulog2csv FILE",
    **dict.fromkeys((".h5", ".hdf5"), "HDF5: in Python numpy.savez('log.npz', time=..., position=...)"),
    **dict.fromkeys(
        (".pkl", ".pickle"),
        "a pickle, which would run code and is never opened: where it was made, numpy.savez('log.npz', ...)",
    ),
    ".pth": "tensors of PyTorch: where torch is, numpy.savez('log.npz', **torch.load(FILE, weights_only=True))",
    ".xlsx": "a spreadsheet: save it as CSV",
    ".feather": "Arrow's own file: write it as .parquet",
    ".npy": "one array without names: numpy.savez('log.npz', time=..., position=...)",
    "": "a name without an ending: call it .csv if it is a table of text",
}
"""Unsupported suffix -> kind of file, and the nearest way to a supported one."""


def read_rows(path: Path, topics: Mapping[str, str] | None = None, body: bool = False) -> Table:
    """Read a file as columns, rows of samples. Raises `LogError`.

    topics, body: for a bag, whose rows are those of its joint states, see `bags.read_bag`.
    """
    suffix = suffix_of(path)
    with _unquoted(path):
        if suffix not in (*TEXT, ".npz", *JSONS, *APART):
            nearest = ELSEWHERE.get(suffix, "call it .csv if it is a table of text")
            raise LogError(
                f"{path.name}: unknown kind of log {path.suffix!r}; expected {KINDS}. {nearest[0].upper()}{nearest[1:]}"
            )
        # What is rare is imported where it is needed.
        if suffix in APART:
            from stiction.identification.logs.apart import read_apart

            return read_apart(path, {"topics": dict(topics or {}), "body": body} if suffix in BAGS else {})
        if suffix in JSONS:
            from stiction.identification.logs.records import read_records

            return read_records(path)
        return read_table(path)


@contextmanager
def _unquoted(path: Path) -> Iterator[None]:
    """Hide the content of a file that was reached through a link from messages.

    A log or sidecar from a stranger may be a link to a private file, whose words would end in a report.
    """
    try:
        yield
    except LogError:
        if not path.is_symlink() or not path.exists():
            raise
        refusal = "a link to what cannot be read as a log or its sidecar; give the file itself, whose refusal says why"
        raise LogError(f"{path.name}: {refusal}") from None


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
    samples per second [Hz] of a log without time stamps. time_scale: seconds per unit of the stamps. begin, end: used
    part of the log, from its first stamp [s]. Each of these is taken from the sidecar where it is not given. sidecar:
    its path, by default next to the log. body: True to look for the IMU and the feet of a walking robot. Raises
    `LogError` with one line for whatever is wrong with the file, and for an option that the log itself answers.
    """
    options = {"rate": rate, "time_scale": time_scale, "begin": begin, "end": end}
    with _unquoted(path):
        if path.is_dir() and not body:
            from stiction.files.run_log import find_run_log, joint_log, read_run_log

            if (run := find_run_log(path)) is not None:
                useless = {"columns": columns, "names": names, "sidecar": sidecar, "rate": rate}
                _refuse(path.name, useless | {"time_scale": time_scale}, "is a log of a run, which says it itself")
                return cut(joint_log(path.name, read_run_log(run)), begin, end)
        refuse_absent(path)
        with _unquoted(sidecar or sidecar_of(path)):
            setup = _declared(path, sidecar)
        known: dict[str, Any] = {name: value for name, value in options.items() if value is not None}
        setup = replace(setup, **known)
        check_stamps(path.name, setup)
        return _read(path, columns or setup.columns, joint, names or setup.names, setup, options, body)


def refuse_absent(path: Path) -> None:
    """Raise `LogError` for a folder, and for a missing file."""
    if path.is_dir():
        inside = sorted(name for name in path.iterdir() if name.suffix in (*BAGS, ".parquet", ".csv"))
        expected = f"pass a log file, e.g. {inside[0]}" if inside else f"expected a {KINDS} file"
        raise LogError(f"{path} is a directory; {expected}")
    if not path.is_file():
        raise LogError(f"no log at {path}{near_file(path) or ';'} expected a {KINDS} file")


def _declared(path: Path, sidecar: Path | None) -> LogSetup:
    """Return the content of a sidecar; name the log, too, in an error of the sidecar next to it."""
    try:
        return read_setup(path) if sidecar is None else read_sidecar(sidecar)
    except LogError as error:
        raise LogError(f"{path.name}, its sidecar: {error}") from error


def _refuse(source: str, options: Mapping[str, Any], why: str) -> None:
    """Raise `LogError` for options without effect; why: reason, a predicate of `source`."""
    for name, value in options.items():
        if value not in (None, (), {}):
            raise LogError(f"{source}: {why}; leave {name} out (--{name.replace('_', '-')})")


def _read(
    path: Path,
    columns: Mapping[str, str],
    joint: str | None,
    names: Sequence[str],
    setup: LogSetup,
    options: Mapping[str, float | None],
    body: bool,
) -> Log:
    """Read a log as `open_log` does. setup: all that is known of it; options: the caller's, without a sidecar."""
    source, is_bag = path.name, suffix_of(path) in BAGS
    if not body and (odd := sorted({*columns} & {*BODY, "imu"})):
        raise LogError(f"{source}: {odd[0]}= is of a walking robot's body; for that kind of log: identify walk")
    rate, scale = {"rate": options["rate"]}, {"time_scale": options["time_scale"]}
    if is_bag:
        _refuse(source, rate | scale, "is a bag, whose messages have stamps")
        table, columns = read_rows(path, columns, body), {}
    else:
        table = read_rows(path)
        if topics := sorted(set(columns) & set(TOPICS)):
            raise LogError(f"{source}: {topics[0]}= names a topic of a bag; for this kind of log map columns")
    signals = find_signals(source, table, {role: columns[role] for role in columns if role not in BODY}, joint)
    of_body = {role: columns[role] for role in columns if role in BODY}
    measured, used = find_body(source, table, of_body) if body else (None, ())
    # Empty cells of columns that nobody uses cost no row.
    blank = any(name in table.blanks for name in (*signals.used, *used))
    # Stamps of too few digits are as good as none if the rate is known and each row is a sample.
    standing = signals.time is not None and setup.rate is not None and not blank and stands_still(signals.time)
    if signals.time is None or standing:
        if setup.rate is None:
            raise LogError(
                f"{source}: no column of time; the columns are {listed(table.columns)}; map one, time=NAME, or give "
                "the rate of the log in Hz (--rate)"
            )
        _refuse(source, scale, "has no time stamps to scale")
        time, start = np.arange(len(next(iter(table.columns.values())))) / setup.rate, 0.0
        why = f"the stamps in {signals.time_name} stand still" if standing else "the log has no time stamps"
        time_notes: tuple[str, ...] = (f"{why}: {setup.rate:g} Hz was declared, and jitter cannot be seen",)
    else:
        _refuse(source, rate, f"has time stamps, {signals.time_name}, and a rate of its own")
        time, start, time_notes = seconds(signals.time, signals.time_name, 1.0 if is_bag else setup.time_scale)
        start += table.starts.get(signals.time_name, 0.0)
    log = Log(source, time, signals.joints, setup, (*table.notes, *signals.notes, *time_notes), start, measured)
    log = mend(cut(complete_rows(log) if blank else log, setup.begin, setup.end))
    joints = _named(source, log.joints, names)
    # The unit in a title counts where no other one was declared.
    of_joints = dict(setup.joints)
    for name, titled in zip(joints, map(signals.setups.get, log.joints), strict=True):
        known = setup.of_joint(name).to_dict()
        if titled and (scales := {key: value for key, value in titled.to_dict().items() if key not in known}):
            of_joints[name] = replace(setup.joints.get(name, LogSetup()), **scales)
    return replace(log, setup=replace(setup, joints=of_joints), joints=joints)


def _named(source: str, joints: dict[str, JointSignals], names: Sequence[str]) -> dict[str, JointSignals]:
    """Name numbered joints; raise `LogError` where the names do not fit the joints."""
    if not names or list(joints) == list(names):
        return joints
    if not all(re.fullmatch(r"joint_\d+", name) for name in joints):
        raise LogError(f"{source}: the log names its joints, {', '.join(joints)}; names are for logs that number them")
    if len(names) != len(joints) or len(set(names)) != len(names):
        raise LogError(f"{source}: {len(names)} names for {len(joints)} joints; expected one different name a joint")
    return dict(zip(names, joints.values(), strict=True))


def join_logs(logs: Sequence[Log]) -> Log:
    """Return several files, the parts of one log in order, as one log; raise `LogError` where they are not.

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
    joints = {}
    for name in first.joints:
        joined = {}
        for role in SIGNALS:
            arrays = [array for log in logs if (array := getattr(log.joints[name], role)) is not None]
            # In all parts or in none: joined otherwise, its samples would not be the time's.
            if len(arrays) not in (0, len(logs)):
                raise LogError(f"{logs[-1].source}: {role} of joint {name!r} is in some of the files; expected in all")
            joined[role] = np.concatenate(arrays) if arrays else None
        joints[name] = JointSignals(**joined)
    time = np.concatenate([log.start - first.start + log.time for log in logs])
    note = f"{len(logs)} files were read as one log: {', '.join(log.source for log in logs)[:160]}"
    notes = dict.fromkeys(note for log in logs for note in log.notes)
    return replace(first, time=time, joints=joints, notes=(note, *notes))
