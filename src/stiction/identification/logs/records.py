"""Logs in JSON: an object of arrays, a list of records, or a record a line; nested names are joined by dots.

A JSON file may also be no log at all: what this program and others write is recognised, and named.
"""

from __future__ import annotations

import gzip
import json
import zlib
from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import LogError
from stiction.core.files import open_regular
from stiction.core.memory import check_ratio, claim
from stiction.files.tables import Table, table_of
from stiction.files.text import LONGEST_LINE, MOST_COLUMNS

BLOWUP = 24
"""Bytes that a byte of JSON takes at most once it is parsed: `{},` is an object of 64 and a pointer of 8."""

ARE = (
    ({"schema_version", "joints"}, "a result of `stiction identify` (joints.json): give the log that it came from"),
    ({"method", "level"}, "a proposal for training (training.json): give it to `stiction train --friction-from`"),
    ({"observation", "joint_names"}, "the contract of a policy bundle: give the folder to `stiction verify`"),
    ({"info", "features"}, "a description of a dataset; the log itself is the .parquet file beside it"),
    ({"codebase_version", "features"}, "the meta/info.json of a LeRobot data set; the log is a .parquet file in data"),
)
"""Keys -> what the file is that has them."""

ROWS = ("records", "data", "samples", "rows", "frames", "log", "messages")
"""Keys under which others keep the list of records."""


def read_records(path: Path) -> Table:
    """Read a log in JSON. Raises `LogError`, which says what the file is where it is no log."""
    try:
        if path.name.lower().removesuffix(".gz").endswith(".json"):
            return _of_document(path)
        return _of_rows(path.name, _lines(path))
    # Deep nesting ends in a RecursionError, a .gz that was cut off in an EOFError.
    except (ValueError, OverflowError, RecursionError, EOFError, zlib.error) as error:
        raise LogError(f"{path.name}: not JSON ({str(error)[:120]}); expected arrays, or records") from error
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror or error}") from error


def _bytes(path: Path) -> Iterator[bytes]:
    """Yield the file's bytes, unpacked where it is packed, block by block."""
    packed, seen = path.stat().st_size, 0
    with open_regular(path) as opened, gzip.open(opened) if path.name.lower().endswith(".gz") else opened as file:
        while block := file.read(2**19):
            seen += len(block)
            check_ratio(path.name, packed, seen, LogError)
            yield block


def _of_document(path: Path) -> Table:
    """Read one JSON value."""
    content = bytearray()
    for block in _bytes(path):
        content += block
        claim(path.name, BLOWUP * len(content), "as JSON it would take", LogError)
    # With a byte order mark, as Windows writes it, or without.
    data = json.loads(content.decode("utf-8-sig"))
    if isinstance(data, dict):
        for keys, what in ARE:
            if keys <= data.keys():
                raise LogError(f"{path.name}: this is {what}")
        rows = next((data[key] for key in ROWS if isinstance(data.get(key), list)), None)
        if rows is None:
            return _of_arrays(path.name, data)
        data = rows
    if not isinstance(data, list) or not data or not all(isinstance(row, dict) for row in data):
        raise LogError(
            f"{path.name}: holds a {type(data).__name__}; expected an object of arrays, or a list of records"
        )
    return _of_rows(path.name, iter(data))


def _of_arrays(source: str, data: dict[str, Any]) -> Table:
    """Read an object whose values are lists of numbers, or lists of such lists."""
    arrays = {}
    for name, value in _leaves(data):
        if isinstance(value, list) and value:
            try:
                found = np.array(value, dtype=float)
            except (ValueError, TypeError):
                continue
            if found.ndim <= 2:
                arrays[name] = found
    if not arrays:
        keys = ", ".join(str(key)[:30] for key in list(data)[:12])
        raise LogError(
            f"{source}: an object with {keys or 'nothing'} and no arrays of numbers: that is no log; a sidecar is read "
            "beside its log, or by --sidecar"
        )
    return table_of(source, arrays)


def _leaves(data: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield what stands in nested objects, by names joined with dots."""
    for name, value in data.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the records of a file with one a line; a last line without an end must be whole."""
    rest, number = b"", 0
    for block in _bytes(path):
        *lines, rest = (rest + block).split(b"\n")
        # The rest counts too, or a file without line ends would be gathered whole.
        if len(rest) > LONGEST_LINE or max(map(len, lines), default=0) > LONGEST_LINE:
            raise LogError(f"{path.name}: a line of over {LONGEST_LINE} bytes; expected a record a line")
        for line in lines:
            number += 1
            if line.strip():
                yield _record(path.name, line, number)
    if rest.strip():
        yield _record(path.name, rest, number + 1)


def _record(source: str, line: bytes, number: int) -> dict[str, Any]:
    """Return the record of one line."""
    record = json.loads(line)
    if not isinstance(record, dict):
        raise LogError(f"{source}: line {number} holds a {type(record).__name__}; expected a record, {{...}}")
    return record


def _of_rows(source: str, rows: Iterator[dict[str, Any]]) -> Table:
    """Read records, each of which has the names of the first; what is missing or null is an empty cell."""
    columns: dict[str, array] = {}
    faults: dict[str, str] = {}
    blanks: dict[str, int] = {}
    count = 0
    for row in rows:
        count += 1
        seen = 0
        for name, value in _cells(row, ""):
            if name not in columns:
                if len(columns) == MOST_COLUMNS:
                    raise LogError(f"{source}: over {MOST_COLUMNS} names; expected the same ones in every record")
                claim(source, 8 * count * (len(columns) + 1), f"{count} records or more take", LogError)
                columns[name] = array("d", [np.nan]) * (count - 1)
                blanks[name] = count - 1
            column = columns[name]
            if len(column) >= count:
                faults[name] = f"{source}: {name!r} stands twice in record {count}"
                continue
            seen += 1
            # A bool is an int to Python, and no number to a log.
            if isinstance(value, bool) or not isinstance(value, int | float | None):
                faults.setdefault(name, f"{source}: record {count}: {str(value)[:40]!r} in {name!r} is not a number")
                value = None
            elif value is None:
                blanks[name] += 1
            column.append(np.nan if value is None else float(value))
        if seen < len(columns):
            for name, column in columns.items():
                if len(column) < count:
                    column.append(np.nan)
                    blanks[name] += 1
        if count % 256 == 0:
            claim(source, 8 * count * len(columns), f"{count} records or more take", LogError)
    if not columns:
        raise LogError(f"{source}: no records; expected objects with numbers")
    found = {name: np.array(column) for name, column in columns.items()}
    return Table(found, (), faults, {name: number for name, number in blanks.items() if number})


def _cells(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield the numbers of a record by name: `motor_state.3.q` for lists of objects, `position.0` for lists."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _cells(inner, f"{name}.{key}" if name else key)
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _cells(inner, f"{name}.{index}" if isinstance(inner, dict | list) else f"{name}_{index}")
    else:
        yield name, value
