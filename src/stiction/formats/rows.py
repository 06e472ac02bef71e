"""Records as a CSV file: one row a record, its fields the columns, an empty cell for None."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

from stiction.formats.errors import StictionError

Row = TypeVar("Row")


def write_rows(path: Path, rows: Sequence[Any]) -> None:
    """Write flat dataclass records of one kind, floats with nine digits.

    Raises:
        StictionError: there is no row, or a number is not finite.

    """
    if not rows:
        raise StictionError(f"{path.name}: no row to write; expected at least one")
    names = [field.name for field in fields(rows[0])]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        writer.writerows([_cell(path, name, value) for name, value in asdict(row).items()] for row in rows)


def _cell(path: Path, name: str, value: Any) -> str:
    """Return one cell."""
    if isinstance(value, float):
        if not math.isfinite(value):
            raise StictionError(f"{path.name}: {name} is {value}; expected a finite number")
        return f"{value:.9g}"
    return "" if value is None else str(value)


def read_rows(path: Path, kind: type[Row]) -> list[Row]:
    """Read records that `write_rows` wrote.

    kind: their dataclass, whose fields are text, integers, floats and yes or no, or one of these or None.

    Raises:
        StictionError: the file cannot be read, or is not one of such records.

    """
    types = get_type_hints(kind)
    names = list(types)
    try:
        with path.open(newline="", encoding="utf-8") as file:
            lines = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise StictionError(f"{path} cannot be read: {error}") from error
    if not lines or lines[0] != names:
        raise StictionError(f"{path}: its first line must be {','.join(names)}; move it away, or give another --out")
    try:
        return [
            kind(**{name: _value(cell, types[name]) for name, cell in zip(names, cells, strict=True)})
            for cells in lines[1:]
        ]
    except ValueError as error:
        raise StictionError(f"{path}: {error}; move it away, or give another --out") from error


def _value(cell: str, kind: Any) -> str | int | float | None:
    """Return what a cell says; raise `ValueError` where it is none of its kind."""
    kinds = get_args(kind) or (kind,)
    if cell == "" and type(None) in kinds:
        return None
    if bool in kinds:
        return _truth(cell)
    return next(one for one in (int, float, str) if one in kinds)(cell)


def _truth(cell: str) -> bool:
    """Return what a cell says of yes or no; raise `ValueError` where it is neither."""
    if cell not in ("True", "False"):
        raise ValueError(f"{cell!r} is neither True nor False")
    return cell == "True"
