"""The friction budget as a figure: speed over friction, a panel for each engine, ground, law and command."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from stiction.formats.friction import level_axis, level_number
from stiction.formats.results import FOLLOWS, ResultRow
from stiction.report.page import COLORS, INK, legend, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Place = tuple[str, str]
"""Engine and ground of a row."""

DEFAULT: Place = ("mujoco", "flat")
"""Where policies walk unless something else is asked for."""


def place_of(row: ResultRow) -> Place:
    """Return where a row was walked."""
    return row.engine, row.terrain


def places(rows: Sequence[ResultRow]) -> list[Place]:
    """Return every place once."""
    return list(dict.fromkeys(map(place_of, rows)))


def place_text(place: Place) -> str:
    """Return a place as people read it: `physx`, `physx on stairs=0.1`."""
    engine, terrain = place
    return engine if terrain == "flat" else f"{engine} on {terrain}"


def draw_budget(rows: Sequence[ResultRow]) -> Figure:
    """Return the friction budget: speed ratio over friction level, a line for each policy.

    A column of panels for each command; a row for each place, and for each law there: their levels have other units.
    """
    moving = [row for row in rows if row.speed_ratio is not None]
    lines = list(dict.fromkeys((place_of(row), row.friction_law) for row in moving))
    columns = list(dict.fromkeys(row.command for row in moving))
    width, height = max(1, len(columns)), max(1, len(lines))
    figure, axes = new_figure(height, width, size=(4.6 * width, 3.4 * height))
    for number, axis in enumerate(axes[: len(lines) * len(columns)]):
        (place, law), command = lines[number // width], columns[number % width]
        shown = [row for row in moving if (place_of(row), row.friction_law, row.command) == (place, law, command)]
        axis.set_visible(bool(shown))
        axis.axhspan(*FOLLOWS, color=COLORS[2], alpha=0.12, linewidth=0)
        axis.axhline(0.0, color=INK, linewidth=0.8)
        for policy in dict.fromkeys(row.policy for row in rows):
            points = sorted((row for row in shown if row.policy == policy), key=lambda row: row.friction_level)
            levels = [level_number(law, row.friction_level) for row in points]
            axis.plot(levels, [row.speed_ratio for row in points], marker="o", markersize=4, label=policy)
        where = f"{place_text(place)}, " if places(moving) != [DEFAULT] else ""
        axis.set(title=f"{where}commanded {command}", xlabel=level_axis(law))
    if moving:
        for axis in axes[::width]:
            axis.set_ylabel("speed reached / commanded")
        legend(axes[0])
    return figure
