"""How a table of text is written: what separates its cells, which line names the columns, where the numbers begin."""

from __future__ import annotations

import csv
import re
from collections import Counter
from dataclasses import dataclass
from datetime import datetime, time
from itertools import pairwise

COMMENTS = ("#", "%")
"""What a line begins with that holds no sample."""

SEPARATORS = (",", ";", "\t", "|", "")
"""What may stand between two cells, the first that fits counts; the empty one is any run of blanks."""

EMPTY = frozenset({"", "null", "none", "na", "n/a"})
"""Cells in which nothing was measured, in lower case."""

DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")
"""1,5 where others write 1.5."""

WORDS = re.compile(r'"([^"]*)"|(\S+)')
"""Words between blanks, in quotes or not."""

INDEX = 3
"""Rows whose first cell must count on by one before it is taken for an index without a name."""


@dataclass(frozen=True)
class Dialect:
    """How the lines of one file are to be read."""

    separator: str
    """One of `SEPARATORS`."""
    decimal_comma: bool
    """Whether numbers have a comma for a point."""
    names: tuple[str, ...]
    """Names of the columns; their numbers, from 0, where nobody named them."""
    first: int
    """Index of the first line that holds a sample."""
    notes: tuple[str, ...] = ()
    """What was taken for what, where it is not plain; each one sentence."""

    def cells(self, lines: list[str]) -> list[list[str]]:
        """Return the cells of lines; raise `csv.Error` for quotes that do not end."""
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
    """Return whether a line holds a remark and no sample."""
    return line.lstrip().startswith(COMMENTS)


def is_number(cell: str, decimal_comma: bool = False) -> bool:
    """Return whether a cell is a number."""
    if decimal_comma and DECIMAL_COMMA.fullmatch(cell):
        return True
    try:
        float(cell)
    except ValueError:
        return False
    return True


def parse_stamp(cell: str) -> datetime | None:
    """Return the time of an ISO 8601 date and time, or of a time of day, to the microsecond; None for anything else."""
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
    """Return how a file is written that begins with these lines; None where they hold nothing."""
    numbers = [index for index, line in enumerate(lines) if line.strip() and not is_comment(line)]
    if not numbers:
        return None
    texts = [lines[index] for index in numbers]
    # What separates cells, then how many there are; where the table begins depends on both.
    separator = max(SEPARATORS, key=lambda mark: _fitness(texts, mark))
    rows = split_lines(texts, separator)
    width = _usual_width(rows)
    start = _start(rows, width, separator != ",")
    notes = [f"{start} lines before the header are no table and were left out"] if start else []
    rows, numbers = rows[start:], numbers[start:]
    # Between cells or within numbers: a comma cannot be both.
    comma = separator != "," and any(DECIMAL_COMMA.fullmatch(cell) for row in rows[1:] or rows for cell in row)
    # The first row of the table: numbers, or names, perhaps with units below them.
    if _is_sample(rows, comma):
        names, begin = _names_of_comments(lines[: numbers[0]], width), numbers[0]
        if not names:
            names = [str(index) for index in range(width)]
            notes.append(f"nobody named the {width} columns: they are called 0 to {width - 1}")
    else:
        names, begin = _padded(rows, width), numbers[1] if len(numbers) > 1 else len(lines)
        if len(rows) > 2 and _is_units(rows[1], rows[2], comma):
            notes.append(f"the line of units, {', '.join(filter(None, rows[1]))[:80]}, is left out: SI is expected")
            begin = numbers[2]
    names = [name or str(index) for index, name in enumerate(names)]
    return Dialect(separator, comma, tuple(names), begin, tuple(notes))


def _fitness(lines: list[str], separator: str) -> float:
    """Return how well a separator fits: the share of rows of one width, times the share of cells that are something."""
    try:
        rows = split_lines(lines, separator)
    except csv.Error:
        return 0.0
    width = _usual_width(rows)
    alike = [row for row in rows[1:] or rows if len(row) == width]
    comma = separator != ","
    good = sum(
        is_number(cell, comma) or cell.lower() in EMPTY or bool(parse_stamp(cell)) for row in alike for cell in row
    )
    # Rows of one width tell something where no cell is a number (0.1); every file is a table of one column (0.5).
    return len(alike) / len(rows[1:] or rows) * (0.1 + good / max(1, width * len(alike))) * (1.0 if width > 1 else 0.5)


def _usual_width(rows: list[list[str]]) -> int:
    """Return how many cells most rows have; the header alone is not asked where there are rows."""
    return Counter(len(row) for row in rows[1:] or rows).most_common(1)[0][0]


def _start(rows: list[list[str]], width: int, comma: bool) -> int:
    """Return the row at which the table begins, below titles: the first of its width, or one short above samples."""
    for index, row in enumerate(rows):
        after = rows[index + 1] if index + 1 < len(rows) else []
        if len(row) == width:
            return index
        if len(row) == width - 1 and len(after) == width and any(is_number(cell, comma) for cell in after):
            return index
    return 0


def _is_sample(rows: list[list[str]], comma: bool) -> bool:
    """Return whether the first row is one of numbers, like the second, and names nothing."""
    kinds = [[bool(is_number(cell, comma) or parse_stamp(cell)) for cell in row] for row in rows[:2]]
    if not any(kinds[0]) or len({len(row) for row in rows[:2]}) > 1:
        return False
    empty = [any(row[index].lower() in EMPTY for row in rows[:2]) for index in range(len(rows[0]))]
    return all(kind == kinds[-1][index] or empty[index] for index, kind in enumerate(kinds[0]))


def _padded(rows: list[list[str]], width: int) -> list[str]:
    """Return the header's names, with those of columns that have none: an index in front, or an empty end."""
    names, body = rows[0], [row for row in rows[1:] if len(row) == width]
    if len(names) == width - 1 and len(body) >= INDEX:
        if all(row[-1] == "" for row in body):
            return [*names, ""]
        first = [row[0].strip('"') for row in body]
        if all(cell.isdigit() for cell in first) and all(int(b) - int(a) == 1 for a, b in pairwise(first)):
            return ["", *names]
    return names


def _is_units(row: list[str], after: list[str], comma: bool) -> bool:
    """Return whether a row between header and samples holds units."""
    return not any(is_number(cell, comma) or parse_stamp(cell) for cell in row) and any(
        is_number(cell, comma) for cell in after
    )


def _names_of_comments(lines: list[str], width: int) -> list[str]:
    """Return the names in the last remark that has as many as there are columns; none where none has."""
    for line in reversed([line for line in lines if is_comment(line)]):
        text = line.strip().lstrip("".join(COMMENTS)).strip()
        for separator in SEPARATORS:
            names = [name.strip() for name in (text.split(separator) if separator else text.split())]
            if len(names) == width and all(names) and not any(is_number(name) for name in names):
                return names
    return []
