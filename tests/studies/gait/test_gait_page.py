"""The bars of the gait diagram, and records as CSV."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.core.records import write_rows
from stiction.studies.gait.page import bars


def test_bars_are_where_the_foot_is_down() -> None:
    """Down from the start for two steps, and for the last three of eight, at 0.02 s."""
    found = bars(np.array([1, 1, 0, 0, 0, 1, 1, 1], bool), 0.02)
    np.testing.assert_allclose(found, [(0.0, 0.04), (0.1, 0.06)])
    assert bars(np.zeros(4, bool), 0.02) == []


@dataclass(frozen=True)
class Record:
    """A row."""

    name: str
    value: float | None


def test_records_are_rows_and_none_is_an_empty_cell(tmp_path: Path) -> None:
    """A text with a comma stays one cell; what is not finite is refused, as is an empty table."""
    write_rows(tmp_path / "a.csv", [Record("a,b", 0.5), Record("c", None)])
    assert (tmp_path / "a.csv").read_text() == 'name,value\n"a,b",0.5\nc,\n'
    with pytest.raises(StictionError, match="finite"):
        write_rows(tmp_path / "b.csv", [Record("a", float("nan"))])
    with pytest.raises(StictionError, match="at least one"):
        write_rows(tmp_path / "c.csv", [])
