"""Records as tables for people, files, and parts of a configuration."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import pytest

from stiction.core.errors import StictionError
from stiction.core.records import column, header, read_rows, texts, write_rows


@dataclass(frozen=True)
class Joint:
    """A row with a field that tables do not show."""

    name: str = field(metadata=column("joint"))
    seed: int
    friction: float | None = field(metadata=column("friction", "N m", ".1f"))
    share: float = field(metadata=column("of the limit", form=".0%"))
    holds: bool = field(metadata=column("holds"))
    step: float = field(metadata=column("step", form=lambda step: f"{1000 * step:g} ms"))


@dataclass(frozen=True)
class Plain:
    """A row without columns of its own."""

    name: str
    value: float


ROW = Joint("FL|hip", 3, 0.4512, 0.205, True, 0.002)


def test_fields_say_how_people_read_them() -> None:
    """Describes columns at the fields, not on every page."""
    assert header(Joint) == header(ROW) == ("joint", "friction [N m]", "of the limit", "holds", "step")
    assert texts(ROW) == ("FL|hip", "0.5", "20%", "yes", "2 ms")
    assert texts(Joint("a", 0, None, 0.0, False, 0.01)) == ("a", "–", "0%", "no", "10 ms")
    assert (header(Plain), texts(Plain("a", 12.3456))) == (("name", "value"), ("a", "12.3"))


def test_a_file_has_every_field_with_its_digits(tmp_path: Path) -> None:
    """Rounds the table for readers, and writes all digits to the file."""
    write_rows(tmp_path / "a.csv", [ROW])
    assert (tmp_path / "a.csv").read_text().splitlines() == [
        "name,seed,friction,share,holds,step",
        "FL|hip,3,0.4512,0.205,True,0.002",
    ]
    assert read_rows(tmp_path / "a.csv", Joint) == read_rows(tmp_path / "a.csv", Joint, optional=True) == [ROW]
    assert read_rows(tmp_path / "b.csv", Joint, optional=True) == []
    with pytest.raises(StictionError, match=r"b.csv cannot be read"):
        read_rows(tmp_path / "b.csv", Joint)


@dataclass(frozen=True)
class Renamed:
    """A row one of whose fields was called otherwise."""

    name: str
    drawn: float = field(metadata=column("drawn", was="way"))


def test_a_file_of_before_is_read_by_the_names_it_had(tmp_path: Path) -> None:
    """Reads the older names of renamed fields."""
    (tmp_path / "rows.csv").write_text("name,way\nhip,0.5\n")
    assert read_rows(tmp_path / "rows.csv", Renamed) == [Renamed("hip", 0.5)]
    write_rows(tmp_path / "rows.csv", [Renamed("hip", 0.5)])
    assert (tmp_path / "rows.csv").read_text() == "name,drawn\nhip,0.5\n"
