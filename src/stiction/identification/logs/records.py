"""Records, one a sample, as columns; and logs in JSON: an object of arrays, a list of records, or a record a line.

Nested names are joined by dots. A JSON file may also be no log at all: files that this program and others write are
recognised, and named.
"""

from __future__ import annotations

import gzip
import json
import zlib
from array import array
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import LogError
from stiction.core.files import open_regular
from stiction.core.memory import check_ratio, claim
from stiction.files.tables import Table, table_of
from stiction.files.text import LONGEST_LINE, MOST_COLUMNS

KNOWN_FILES = (
    ({"schema_version", "joints"}, "a result of `stiction identify` (joints.json): give the log that it came from"),
    (
        {"model", "actuator", "friction_base"},
        "a parameter file of BAM, identified already: `stiction convert FILE --to joints --out joints.json`",
    ),
    ({"method", "level"}, "a proposal for training (training.json): give it to `stiction train --friction-from`"),
    ({"observation", "joint_names"}, "the contract of a policy bundle: give the folder to `stiction verify`"),
    ({"info", "features"}, "a description of a dataset; the log itself is the .parquet file beside it"),
    ({"codebase_version", "features"}, "the meta/info.json of a LeRobot data set; the log is a .parquet file in data"),
)
"""Keys -> kind of the file that has them."""

ROWS = ("records", "data", "samples", "rows", "frames", "log", "messages")
"""Keys under which others keep the list of records."""


class Records:
    """Columns that grow by one record at a time; a missing value, or null, is an empty cell."""

    def __init__(self, source: str) -> None:
        """Start without records; source: name in messages."""
        self.source, self.count = source, 0
        self.columns: dict[str, array] = {}
        self.faults: dict[str, str] = {}
        self.blanks: dict[str, int] = {}

    def add(self, cells: Iterable[tuple[str, Any]]) -> None:
        """Add a record, as names and values. Raises `LogError` where all records would take too much memory."""
        self.count += 1
        seen = 0
        for name, value in cells:
            if (column := self.columns.get(name)) is None:
                column = self._begin(name)
            if len(column) >= self.count:
                self.faults[name] = f"{self.source}: {name!r} stands twice in record {self.count}"
                continue
            seen += 1
            # A bool is an int to Python, and no number to a log.
            if isinstance(value, bool) or not isinstance(value, int | float | None):
                fault = f"{self.source}: record {self.count}: {str(value)[:40]!r} in {name!r} is not a number"
                self.faults.setdefault(name, fault)
                value = np.nan
            elif value is None:
                self.blanks[name] += 1
                value = np.nan
            column.append(value)
        if seen < len(self.columns):
            for name, column in self.columns.items():
                if len(column) < self.count:
                    column.append(np.nan)
                    self.blanks[name] += 1
        if self.count % 256 == 0:
            self._claim(len(self.columns))

    def _begin(self, name: str) -> array:
        """Return the column of a new name, empty up to this record."""
        if len(self.columns) == MOST_COLUMNS:
            raise LogError(f"{self.source}: over {MOST_COLUMNS} names; expected the same ones in every record")
        self._claim(len(self.columns) + 1)
        self.blanks[name] = self.count - 1
        self.columns[name] = array("d", [np.nan]) * (self.count - 1)
        return self.columns[name]

    def _claim(self, width: int) -> None:
        claim(self.source, 8 * self.count * width, f"{self.count} records or more take", LogError)

    def table(self) -> Table:
        """Return the columns; raise `LogError` where there are none."""
        if not self.columns:
            raise LogError(f"{self.source}: no records; expected objects with numbers")
        columns = {name: np.array(column) for name, column in self.columns.items()}
        return Table(columns, (), self.faults, {name: number for name, number in self.blanks.items() if number})


def read_records(path: Path) -> Table:
    """Read a log in JSON. Raises `LogError`, which names the kind of file where it is no log."""
    try:
        if path.name.lower().removesuffix(".gz").endswith(".json"):
            return _of_document(path)
        return _of_lines(path)
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


def _of_lines(path: Path) -> Table:
    """Read a record a line; the last one may have no end."""
    records, rest, number = Records(path.name), b"", 0
    for block in chain(_bytes(path), [b"\n"]):
        *lines, rest = (rest + block).split(b"\n")
        # The rest counts too, or a file without line ends would be gathered whole.
        if max(map(len, (*lines, rest))) > LONGEST_LINE:
            raise LogError(f"{path.name}: a line of over {LONGEST_LINE} bytes; expected a record a line")
        for line in lines:
            number += 1
            record = json.loads(line) if line.strip() else {}
            if not isinstance(record, dict):
                kind = type(record).__name__
                raise LogError(f"{path.name}: line {number} holds a {kind}; expected a record, {{...}}")
            if line.strip():
                records.add(_cells(record))
    return records.table()


def _of_document(path: Path) -> Table:
    """Read one JSON value."""
    content = bytearray()
    for block in _bytes(path):
        content += block
        # Parsed, a byte takes 24 at most: `{},` is an object of 64 and a pointer of 8.
        claim(path.name, 24 * len(content), "as JSON it would take", LogError)
    # With a byte order mark, as Windows writes it, or without.
    data = json.loads(content.decode("utf-8-sig"))
    if isinstance(data, dict):
        for keys, what in KNOWN_FILES:
            if keys <= data.keys():
                raise LogError(f"{path.name}: this is {what}")
        data = next((data[key] for key in ROWS if isinstance(data.get(key), list)), data)
    if isinstance(data, dict):
        return _of_arrays(path.name, data)
    if not isinstance(data, list) or not data or not all(isinstance(row, dict) for row in data):
        raise LogError(
            f"{path.name}: holds a {type(data).__name__}; expected an object of arrays, or a list of records"
        )
    records = Records(path.name)
    for row in data:
        records.add(_cells(row))
    return records.table()


def _of_arrays(source: str, data: dict[str, Any]) -> Table:
    """Read an object whose values are lists of numbers, or lists of such lists."""
    arrays = {}
    for name, value in _leaves(data):
        if isinstance(value, list) and value:
            try:
                array = np.array(value, dtype=float)
            except (ValueError, TypeError):
                continue
            if array.ndim <= 2:
                arrays[name] = array
    if not arrays:
        keys = ", ".join(str(key)[:30] for key in list(data)[:12])
        raise LogError(
            f"{source}: an object with {keys or 'nothing'} and no arrays of numbers: that is no log; a sidecar is read "
            "beside its log, or by --sidecar"
        )
    return table_of(source, arrays)


def _leaves(data: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values in nested objects, by names joined with dots."""
    for name, value in data.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _cells(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the numbers of a record by name: `motor_state.3.q` for lists of objects, `position_0` for lists."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _cells(inner, f"{name}.{key}" if name else key)
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _cells(inner, f"{name}.{index}" if isinstance(inner, dict | list) else f"{name}_{index}")
    else:
        yield name, value
