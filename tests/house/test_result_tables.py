"""The speeds in the tables that people wrote are those of the rows beside them."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

RESULTS = Path(__file__).parents[2] / "results"

BOTH_WAYS = re.compile(r"\**(-?\d\.\d\d) / (-?\d\.\d\d)\**(?: \([^)]*\))?\**")
"""A cell of speed over command, forward and backward."""

LEVEL = re.compile(r"(\d+(?:\.\d+)?) %$")
"""The end of a column's title: friction in per cent of the torque limit."""

WHO = ("design", "what", "who", "told", "policy", "seed", "run", "engine", "physics", "terrain", "timestep")
"""Columns that identify policy and condition of a row."""

ROUNDED = 0.0051
"""Half of the last digit that is written, and what floats err by."""

Speeds = dict[tuple[float, str], float]
"""Friction over the torque limit [-] and command -> speed over the command [-]."""


def walked() -> list[Speeds]:
    """Return the speeds of everybody in every file of rows."""
    policies: dict[tuple[str, ...], Speeds] = {}
    for path in sorted(RESULTS.rglob("*.csv")):
        with path.open() as file:
            rows = csv.DictReader(file)
            if not {"friction_level", "command", "speed_ratio"} <= set(rows.fieldnames or ()):
                continue
            for row in rows:
                if row["speed_ratio"] and row["command"] in ("vx=0.5", "vx=-0.5"):
                    who = (str(path), *(row.get(name) or "" for name in WHO))
                    at = round(float(row["friction_level"]), 4), row["command"]
                    policies.setdefault(who, {})[at] = float(row["speed_ratio"])
    return list(policies.values())


def written(page: str) -> Iterator[tuple[str, Speeds, str]]:
    """Yield each row of a page's tables over friction, its speeds, and its mean deviation, empty without one.

    A level that comes once more in a table begins other conditions: another engine, other robots.
    """
    titles: list[str] | None = None
    for line in page.splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")] if line.startswith("|") else None
        if cells is None or titles is None:
            titles = cells
            continue
        speeds: Speeds = {}
        parts, deviation = [speeds], ""
        for title, cell in zip(titles, cells, strict=False):
            level, both = LEVEL.search(title.strip("* ")), BOTH_WAYS.fullmatch(cell)
            if title.strip("* ") == "mean deviation":
                deviation = cell.strip("* ")
            if level is None or both is None:
                continue
            at = round(float(level[1]) / 100, 4)
            if (at, "vx=0.5") in parts[-1]:
                parts.append({})
            parts[-1] |= {(at, "vx=0.5"): float(both[1]), (at, "vx=-0.5"): float(both[2])}
        yield from ((line, part, deviation if len(parts) == 1 else "") for part in parts if len(part) >= 6)


PAGES = sorted(path for path in RESULTS.rglob("*.md") if list(written(path.read_text())))


def test_a_row_is_read_as_it_is_written() -> None:
    """By hand: two levels more than once are two conditions, bold and what is in brackets do not count."""
    page = "| who | PhysX, 0 % | 10 % | 20 % | robots, 0 % | 10 % | 20 % |\n|---|---|---|---|---|---|---|\n"
    page += "| a | **1.00 / 0.90** | 1.01 / 0.91 (0.8, 1.1) | 1.02 / 0.92 | 0.50 / 0.40 | 0.51 / 0.41 | 0.52 / 0.42 |\n"
    first, second = (speeds for _, speeds, _ in written(page))
    assert first[0.0, "vx=0.5"] == 1.0 and first[0.1, "vx=-0.5"] == 0.91 and second[0.2, "vx=-0.5"] == 0.42
    assert len(first) == len(second) == 6


@pytest.fixture(scope="module", name="rows")
def everybody() -> list[Speeds]:
    """Return what `walked` finds, once."""
    return walked()


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(RESULTS)))
def test_every_row_is_one_that_was_walked(path: Path, rows: list[Speeds]) -> None:
    """Every row of speeds on a page rounds those of one measured row."""
    strange = [
        line
        for line, speeds, _ in written(path.read_text())
        if not any(all(abs(there.get(at, 9.0) - speed) < ROUNDED for at, speed in speeds.items()) for there in rows)
    ]
    assert not strange, "\n".join(strange)


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(RESULTS)))
def test_the_mean_deviation_is_that_of_the_row(path: Path) -> None:
    """|speed over command - 1| in the mean; if this failed, a design would be called better or worse than it is."""
    for line, speeds, deviation in written(path.read_text()):
        if deviation:
            mean = sum(abs(speed - 1.0) for speed in speeds.values()) / len(speeds)
            assert abs(float(deviation) - mean) < ROUNDED + 0.0005, line
