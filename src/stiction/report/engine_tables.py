"""Tables of the study of engines: figures that pass or fail, pace, and how fast policies walk."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from markupsafe import Markup

from stiction.formats.engines import FigureRow, PaceRow, WalkRow
from stiction.report.engine_words import CLOSE, judge
from stiction.report.page import table


def figure_table(rows: Sequence[FigureRow], timestep: float) -> tuple[list[str], list[list[str]]]:
    """Return header and lines of the figures at one timestep: a figure a line, an engine a column."""
    mine = [row for row in rows if row.timestep == timestep]
    engines = list(dict.fromkeys(row.engine for row in mine))
    lines: dict[tuple[str, str], dict[str, FigureRow]] = {}
    for row in mine:
        lines.setdefault((row.check, row.figure), {})[row.engine] = row
    cells = []
    for (check, figure), found in lines.items():
        one = next(iter(found.values()))
        values = [_cell(found[name]) if name in found else "–" for name in engines]
        complete = len(found) == len(engines) and all(row.passed for row in found.values())
        verdict = "pass" if complete else "FAIL"
        cells.append([check, figure, f"{one.bound:.3g}{unit(one)}", *values, verdict])
    return ["check", "figure", "bound", *engines, "verdict"], cells


def _cell(row: FigureRow) -> str:
    """Return a figure as a cell that cannot be read as a pass where it is none."""
    return value(row) if row.passed else f"{value(row)} FAIL"


def unit(row: FigureRow) -> str:
    """Return the unit after a space, nothing for a ratio or a count."""
    return "" if row.unit == "1" else f" {row.unit}"


def value(row: FigureRow) -> str:
    """Return what came out, as text."""
    return "not a number" if row.value is None else f"{row.value:.2g}"


def pace_cells(row: PaceRow) -> list[str]:
    """Return a pace as cells."""
    return [row.engine, f"{1000 * row.timestep:g} ms", f"{row.steps_per_second:,.0f}", f"{row.share:.2f}"]


def walk_table(rows: Sequence[WalkRow]) -> Markup:
    """Return the speeds: policy, friction and command down, simulators across."""
    return _walk_cells(rows, _speeds, "Speed over the commanded speed, and over that in training's simulator.")


def verdict_table(rows: Sequence[WalkRow]) -> Markup:
    """Return whether speeds are within ±10 %, and falls; the same lines and columns."""
    caption = (
        f"Whether the whole interval is within ±{CLOSE:.0%} of the commanded speed / of the speed in training's "
        "simulator, and robots that fell with Wilson's 95 % interval."
    )
    return _walk_cells(rows, _verdicts, caption)


def _walk_cells(rows: Sequence[WalkRow], cell: Callable[[WalkRow], str], caption: str) -> Markup:
    """Return a table with a cell for each row."""
    names = list(dict.fromkeys(row.simulator for row in rows))
    lines: dict[tuple[str, float, str], dict[str, str]] = {}
    for row in rows:
        lines.setdefault((row.policy, row.friction_level, row.command), {})[row.simulator] = cell(row)
    body = [
        [policy, f"{level:.0%}", command, *(found.get(name, "–") for name in names)]
        for (policy, level, command), found in lines.items()
    ]
    return table(["policy", "friction", "command", *names], body, caption)


def _speeds(row: WalkRow) -> str:
    """Return speed and ratio with their intervals."""
    text = f"{row.speed_ratio:.2f}{_interval(row.speed_low, row.speed_high)}"
    if row.to_training is None:
        return text
    return f"{text}; {row.to_training:.2f}{_interval(row.to_training_low, row.to_training_high)}"


def _interval(low: float | None, high: float | None) -> str:
    """Return an interval in brackets, nothing where there is none."""
    return "" if low is None or high is None else f" ({low:.2f} to {high:.2f})"


def _verdicts(row: WalkRow) -> str:
    """Return both verdicts, and falls."""
    against = "" if row.to_training is None else f" / {judge(row.to_training_low, row.to_training_high)}"
    falls = f"{row.falls} of {row.episodes} fell, {row.fall_low:.0%} to {row.fall_high:.0%}"
    return f"{judge(row.speed_low, row.speed_high)}{against}; {falls}"
