"""Records as a CSV file: one row a record, its fields the columns, an empty cell for None."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from stiction.formats.errors import StictionError


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
