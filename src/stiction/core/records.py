"""Records as tables: one row per record, one column per field. CSV with all digits; text, Markdown, HTML with few.

A field's label, unit and format are its metadata, `column`.
"""

from __future__ import annotations

import csv
import dataclasses
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

from stiction.core.decode import short
from stiction.core.errors import ConfigurationError, FileError
from stiction.core.files import open_text, publish

Row = TypeVar("Row")


def column(label: str, unit: str = "", form: str | Callable[[Any], str] = ".3g", was: str = "") -> dict[str, Any]:
    """Return the metadata of a field that tables show, `speed: float = field(metadata=column("speed", "m/s"))`.

    form: format of its numbers, as of `format`, or a function from a value, other than None, to text; was: the field's
    name in older files, which are read too.
    """
    return {"label": f"{label} [{unit}]" if unit else label, "form": form, "was": was}


LATER = {"later": True}
"""Metadata of a field with a default that older files lack; it is written where a row differs from the default, and no
table shows it."""


def header(kind: Any) -> tuple[str, ...]:
    """Return the labels of the columns of a kind of row: fields with a `column`; all, by name, without any."""
    return tuple(field.metadata.get("label", field.name) for field in _shown(kind))


def texts(row: Any) -> tuple[str, ...]:
    """Return the cells of a row in the order of `header`, a dash for None."""
    return tuple(_text(getattr(row, field.name), field.metadata.get("form", ".3g")) for field in _shown(row))


def _shown(row: Any) -> list[dataclasses.Field]:
    return [field for field in fields(row) if "label" in field.metadata] or list(fields(row))


def _text(value: Any, form: str | Callable[[Any], str]) -> str:
    if value is None:
        return "–"
    if callable(form):
        return form(value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return format(value, form) if isinstance(value, float) else str(value)


def two_digits(value: float) -> str:
    """Return a number rounded to two digits, without an exponent in common ranges: 120, not 1.2e+02."""
    return f"{float(f'{value:.2g}'):g}"


def markdown(titles: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """Return a table of text as Markdown, a pipe in a cell escaped."""
    cells = [titles, ["---"] * len(titles), *lines]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in cells)


def write_rows(path: Path, rows: Sequence[Any], form: str = ".9g") -> None:
    """Write flat dataclass records of one kind.

    form: format of floats, such as `.9g`; empty: as many digits as it takes to read the same number back.

    Raises `StictionError` without a row, or for a number that is not finite.
    """
    if not rows:
        raise FileError(f"{path.name}: no row to write; expected at least one")
    names = [
        field.name
        for field in fields(rows[0])
        if not field.metadata.get("later") or any(getattr(row, field.name) != field.default for row in rows)
    ]
    with publish(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        writer.writerows([_cell(path, name, getattr(row, name), form) for name in names] for row in rows)


def _cell(path: Path, name: str, value: Any, form: str) -> str:
    if isinstance(value, float):
        if not math.isfinite(value):
            raise FileError(f"{path.name}: {name} is {value}; expected a finite number")
        return format(value, form)
    return "" if value is None else str(value)


def read_rows(path: Path, kind: type[Row], optional: bool = False) -> list[Row]:
    """Read records that `write_rows` wrote.

    kind: their dataclass, whose fields are text, integers, floats and booleans, or one of these or None. optional: a
    missing file means no rows, as a study writes none for an empty table. Raises `StictionError` where the file cannot
    be read, or has other records.
    """
    if optional and not path.exists():
        return []
    types = get_type_hints(kind)
    try:
        with open_text(path) as file:
            lines = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from error
    # The header alone is translated: the order of the cells is that of the fields, then as now.
    now = {field.metadata.get("was"): field.name for field in fields(kind)}  # type: ignore[arg-type]
    names = [now.get(name, name) for name in lines[0]] if lines else []
    later = {field.name for field in fields(kind) if field.metadata.get("later")}  # type: ignore[arg-type]
    if not names or names != [name for name in types if name in names or name not in later]:
        wanted = ",".join(name for name in types if name not in later)
        raise FileError(f"{path}: its first line must be {wanted}; move it away, or give another --out")
    rows = []
    for number, cells in enumerate(lines[1:], start=2):
        if len(cells) != len(names):
            raise FileError(f"{path}, line {number}: {len(cells)} cells; expected {len(names)}")
        row = {}
        for name, cell in zip(names, cells, strict=True):
            try:
                row[name] = _value(cell, types[name])
            except ValueError as error:
                raise FileError(
                    f"{path}, line {number}: {name} is {cell!r}; {error}; move the file away, or give another --out"
                ) from error
        rows.append(kind(**row))
    return rows


def _value(cell: str, kind: Any) -> str | int | float | None:
    """Return the value of a cell; raise `ValueError`, with what was expected, for a cell of another kind."""
    kinds = get_args(kind) or (kind,)
    if cell == "" and type(None) in kinds:
        return None
    if bool in kinds:
        if cell not in ("True", "False"):
            raise ValueError("expected True or False")
        return cell == "True"
    number = next(number for number in (int, float, str) if number in kinds)
    try:
        value = number(cell)
    except ValueError as error:
        raise ValueError("expected a whole number" if number is int else "expected a number") from error
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError("expected a finite number")
    return value


T = TypeVar("T")

MOST = 1e12
"""Bound of settings: no length, time, gain or count is that large."""


def check_numbers(config: Any, name: str = "") -> None:
    """Raise `StictionError` naming the number of a (nested) dataclass that is not finite, or beyond `MOST`."""
    if dataclasses.is_dataclass(config):
        for field in fields(config):
            check_numbers(getattr(config, field.name), f"{name}.{field.name}".lstrip("."))
    elif isinstance(config, tuple | list):
        for part in config:
            check_numbers(part, name)
    elif isinstance(config, int | float) and not isinstance(config, bool) and not abs(config) < MOST:
        raise ConfigurationError(f"{name} is {short(config)}; expected a number, smaller than {MOST:g}")


def part_of(kind: type[T], config: Any, **more: Any) -> T:
    """Return the dataclass `kind` with the fields of `config` of the same names, and `more`."""
    shared = {field.name for field in dataclasses.fields(config)}
    names = [field.name for field in dataclasses.fields(kind) if field.name in shared]  # type: ignore[arg-type]
    return kind(**{name: getattr(config, name) for name in names} | more)


def make_folder(out: Path, option: str = "--out") -> None:
    """Make the directory for results, which `option` names. Raises `StictionError` where it cannot be made."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"the directory {out} cannot be made: {error.strerror}; choose another {option}") from error


def check_folder(out: Path, option: str = "--out") -> None:
    """Raise `StictionError` where the directory for results could not be made or written, before hours of work."""
    parent = next(folder for folder in (out.absolute(), *out.absolute().parents) if folder.exists())
    if not parent.is_dir():
        raise FileError(f"{out} cannot be made: {parent} is a file; choose another {option}")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise FileError(f"{out} cannot be written: {parent} is read-only for this user; choose another {option}")
