"""Tables of text, CSV and its relatives: streamed block by block, so that a file costs what its numbers cost.

Columns of anything but numbers and times are no harm until somebody asks for them.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import LogError
from stiction.core.files import open_regular
from stiction.core.memory import check_ratio, claim
from stiction.files.dialect import EMPTY, Dialect, find_dialect, is_comment, is_number, parse_stamp
from stiction.files.tables import Table

BLOCK = 2**19
"""Bytes that are parsed at a time."""

LONGEST_LINE = 2**17
"""Characters of a line; 256 columns of 25 digits take 7,000."""

MOST_COLUMNS = 4096
"""More than any robot logs."""

MARKS = ",;\t|"
"""What separates cells, apart from blanks."""

HEAD = 40
"""Lines from which it is found how a file is written."""

CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
"""What no text has."""

HTML = re.compile(r"\s*<(!doctype\s+html|html)\b", re.IGNORECASE)
"""How a page begins that came in a log's place."""

MICROSECOND = timedelta(microseconds=1)


def read_csv(path: Path) -> Table:
    """Read a table of text: numbers between commas, semicolons, tabs, bars or blanks, with or without a header.

    A name that ends in .gz is unpacked. A last line without an end may have been cut in the middle of a number, and
    nothing in it would show it. It is left out, and the notes say so; where it is short of cells, the file was cut, and
    is refused. So are rows of other widths. Raises `LogError`.
    """
    blocks = _blocks(path)
    head: list[str] = []
    last = ""
    for lines, last in blocks:
        head += lines
        if len(head) >= HEAD or last:
            break
    if any(len(line.split()) > MOST_COLUMNS or max(map(line.count, MARKS)) > MOST_COLUMNS for line in head[:HEAD]):
        raise LogError(f"{path.name}: a line of over {MOST_COLUMNS} columns; expected a row of a table")
    dialect = find_dialect(head[:HEAD] or [last])
    if dialect is None and not last.strip():
        raise LogError(f"{path.name}: the file is empty; expected a header that names the columns, and rows of numbers")
    if dialect is None or not head:
        raise LogError(f"{path.name}: no samples after the header")
    collected = _Collected(path.name, dialect, [_Column(name) for name in dialect.names])
    collected.take(head[dialect.first :], dialect.first + 1)
    number = len(head)
    for lines, rest in blocks:
        collected.take(lines, number + 1)
        number, last = number + len(lines), rest
    return collected.table(last, number + 1)


def _blocks(path: Path) -> Iterator[tuple[list[str], str]]:
    """Yield whole lines without their ends, and with the last of them what has no end."""
    try:
        packed = path.stat().st_size
        if not path.name.lower().endswith(".gz"):
            claim(path.name, packed, "the file has", LogError)
        with open_regular(path) as opened, gzip.open(opened) if path.name.lower().endswith(".gz") else opened as file:
            yield from _decoded(path.name, file, packed)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise LogError(f"{path.name}: not a whole gzip file ({error}); get it again") from error
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror or error}") from error


def _decoded(source: str, file: Any, packed: int) -> Iterator[tuple[list[str], str]]:
    """Yield the lines of a file of bytes: UTF-8, UTF-16 with its mark, or Latin letters of one byte."""
    rest, seen = "", 0
    decoder: Any = None
    while block := file.read(BLOCK):
        seen += len(block)
        check_ratio(source, packed, seen, LogError)
        claim(source, seen // 2, "half of its text has", LogError)
        if decoder is None:
            utf16 = block.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
            decoder = codecs.getincrementaldecoder("utf-16" if utf16 else "utf-8-sig")()
        try:
            text = decoder.decode(block)
        except UnicodeDecodeError:
            # Behind what the first decoder has kept of a letter that the block's end cut.
            pending = decoder.getstate()[0]
            decoder = codecs.getincrementaldecoder("latin-1")()
            text = decoder.decode(pending + block)
        if fault := CONTROL.search(text):
            raise LogError(f"{source}: not a text file (it holds the character {fault[0]!r}); expected CSV")
        if seen == len(block) and HTML.match(text):
            raise LogError(f"{source}: a page of HTML, no log; download the file itself; expected a table of text")
        text = (rest + text).replace("\r\n", "\n")
        held = "\r" if text.endswith("\r") else ""  # half of an end of line, perhaps
        *lines, rest = text.removesuffix("\r").replace("\r", "\n").split("\n")
        rest += held
        if len(rest) > LONGEST_LINE or max(map(len, lines), default=0) > LONGEST_LINE:
            raise LogError(f"{source}: a line of over {LONGEST_LINE} characters; expected a row of a table")
        yield lines, ""
    yield ([rest.removesuffix("\r")], "") if rest.endswith("\r") else ([], rest)


@dataclass
class _Column:
    """What was found in one column so far."""

    name: str
    parts: list[np.ndarray] = field(default_factory=list)
    blanks: int = 0
    fault: str = ""
    first: datetime | None = None
    """The first time stamp, of a column of such."""

    def take(self, cells: list[str], lines: list[int]) -> None:
        """Add cells; the first cell that is no number is remembered as a fault with its line."""
        # All at once where they are numbers, as most are; else cell by cell.
        if self.first is None:
            try:
                self.parts.append(_floats(cells))
                return
            except ValueError:
                pass
        blank = np.array([cell.lower() in EMPTY for cell in cells])
        self.blanks += int(blank.sum())
        values = np.full(len(cells), np.nan)
        for index in np.flatnonzero(~blank):
            # The first cell that is not empty decides whether the column is of numbers or of time stamps.
            if self.first is None and all(np.isnan(part).all() for part in (*self.parts, values[:index])):
                self.first = None if is_number(cells[index]) else parse_stamp(cells[index])
            try:
                values[index] = _floats([cells[index]])[0] if self.first is None else self._since(cells[index])
            except ValueError:
                self.fault = f"line {lines[index]}: {cells[index][:40]!r} in column {self.name!r} is not a number"
                self.parts.clear()
                return
        self.parts.append(values)

    def _since(self, cell: str) -> float:
        """Return the seconds from the first stamp; raise `ValueError` for what is none, or of another kind."""
        stamp, first = parse_stamp(cell), self.first
        if stamp is None or first is None or (stamp.tzinfo is None) != (first.tzinfo is None):
            raise ValueError(cell)
        if stamp.tzinfo is not None:
            stamp, first = stamp.astimezone(UTC), first.astimezone(UTC)
        return ((stamp - first) // MICROSECOND) * 1e-6


def _since_1970(stamp: datetime) -> float:
    """Return the seconds since 1970; a stamp without a zone counts as universal time."""
    return (stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC)).timestamp()


def _floats(cells: list[str]) -> np.ndarray:
    """Return cells as numbers; raise `ValueError` where one is none, Python's own 1_000 included."""
    if any("_" in cell for cell in cells):
        raise ValueError("not a number")
    return np.array(cells, dtype=float)


@dataclass
class _Collected:
    """The rows read so far."""

    source: str
    dialect: Dialect
    columns: list[_Column]
    rows: int = 0
    remarks: int = 0

    def take(self, lines: list[str], number: int) -> None:
        """Add lines, the first of which is line `number` of the file."""
        numbers = [place for place, line in enumerate(lines, number) if line and not line.isspace()]
        if len(numbers) != len(lines):
            lines = [lines[place - number] for place in numbers]
        if remarks := {place for place, line in enumerate(lines) if is_comment(line)}:
            self.remarks += len(remarks)
            numbers = [line for place, line in enumerate(numbers) if place not in remarks]
            lines = [line for place, line in enumerate(lines) if place not in remarks]
        if not lines:
            return
        if self.dialect.decimal_comma:
            lines = [line.replace(",", ".") for line in lines]
        wanted = [index for index, column in enumerate(self.columns) if not column.fault and column.first is None]
        self.rows += len(lines)
        numeric = sum(not column.fault for column in self.columns)
        claim(self.source, 8 * self.rows * numeric, f"{self.rows} rows or more take", LogError)
        values = self._numbers(lines, wanted)
        if values is not None:
            for index, column in zip(wanted, values.T, strict=True):
                self.columns[index].parts.append(column)
            return
        try:
            rows = self.dialect.cells(lines)
        except csv.Error as error:
            raise LogError(f"{self.source}: line {numbers[0]} or later cannot be read ({error})") from error
        for row, line in zip(rows, numbers, strict=True):
            if len(row) != len(self.columns):
                raise LogError(
                    f"{self.source}: line {line} has {len(row)} values, the header names {len(self.columns)} columns"
                )
        for column, cells in zip(self.columns, zip(*rows, strict=True), strict=True):
            if not column.fault:
                column.take(list(cells), numbers)

    def _numbers(self, lines: list[str], wanted: list[int]) -> np.ndarray | None:
        """Return the cells of lines that are numbers in all columns that could be; None where one is not."""
        mark, width = self.dialect.separator, len(self.columns)
        if len(wanted) + sum(bool(column.fault) for column in self.columns) != width:
            return None
        # With `usecols` np.loadtxt does not mind rows of other widths.
        if len(wanted) < width and any(len(line.split(mark or None)) != width for line in lines):
            return None
        try:
            usecols = None if len(wanted) == width else wanted
            values = np.loadtxt(lines, delimiter=mark or None, comments=None, ndmin=2, dtype=float, usecols=usecols)
        except ValueError:
            return None
        return values if values.shape == (len(lines), len(wanted)) else None

    def table(self, last: str, number: int) -> Table:
        """Return what was read; last: what has no end, line `number` of the file."""
        notes = list(self.dialect.notes)
        if last.strip() and not is_comment(last):
            # With a quote in it, which may be cut off, the line cannot be split: it is left out without being counted.
            cells = len(self.dialect.cells([last])[0]) if '"' not in last else len(self.columns)
            if cells != len(self.columns):
                raise LogError(
                    f"{self.source}: line {number}, the last, has {cells} values and no end, the header names "
                    f"{len(self.columns)} columns: the file was cut off; get it again, or take that line out"
                )
            notes.append(f"line {number}, the last, has no line end and may be cut off in a number: it is left out")
        if not self.rows:
            raise LogError(f"{self.source}: no samples after the header")
        if self.remarks:
            notes.append(f"{self.remarks} lines among the samples are remarks and were left out")
        found: dict[str, np.ndarray] = {}
        faults: dict[str, str] = {}
        for column in self.columns:
            if column.name in found:
                faults[column.name] = f"the header names {column.name!r} twice; expected one different name a column"
            elif column.fault:
                faults[column.name] = column.fault
            found[column.name] = np.broadcast_to(np.nan, self.rows) if column.fault else np.concatenate(column.parts)
            column.parts.clear()
        blanks = {column.name: column.blanks for column in self.columns if column.blanks}
        said = {name: f"{self.source}: {fault}" for name, fault in faults.items()}
        starts = {column.name: _since_1970(column.first) for column in self.columns if column.first is not None}
        return Table(found, tuple(notes), said, blanks, starts=starts)
