"""Tables of text, CSV and its relatives: streamed block by block, so that memory grows only with the numbers.

Columns of anything but numbers and times are faults only if they are requested.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import re
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime, time, timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import LogError
from stiction.core.files import open_regular
from stiction.core.memory import check_ratio, claim
from stiction.files.tables import Table

BLOCK = 2**19
"""Size of a parsed block [B]."""

LONGEST_LINE = 2**17
"""Maximum length of a line; 256 columns of 25 digits take 7,000."""

MOST_COLUMNS = 4096
"""Maximum number of columns."""

MARKS = ",;\t|"
"""Separators of cells, apart from blanks."""

HEAD = 40
"""Number of lines from which the format is detected."""

CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
"""Characters that no text has."""

HTML = re.compile(r"\s*<(!doctype\s+html|html)\b", re.IGNORECASE)
"""Begin of a web page saved in place of a log."""

MICROSECOND = timedelta(microseconds=1)

COMMENTS = ("#", "%")
"""Begin of a line without a sample."""

SEPARATORS = (",", ";", "\t", "|", "")
"""Possible separators of cells, the first that fits counts; the empty one is any run of blanks."""

EMPTY = frozenset({"", "null", "none", "na", "n/a"})
"""Cells without a measurement, in lower case."""

DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")
"""Number with a decimal comma, 1,5."""

WORDS = re.compile(r'"([^"]*)"|(\S+)')
"""Words between blanks, in quotes or not."""

TITLE = re.compile(
    r"(t|time\w*|stamp|pos\w*|q\w?|angle|theta|vel\w*|dq|torque|tau|effort|current|target)([\W_\d]|$)", re.IGNORECASE
)
"""Begin of a title that names a signal."""

INDEX = 3
"""Rows whose first cell must count up by one for it to be an index without a name."""


@dataclass(frozen=True)
class Dialect:
    """Format of the lines of one file."""

    separator: str
    """One of `SEPARATORS`."""
    decimal_comma: bool
    """True if numbers have a decimal comma."""
    names: tuple[str, ...]
    """Names of the columns; without a header their numbers, from 0."""
    first: int
    """Index of the first line that holds a sample."""
    notes: tuple[str, ...] = ()
    """Notes on assumptions; one sentence each."""

    def cells(self, lines: list[str]) -> list[list[str]]:
        """Return the cells of lines; raise `csv.Error` for open quotes."""
        return split_lines(lines, self.separator)


def split_lines(lines: list[str], separator: str) -> list[list[str]]:
    """Return the cells of each line, without blanks around them; a line's number is the row's."""
    if separator == "":
        return [[a or b for a, b in WORDS.findall(line)] if '"' in line else line.split() for line in lines]
    if not any('"' in line for line in lines):
        return [[cell.strip() for cell in line.split(separator)] for line in lines]
    rows = []
    for line in lines:
        # A reader for each line: one for all would let a quote that does not end take the lines behind it.
        rows.append([cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])])
    return rows


def is_comment(line: str) -> bool:
    """Return whether a line is a comment, without a sample."""
    return line.lstrip().startswith(COMMENTS)


def is_numeric(cell: str, decimal_comma: bool = False) -> bool:
    """Return whether a cell is a number."""
    if decimal_comma and DECIMAL_COMMA.fullmatch(cell):
        return True
    try:
        float(cell)
    except ValueError:
        return False
    return True


def parse_stamp(cell: str) -> datetime | None:
    """Return the time of an ISO 8601 date and time, or of a time of day, to the microsecond; else None."""
    if len(cell) < 8 or not cell[0].isdigit():
        return None
    for parse in (
        datetime.fromisoformat,
        lambda text: datetime.combine(datetime(2000, 1, 1), time.fromisoformat(text)),
    ):
        try:
            return parse(cell)
        except ValueError:
            continue
    return None


def find_dialect(lines: list[str]) -> Dialect | None:
    """Return the format of a file from its first lines; None for empty ones.

    Raises `ValueError` for a header with names of signals whose number differs from that of the columns.
    """
    numbers = [index for index, line in enumerate(lines) if line.strip() and not is_comment(line)]
    if not numbers:
        return None
    texts = [lines[index] for index in numbers]
    # What separates cells, then how many there are; where the table begins depends on both.
    separator = max(SEPARATORS, key=lambda mark: _fitness(texts, mark))
    rows = split_lines(texts, separator)
    width = _usual_width(rows)
    rows = [without_empty_end(row, width) for row in rows]
    start = _start(rows, width, separator != ",")
    notes = [f"{start} lines before the header are no table and were left out"] if start else []
    all_rows, rows, numbers = rows, rows[start:], numbers[start:]
    # Between cells or within numbers: a comma cannot be both.
    comma = separator != "," and any(DECIMAL_COMMA.fullmatch(cell) for row in rows[1:] or rows for cell in row)
    # The first row of the table: numbers, or names, perhaps with units below them.
    if _is_sample(rows, comma):
        names, begin = _names_of_comments(lines[: numbers[0]], width), numbers[0]
        if not names:
            if start and any(map(TITLE.match, rows_above := all_rows[start - 1])):
                raise ValueError(
                    f"the header names {len(rows_above)} columns, and most rows have {width} values; mend the header, "
                    "or take it out and map the columns by number"
                )
            names = [str(index) for index in range(width)]
            notes.append(f"the {width} columns have no names; using 0 to {width - 1}")
    else:
        names, begin = _padded(rows, width), numbers[1] if len(numbers) > 1 else len(lines)
        if len(rows) > 2 and _is_units(rows[1], rows[2], comma):
            notes.append(f"the line of units, {', '.join(filter(None, rows[1]))[:80]}, is left out: SI is expected")
            begin = numbers[2]
    names = [name or str(index) for index, name in enumerate(names)]
    return Dialect(separator, comma, tuple(names), begin, tuple(notes))


def without_empty_end(row: list[str], width: int) -> list[str]:
    """Return a row without empty cells beyond `width`: many loggers end every title, or every row, with a comma."""
    while len(row) > width and row[-1] == "":
        row = row[:-1]
    return row


def _fitness(lines: list[str], separator: str) -> float:
    """Return the fit of a separator: the share of rows of one width, times the share of non-empty cells."""
    try:
        rows = split_lines(lines, separator)
    except csv.Error:
        return 0.0
    width = _usual_width(rows)
    alike = [row for row in rows[1:] or rows if len(row) == width]
    comma = separator != ","
    good = sum(
        is_numeric(cell, comma) or cell.lower() in EMPTY or bool(parse_stamp(cell)) for row in alike for cell in row
    )
    # Rows of one width tell something where no cell is a number (0.1); every file is a table of one column (0.5).
    return len(alike) / len(rows[1:] or rows) * (0.1 + good / max(1, width * len(alike))) * (1.0 if width > 1 else 0.5)


def _usual_width(rows: list[list[str]]) -> int:
    """Return the most frequent number of cells in a row, without the header if rows follow."""
    return Counter(len(row) for row in rows[1:] or rows).most_common(1)[0][0]


def _start(rows: list[list[str]], width: int, comma: bool) -> int:
    """Return the first row of the table, below titles: the first of its width, or one short above samples."""
    for index, row in enumerate(rows):
        after = rows[index + 1] if index + 1 < len(rows) else []
        if len(row) == width:
            return index
        if len(row) == width - 1 and len(after) == width and any(is_numeric(cell, comma) for cell in after):
            return index
    return 0


def _is_sample(rows: list[list[str]], comma: bool) -> bool:
    """Return whether the first row is one of numbers, like the second, without names."""
    kinds = [[bool(is_numeric(cell, comma) or parse_stamp(cell)) for cell in row] for row in rows[:2]]
    if not any(kinds[0]) or len({len(row) for row in rows[:2]}) > 1:
        return False
    empty = [any(row[index].lower() in EMPTY for row in rows[:2]) for index in range(len(rows[0]))]
    return all(kind == kinds[-1][index] or empty[index] for index, kind in enumerate(kinds[0]))


def _padded(rows: list[list[str]], width: int) -> list[str]:
    """Return the header's names, completed for columns without one: an index in front, or an empty end."""
    names, body = rows[0], [row for row in rows[1:] if len(row) == width]
    if len(names) == width - 1 and len(body) >= INDEX:
        if all(row[-1] == "" for row in body):
            return [*names, ""]
        first = [row[0].strip('"') for row in body]
        if all(cell.isdigit() for cell in first) and all(int(b) - int(a) == 1 for a, b in pairwise(first)):
            return ["", *names]
    return names


def _is_units(row: list[str], after: list[str], comma: bool) -> bool:
    return not any(is_numeric(cell, comma) or parse_stamp(cell) for cell in row) and any(
        is_numeric(cell, comma) for cell in after
    )


def _names_of_comments(lines: list[str], width: int) -> list[str]:
    """Return the names in the last comment with as many names as columns, or an empty list."""
    for line in reversed([line for line in lines if is_comment(line)]):
        text = line.strip().lstrip("".join(COMMENTS)).strip()
        for separator in SEPARATORS:
            names = [name.strip() for name in (text.split(separator) if separator else text.split())]
            if len(names) == width and all(names) and not any(is_numeric(name) for name in names):
                return names
    return []


def read_csv(path: Path) -> Table:
    """Read a table of text: numbers between commas, semicolons, tabs, bars or blanks, with or without a header.

    A name with the suffix .gz is unpacked. A last line without an end may be cut in the middle of a number, which
    cannot be detected; it is left out, with a note. Rows of other widths are refused. Raises `LogError`.
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
    try:
        dialect = find_dialect(head[:HEAD] or [last])
    except ValueError as error:
        raise LogError(f"{path.name}: {error}") from error
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
    """Yield complete lines without their ends, and with the last of them the incomplete rest."""
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
            # With its mark, or with the zero that an ASCII letter has in it.
            marks = {codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
            zeros = {(False, True): "utf-16-le", (True, False): "utf-16-be"}
            name = marks.get(block[:2]) or zeros.get((block[:1] == b"\0", block[1:2] == b"\0"), "utf-8-sig")
            decoder = codecs.getincrementaldecoder(name)()
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
    """State of one column."""

    name: str
    parts: list[np.ndarray] = field(default_factory=list)
    fault: str = ""
    first: datetime | None = None
    """First time stamp, for a column of these."""

    def take(self, cells: list[str], lines: list[int]) -> None:
        """Add cells; the first cell that is not a number is recorded as a fault with its line."""
        # All at once where they are numbers, as most are; else cell by cell.
        if self.first is None:
            try:
                self.parts.append(_floats(cells))
                return
            except ValueError:
                pass
        blank = np.array([cell.lower() in EMPTY for cell in cells])
        values = np.full(len(cells), np.nan)
        for index in np.flatnonzero(~blank):
            # The first cell that is not empty decides whether the column is of numbers or of time stamps.
            if self.first is None and all(np.isnan(part).all() for part in (*self.parts, values[:index])):
                self.first = None if is_numeric(cells[index]) else parse_stamp(cells[index])
            try:
                values[index] = _floats([cells[index]])[0] if self.first is None else self._since(cells[index])
            except ValueError:
                self.fault = f"line {lines[index]}: {cells[index][:40]!r} in column {self.name!r} is not a number"
                self.parts.clear()
                return
        self.parts.append(values)

    def _since(self, cell: str) -> float:
        """Return the seconds from the first stamp; raise `ValueError` for another kind of cell."""
        stamp, first = parse_stamp(cell), self.first
        if stamp is None or first is None or (stamp.tzinfo is None) != (first.tzinfo is None):
            raise ValueError(cell)
        if stamp.tzinfo is not None:
            stamp, first = stamp.astimezone(UTC), first.astimezone(UTC)
        return ((stamp - first) // MICROSECOND) * 1e-6


def _floats(cells: list[str]) -> np.ndarray:
    """Return cells as numbers; raise `ValueError` for others, Python's 1_000 included."""
    if any("_" in cell for cell in cells):
        raise ValueError("not a number")
    return np.array(cells, dtype=float)


@dataclass
class _Collected:
    """Rows read so far."""

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
        rows = [without_empty_end(row, len(self.columns)) for row in rows]
        for row, line in zip(rows, numbers, strict=True):
            if len(row) != len(self.columns):
                raise LogError(
                    f"{self.source}: line {line} has {len(row)} values, the header names {len(self.columns)} columns"
                )
        for column, cells in zip(self.columns, zip(*rows, strict=True), strict=True):
            if not column.fault:
                column.take(list(cells), numbers)

    def _numbers(self, lines: list[str], wanted: list[int]) -> np.ndarray | None:
        """Return the cells of lines that are numbers in all columns that could be; None if one is not."""
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
        """Return the table; last: the incomplete last line, line `number` of the file."""
        notes = list(self.dialect.notes)
        if last.strip() and not is_comment(last):
            # With a quote in it, which may be cut off, the line cannot be split.
            cells = len(self.dialect.cells([last])[0]) if '"' not in last else 0
            short = (
                f"has {cells} of {len(self.columns)} values"
                if cells < len(self.columns)
                else "may be cut off in a number"
            )
            notes.append(f"line {number}, the last, has no line end and {short}: it is left out")
        if not self.rows:
            raise LogError(f"{self.source}: no samples after the header")
        if self.remarks:
            notes.append(f"{self.remarks} lines among the samples are remarks and were left out")
        columns: dict[str, np.ndarray] = {}
        faults: dict[str, str] = {}
        for column in self.columns:
            if column.name in columns:
                faults[column.name] = f"the header names {column.name!r} twice; expected one different name a column"
            elif column.fault:
                faults[column.name] = column.fault
            columns[column.name] = np.broadcast_to(np.nan, self.rows) if column.fault else np.concatenate(column.parts)
            column.parts.clear()
        # A cell that says nan is empty, too.
        blanks = {name: int(np.isnan(values).sum()) for name, values in columns.items() if name not in faults}
        blanks = {name: count for name, count in blanks.items() if count}
        messages = {name: f"{self.source}: {fault}" for name, fault in faults.items()}
        # A stamp without a zone counts as universal time; seconds since 1970.
        first = {column.name: column.first for column in self.columns if column.first is not None}
        starts = {name: (t if t.tzinfo else t.replace(tzinfo=UTC)).timestamp() for name, t in first.items()}
        return Table(columns, tuple(notes), messages, blanks, starts=starts)
