"""How a way of training looks in every figure: the mean over its training seeds, its interval, and each seed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from stiction.report.page import COLORS

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Spread(NamedTuple):
    """What the training seeds reached at one place of the horizontal axis."""

    place: float
    """Where that is, in the axis' unit."""
    mean: float
    """Mean over the seeds."""
    low: float | None
    """Lower end of its 95 % t-interval; None for one seed."""
    high: float | None
    """Upper end."""
    each: str
    """Every seed's, separated by blanks."""


def color_of(way: str, ways: Sequence[str]) -> str:
    """Return the colour of a way of training, the same in every figure."""
    return COLORS[list(ways).index(way) % len(COLORS)]


def style_of(way: str, ways: Sequence[str]) -> str:
    """Return the line style: the second round of colours is dashed."""
    return "-" if list(ways).index(way) < len(COLORS) else "--"


def draw_seeds(axis: Axes, points: Sequence[Spread], way: str, ways: Sequence[str]) -> None:
    """Draw one way of training: the mean as a line, its interval as a band, every seed as a point."""
    color = color_of(way, ways)
    mean = [point.mean for point in points]
    axis.plot([p.place for p in points], mean, color=color, linestyle=style_of(way, ways), linewidth=1.8, label=way)
    for point in points:
        each = [float(one) for one in point.each.split()]
        axis.plot([point.place] * len(each), each, linestyle="", marker=".", markersize=3, color=color)
    known = [(point.place, point.low, point.high) for point in points if point.low is not None]
    if known:
        middle, low, high = zip(*known, strict=True)
        axis.fill_between(middle, low, high, color=color, alpha=0.13, linewidth=0)
