"""Identified friction beside the truth, with numbers worked out by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from stiction.core.errors import StictionError
from stiction.core.records import read_rows, write_rows
from stiction_experiments.bench.robots import IdentifiedFriction, score


def row(joint: str, identified: float | None, half: float = 0.1, **truth: float) -> IdentifiedFriction:
    """Return a joint with f = 2 N m unless told otherwise; half: width of half its interval [N m]."""
    friction, load, strength = (truth.get(name, value) for name, value in TRUTH.items())
    ends = (None, None) if identified is None else (identified - half, identified + half)
    return IdentifiedFriction("r", "physx", "all", "0.1", 7, joint, friction, load, strength, identified, *ends)


TRUTH = {"friction": 2.0, "load": 0.0, "strength": 1.0}


def test_friction_is_judged_in_the_unit_of_the_log() -> None:
    """Friction of 2, 0.2 of load and k = 1.1 show as 2: 2.05 is right within its interval, and 2.5 % off."""
    one = row("a", 2.05, load=0.2, strength=1.1)
    assert one.shown == pytest.approx(2.0) and one.holds(one.shown)
    assert one.error(one.shown) == pytest.approx(0.025)
    other = row("a", 2.2, strength=1.1)
    assert other.shown == pytest.approx(1.81818, abs=1e-5) and not other.holds(other.shown) and not other.holds(2.0)
    assert other.error(2.0) == pytest.approx(0.1)


def test_a_score_counts_and_names_the_worst() -> None:
    """Errors +1, −5 and +10 %: the median is 5 %, the worst +10 % of joint c; d was refused."""
    rows = [row("a", 2.02), row("b", 1.9), row("c", 2.2), row("d", None)]
    total = score(rows)
    assert (total.joints, total.identified, total.held, total.held_friction) == (4, 3, 2, 2)
    assert total.median_error == pytest.approx(0.05) and total.worst_error == pytest.approx(0.1)
    assert total.worst_joint == "r c"


def test_rows_are_read_as_they_were_written(tmp_path: Path) -> None:
    """Rows keep their types: a level is text, an empty cell is None; other files and numbers are rejected."""
    rows = [row("a", 2.02), row("b", None, strength=0.97)]
    write_rows(tmp_path / "bench.csv", rows)
    assert read_rows(tmp_path / "bench.csv", IdentifiedFriction) == rows
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(StictionError, match="first line"):
        read_rows(tmp_path / "other.csv", IdentifiedFriction)
    text = (tmp_path / "bench.csv").read_text()
    (tmp_path / "bench.csv").write_text(text.replace("2.02", "two"))
    with pytest.raises(StictionError, match="two"):
        read_rows(tmp_path / "bench.csv", IdentifiedFriction)
