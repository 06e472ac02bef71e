"""The figures of the page on wear: speed over wear, and what monitors said against the truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from stiction.formats.life import Life, Reading, Window
from stiction.formats.results import FOLLOWS
from stiction.report.page import COLORS, legend, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_ratios(windows: Sequence[Window], lives: Sequence[Life]) -> Figure:
    """Return the speed ratio over wear, a panel for each level, a colour for each policy."""
    levels = list(dict.fromkeys(row.friction_level for row in lives))
    policies = list(dict.fromkeys(row.policy for row in lives))
    figure, axes = new_figure(len(levels), 1, (8.0, 3.4 * len(levels)))
    for axis, level in zip(axes, levels, strict=True):
        axis.axhspan(*FOLLOWS, color=COLORS[2], alpha=0.12, linewidth=0)
        for color, policy in zip(COLORS * len(policies), policies, strict=False):
            rows = [row for row in windows if (row.policy, row.friction_level) == (policy, level)]
            robots = list(dict.fromkeys(row.robot for row in rows))
            lines = [[row for row in rows if row.robot == robot] for robot in robots]
            for line in lines:
                axis.plot(*_points(line), color=color, linewidth=0.7, alpha=0.5)
            shared = min((len(line) for line in lines), default=0)
            means = [sum(line[at].ratio for line in lines) / len(lines) for at in range(shared)]
            axis.plot([row.factor for row in lines[0][:shared]] if lines else [], means, color=color, label=policy)
        axis.set(xscale="log", xlabel="wear, factor on dry friction", ylabel="speed ratio", title=f"level {level}")
        _plain(axis)
        legend(axis)
    return figure


def _points(line: Sequence[Window]) -> tuple[list[float], list[float]]:
    """Return wear and ratio of a robot's windows."""
    return [row.factor for row in line], [row.ratio for row in line]


TICKS = (0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
"""Factors that are written under an axis, as far as they are on it."""


def _plain(axis: Axes) -> None:
    """Write factors as people do."""
    low, high = axis.get_xlim()
    ticks = [tick for tick in TICKS if low <= tick <= high]
    axis.set_xticks(ticks, [f"x{tick:g}" for tick in ticks])
    axis.set_xticks([], minor=True)


def draw_readings(readings: Sequence[Reading]) -> Figure:
    """Return estimate and truth over time, a panel for each policy and level, a colour for each robot."""
    panels = list(dict.fromkeys((row.policy, row.friction_level) for row in readings))
    figure, axes = new_figure(len(panels), 1, (8.0, 3.4 * len(panels)))
    for axis, panel in zip(axes, panels, strict=True):
        rows = [row for row in readings if (row.policy, row.friction_level) == panel]
        robots = list(dict.fromkeys(row.robot for row in rows))
        for number, robot in enumerate(robots):
            color, mine = COLORS[number % len(COLORS)], [row for row in rows if row.robot == robot]
            axis.plot([row.time for row in mine], [100 * row.true for row in mine], color=color, linewidth=1.0)
            shift = number / len(robots)
            for row in mine:
                if row.estimate is None or row.low is None or row.high is None:
                    continue
                value, ends = 100 * row.estimate, [100 * (row.estimate - row.low), 100 * (row.high - row.estimate)]
                axis.errorbar(
                    row.time + shift,
                    value,
                    [[max(0.0, ends[0])], [max(0.0, ends[1])]],
                    marker="o",
                    markersize=4,
                    color=color,
                    markerfacecolor="none" if row.unusual else color,
                    capsize=2,
                    linewidth=0.8,
                )
            axis.plot([], [], color=color, marker="o", label=f"robot {robot}")
        target = "mean over the joints" if rows[0].target == "level" else rows[0].target
        axis.set(xlabel="time [s]", ylabel=f"f/τ_max [%], {target}", title=f"{panel[0]}, level {panel[1]}")
        legend(axis)
    return figure
