"""The friction budget as a figure: speed over friction, a panel for each engine, ground, law and command."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from stiction.formats.friction import level_axis, level_number
from stiction.formats.replication import Sample
from stiction.formats.results import FOLLOWS, ResultRow
from stiction.report.page import COLORS, INK, legend, new_figure
from stiction.report.seed_figures import Spread, color_of, draw_seeds, style_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Place = tuple[str, str]
"""Engine and ground of a row."""

DEFAULT: Place = ("mujoco", "flat")
"""Where policies walk unless something else is asked for."""


def place_of(row: ResultRow | Sample) -> Place:
    """Return where a row was walked."""
    return row.engine, row.terrain


def places(rows: Sequence[ResultRow]) -> list[Place]:
    """Return every place once."""
    return list(dict.fromkeys(map(place_of, rows)))


def place_text(place: Place) -> str:
    """Return a place as people read it: `physx`, `physx on stairs=0.1`."""
    engine, terrain = place
    return engine if terrain == "flat" else f"{engine} on {terrain}"


def draw_budget(rows: Sequence[ResultRow], samples: Sequence[Sample] = (), ways: Mapping[str, str] = {}) -> Figure:
    """Return the friction budget: speed ratio over friction level, a line for each policy or way of training.

    A column of panels for each command; a row for each place, and for each law there: their levels have other units.
    samples: the ways of training over their seeds; ways: policy -> its way. Of a way with several seeds there is their
    mean with its interval and every seed, see `draw_seeds`; of any other a line for each policy.
    """
    moving = [row for row in rows if row.speed_ratio is not None]
    lines = list(dict.fromkeys((place_of(row), row.friction_law) for row in moving))
    columns = list(dict.fromkeys(row.command for row in moving))
    width, height = max(1, len(columns)), max(1, len(lines))
    figure, axes = new_figure(height, width, size=(4.6 * width, 3.4 * height))
    speeds = [sample for sample in samples if sample.column == "speed_ratio"]
    several = {sample.method for sample in speeds if sample.low is not None}
    drawn = {row.policy: ways[row.policy] if ways.get(row.policy) in several else row.policy for row in rows}
    names = list(dict.fromkeys(drawn.values()))
    for number, axis in enumerate(axes[: len(lines) * len(columns)]):
        (place, law), command = lines[number // width], columns[number % width]
        shown = [row for row in moving if (place_of(row), row.friction_law, row.command) == (place, law, command)]
        axis.set_visible(bool(shown))
        axis.axhspan(*FOLLOWS, color=COLORS[2], alpha=0.12, linewidth=0)
        axis.axhline(0.0, color=INK, linewidth=0.8)
        own = [one for one in speeds if (place_of(one), one.friction_law, one.command) == (place, law, command)]
        for name in names:
            if name in several:
                draw_seeds(axis, _spreads([one for one in own if one.method == name]), name, names)
            else:
                _draw_policy(axis, [row for row in shown if row.policy == name], name, names)
        where = f"{place_text(place)}, " if places(moving) != [DEFAULT] else ""
        axis.set(title=f"{where}commanded {command}", xlabel=level_axis(law))
    if moving:
        for axis in axes[::width]:
            axis.set_ylabel("speed reached / commanded")
        legend(axes[0])
    return figure


def _spreads(samples: Sequence[Sample]) -> list[Spread]:
    """Return the samples of one way in one panel, by their level."""
    own = sorted(samples, key=lambda one: one.friction_level)
    return [Spread(level_number(s.friction_law, s.friction_level), s.mean, s.low, s.high, s.each) for s in own]


def _draw_policy(axis: Axes, rows: Sequence[ResultRow], name: str, names: Sequence[str]) -> None:
    """Draw the rows of one policy in one panel; each has a speed ratio."""
    points = sorted((level_number(row.friction_law, row.friction_level), row.speed_ratio or 0.0) for row in rows)
    levels, ratios = [level for level, _ in points], [ratio for _, ratio in points]
    color, style = color_of(name, names), style_of(name, names)
    axis.plot(levels, ratios, marker="o", markersize=4, label=name, color=color, linestyle=style)
