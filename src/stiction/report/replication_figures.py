"""Figures of the paper's comparison: the friction budget, and which training a joint needs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from stiction.formats.following import Following
from stiction.formats.friction import has_coefficient, level_axis, level_number, level_text
from stiction.formats.replication import FEWEST_LEVELS, BudgetPoint
from stiction.formats.results import FOLLOWS
from stiction.report.page import COLORS, INK, new_figure
from stiction.report.seed_figures import Spread, draw_seeds

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def curves(points: Sequence[BudgetPoint]) -> dict[tuple[str, str], list[BudgetPoint]]:
    """Return the points of each engine and law that have levels enough for a curve."""
    groups: dict[tuple[str, str], list[BudgetPoint]] = {}
    for point in points:
        groups.setdefault((point.engine, point.friction_law), []).append(point)
    return {key: some for key, some in groups.items() if len({p.friction_level for p in some}) >= FEWEST_LEVELS}


def draw_budget(points: Sequence[BudgetPoint], ways: Sequence[str], band: float) -> Figure:
    """Return speed ratio of the slower direction over friction, a panel for each of `curves`, at least one.

    band: dead band f/kp of the shank at a friction of the whole torque limit [rad], for the axis on top.
    """
    shown = curves(points)
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    figure, axes = new_figure(rows, columns, size=(max(6.3, 4.2 * columns), 3.7 * rows))
    for axis, ((engine, law), some) in zip(axes, shown.items(), strict=False):
        axis.axhspan(*FOLLOWS, color=COLORS[2], alpha=0.12, linewidth=0)
        axis.axhline(0.0, color=INK, linewidth=0.8)
        for way in ways:
            own = sorted((p for p in some if p.method == way), key=lambda p: p.friction_level)
            if own:
                places = (level_number(law, p.friction_level) for p in own)
                spreads = [Spread(at, p.ratio, p.low, p.high, p.each) for at, p in zip(places, own, strict=True)]
                draw_seeds(axis, spreads, way, ways)
        axis.set(title=engine, xlabel=level_axis(law), ylim=(-0.2, 1.9))
        if not has_coefficient(law):
            _dead_band(axis, band)
    for axis in axes[len(shown) :]:
        axis.set_visible(False)
    axes[0].set_ylabel("speed reached / commanded")
    lines = {line.get_label(): line for axis in axes for line in axis.get_legend_handles_labels()[0]}
    drawn = [way for way in ways if way in lines]
    handles = [lines[way] for way in drawn]
    figure.legend(handles, drawn, loc="outside lower center", ncols=5, fontsize=8, labelcolor=INK, frameon=False)
    return figure


def _dead_band(axis: Axes, band: float) -> None:
    """Add the axis of the shank's dead band on top."""
    unit = 10 * band  # mrad per per cent

    def angle(level: Any) -> Any:
        return level * unit

    def level(angle: Any) -> Any:
        return angle / unit

    top = axis.secondary_xaxis("top", functions=(angle, level))
    top.set_xlabel("dead band f/kp of the shank [mrad]", fontsize=8, color=INK)
    top.tick_params(colors=INK, labelsize=7)


def draw_needs(cells: Sequence[Following], ways: Sequence[str]) -> Figure:
    """Return how many seeds of each way follow at each tested level, a panel for each place; at least one cell.

    The greener, the more seeds; ▼ so many are too slow, ▲ so many too fast, × so many fell.
    """
    places = list(dict.fromkeys(cell.engine for cell in cells))
    levels = sorted({cell.friction_level for cell in cells})
    shown = [way for way in ways if any(cell.method == way for cell in cells)]
    columns = min(2, len(places))
    height = -(-len(places) // columns)
    figure, axes = new_figure(height, columns, size=(5.4 * columns, (0.62 * len(shown) + 1.1) * height))
    for axis, place in zip(axes, places, strict=False):
        for cell in (cell for cell in cells if cell.engine == place and cell.method in shown):
            at, row = levels.index(cell.friction_level), shown.index(cell.method)
            share = cell.follow / cell.seeds
            axis.barh(row, 0.94, 0.9, at - 0.47, color=COLORS[2], alpha=0.05 + 0.6 * share, linewidth=0)
            wrong = (("▼", cell.too_slow), ("▲", cell.too_fast), ("×", cell.fell))
            text = " ".join(f"{mark}{number}" for mark, number in wrong if number)
            said = f"{cell.follow} of {cell.seeds}" + (f"\n{text}" if text else "")
            axis.text(at, row, said, ha="center", va="center", fontsize=7.5, color=INK)
        axis.set_xticks(range(len(levels)), [level_text("coulomb", level) for level in levels])
        axis.set_yticks(range(len(shown)), shown)
        axis.grid(False)
        axis.set(title=place, xlim=(-0.5, len(levels) - 0.5), ylim=(len(shown) - 0.5, -0.5))
    for axis in axes[len(places) :]:
        axis.set_visible(False)
    figure.supxlabel("dry friction over each joint's torque limit", fontsize=9, color=INK)
    return figure
