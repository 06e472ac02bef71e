"""Figures of the paper's comparison: the friction budget, and which training a joint needs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

from stiction.formats.friction import has_coefficient, level_axis, level_number
from stiction.formats.replication import CAUSES, FEWEST_LEVELS, BudgetPoint, Onset
from stiction.formats.results import FOLLOWS
from stiction.report.page import COLORS, INK, new_figure
from stiction.report.seed_figures import Spread, color_of, draw_seeds

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKS = "osD^vP*X"
"""One an engine."""


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


def draw_needs(onsets: Sequence[Onset], ways: Sequence[str]) -> Figure:
    """Return up to which friction each way of training follows: a bar to its `reach`, a mark an engine.

    What is hollow is at least as far: nobody fell below 80 % up to there, and nothing was tested beyond.

    onsets: none of a coefficient, at least one in an engine that is none of `CAUSES`.
    """
    engines = list(dict.fromkeys(onset.engine for onset in onsets))
    own = {way: [onset for onset in onsets if onset.method == way] for way in ways}
    rows = {way: found for way in ways if (found := reach(own[way])) is not None}
    figure, (axis,) = new_figure(1, 1, size=(9.0, 0.5 * max(1, len(rows)) + 1.6))
    for height, (way, (level, falls)) in enumerate(rows.items()):
        color = color_of(way, ways)
        look = {"color": color, "alpha": 0.35} if falls else {"facecolor": "none", "edgecolor": color}
        axis.barh(height, 100 * level, height=0.6, **look)
        for onset in own[way]:
            mark = MARKS[engines.index(onset.engine) % len(MARKS)]
            axis.plot(100 * end(onset), height, marker=mark, color=color, markersize=6, fillstyle=_filled(onset))
    for number, engine in enumerate(engines):
        axis.plot([], [], linestyle="", marker=MARKS[number % len(MARKS)], color=INK, label=engine)
    axis.set_yticks(range(len(rows)), rows)
    axis.set(xlabel="dry friction, % of each joint's torque limit", ylim=(len(rows) - 0.5, -0.5), xlim=(0, None))
    axis.legend(fontsize=8, labelcolor=INK, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _filled(onset: Onset) -> Literal["full", "left", "none"]:
    """Return how a mark is filled: where every seed falls, where some do, and where none does up to there."""
    above = onset.each.count(">")
    return "full" if not above else "none" if onset.level is None else "left"


def end(onset: Onset) -> float:
    """Return up to which friction a way is known to follow in an engine [-]: its onset, or else what was tested."""
    return onset.tested if onset.level is None else onset.level


def reach(onsets: Sequence[Onset]) -> tuple[float, bool] | None:
    """Return up to which friction one way follows in all engines [-], and whether it falls there.

    That is its lowest onset; where it has none, the highest friction that was tested anywhere: an engine in which it
    was tested less limits nothing. None where it walked in no engine but `CAUSES`.
    """
    counting = [onset for onset in onsets if onset.engine not in CAUSES]
    falls = [onset.level for onset in counting if onset.level is not None]
    if falls:
        return min(falls), True
    return (max(onset.tested for onset in counting), False) if counting else None
