"""Formats with native or complex parsers, read in a process of its own with bounded memory and time.

A file from a stranger can crash such a parser, or have it take what there is. The process reads one file, writes arrays
and plain facts on its standard output, and ends.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import LogError
from stiction.core.isolation import run_apart
from stiction.core.memory import SHARES, allowance, bound, limit_memory
from stiction.files.log import BODY, SIGNALS, BodySignals, JointSignals, Log
from stiction.files.tables import Table, read_parquet

SECONDS = 120
"""Processor time that reading one file may take [s]; an hour of twelve joints at 1 kHz takes ten."""

PATIENCE = 600.0
"""Longest that it may take on a machine that is busy with other things [s]."""


@dataclass(frozen=True)
class Parcel:
    """What comes back: arrays of numbers, and facts that JSON can hold."""

    arrays: dict[str, np.ndarray]
    """Name -> numbers, of any shape."""
    facts: dict[str, Any] = field(default_factory=dict)
    """Name -> text, numbers, lists and objects of these."""


def read_apart(path: Path, kind: str, options: Mapping[str, Any]) -> Parcel:
    """Read a file in another process. kind: one of `_kinds`; options: of its reader. Raises `LogError`."""
    words = (kind, path, allowance() * SHARES, json.dumps(dict(options)))
    try:
        done = run_apart("stiction.identification.logs.apart", PATIENCE, words)
    except subprocess.TimeoutExpired as error:
        raise LogError(f"{path.name}: reading it took more than {PATIENCE:.0f} s; export it as CSV or NPZ") from error
    except OSError as error:
        raise LogError(f"{path.name}: no process can be started to read it: {error.strerror or error}") from error
    if done.returncode != 0:
        raise LogError(
            f"{path.name}: its reader broke down within {SECONDS} s of processor time and the memory limit (status "
            f"{done.returncode}): the file is damaged, or too large; get it again, or export it as CSV or NPZ"
        )
    head, _, data = done.stdout.partition(b"\n")
    facts = json.loads(head)
    if "refusal" in facts:
        raise LogError(facts["refusal"])
    arrays, place = {}, 0
    for name, shape in facts.pop("arrays"):
        count = int(np.prod(shape))
        arrays[name] = np.frombuffer(data, "<f8", count, place).reshape(shape)
        place += 8 * count
    return Parcel(arrays, facts)


def table_apart(path: Path, kind: str) -> Table:
    """Read a table in another process; raise `LogError`."""
    parcel = read_apart(path, kind, {})
    facts = dict(parcel.facts)
    rows = facts.pop("rows")
    columns = {name: parcel.arrays.get(name, np.broadcast_to(np.nan, rows)) for name in facts.pop("order")}
    return Table(columns, **facts | {"notes": tuple(facts["notes"]), "names": tuple(facts["names"])})


def log_apart(path: Path, topics: Mapping[str, str], body: bool) -> Log:
    """Read a bag as `ros.read_ros` does, in another process; raise `LogError`."""
    parcel = read_apart(path, "bag", {"topics": dict(topics), "body": body})
    arrays, facts = parcel.arrays, parcel.facts
    joints = {
        name: JointSignals(**{role: arrays.get(f"{role}.{index}") for role in SIGNALS})
        for index, name in enumerate(facts["joints"])
    }
    signals: dict[str, Any] = {name: arrays.get(name) for name in BODY}
    measured = BodySignals(**signals, foot_names=tuple(facts["feet"]), period=facts["period"]) if body else None
    return Log(path.name, arrays["time"], joints, notes=tuple(facts["notes"]), start=facts["start"], body=measured)


def _packed_log(log: Log) -> Parcel:
    """Return a log for `log_apart`."""
    arrays = {"time": log.time}
    for index, signals in enumerate(log.joints.values()):
        arrays |= {f"{role}.{index}": values for role in SIGNALS if (values := getattr(signals, role)) is not None}
    body = log.body or BodySignals()
    arrays |= {name: values for name in BODY if (values := getattr(body, name)) is not None}
    facts = {"joints": list(log.joints), "notes": log.notes, "start": log.start}
    return Parcel(arrays, facts | {"feet": body.foot_names, "period": body.period})


def _packed(table: Table) -> Parcel:
    """Return a table for `table_apart`; columns with a fault are named, and not sent."""
    facts = {name: value for name, value in vars(table).items() if name != "columns"}
    rows = len(next(iter(table.columns.values())))
    arrays = {name: values for name, values in table.columns.items() if name not in table.faults}
    return Parcel(arrays, {**facts, "rows": rows, "order": list(table.columns)})


def _kinds() -> dict[str, Callable[..., Parcel]]:
    """Return kind of file -> what reads it; imported where it runs, in its own process."""
    from stiction.identification.logs.matlab import read_mat
    from stiction.identification.logs.pace import read_pace
    from stiction.identification.logs.ros import read_ros

    return {
        "mat": lambda path: _packed(read_mat(path)),
        "pt": lambda path: _packed(read_pace(path)),
        "parquet": lambda path: _packed(read_parquet(path)),
        "bag": lambda path, topics, body: _packed_log(read_ros(path, topics, body)),
    }


def main(words: list[str]) -> None:
    """Read one file and write what `read_apart` expects; words: its kind, path, memory [B], and options as JSON."""
    kind, path, memory, options = words
    bound(resource.RLIMIT_CPU, SECONDS)
    bound(resource.RLIMIT_CORE, 0)
    # Whatever a library prints must not reach the parcel.
    output, sys.stdout = sys.stdout.buffer, sys.stderr
    try:
        with limit_memory(int(memory)):
            parcel = _kinds()[kind](Path(path), **json.loads(options))
            facts = parcel.facts | {"arrays": [(name, values.shape) for name, values in parcel.arrays.items()]}
            output.write(json.dumps(facts).encode() + b"\n")
            for values in parcel.arrays.values():
                output.write(np.ascontiguousarray(values, "<f8").data)
    except LogError as error:
        output.write(json.dumps({"refusal": str(error)}).encode() + b"\n")
    output.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
