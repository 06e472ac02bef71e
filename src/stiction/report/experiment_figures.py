"""Figures of the experiment on training with friction: each seed is shown, and the interval of the mean over seeds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from stiction.formats.experiment import CurvePoint, Experiment, SeedMean
from stiction.formats.results import FOLLOWS, ResultRow
from stiction.report.page import COLORS, INK, legend, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DIRECTIONS = {"vx=0.5": "forward, 0.5 m/s", "vx=-0.5": "backward, 0.5 m/s"}

UNITS = {
    "coulomb": "dry friction, % of each joint's torque limit",
    "load": "friction coefficient times 100",
}
"""Label of the axis of levels, by law."""


def short(condition: str) -> str:
    """Return a condition's name without what all have."""
    return condition.removeprefix("coulomb20-")


def _names(axis: Axes) -> None:
    """Add a legend where something was drawn."""
    if axis.get_legend_handles_labels()[0]:
        legend(axis)


def _band(axis: Axes) -> None:
    """Shade the speeds that count as following, and mark standing still."""
    axis.axhspan(*FOLLOWS, color=COLORS[2], alpha=0.12, linewidth=0)
    axis.axhline(0.0, color=INK, linewidth=0.8)


def draw_budget(experiment: Experiment, conditions: Sequence[str], law: str = "coulomb") -> Figure:
    """Return speed ratio over friction level: panels for student and teacher, forward and backward.

    A thin line is a seed, a thick one their mean, the band around it the 95 % t-interval.
    """
    figure, axes = new_figure(2, 2, size=(9.6, 6.4))
    panels = [(who, command) for who in ("student", "teacher") for command in DIRECTIONS]
    for axis, (who, command) in zip(axes, panels, strict=True):
        _band(axis)
        for color, condition in zip(COLORS, conditions, strict=False):
            means = [m for m in experiment.means if (m.condition, m.who, m.command) == (condition, who, command)]
            _draw_mean(axis, sorted(means, key=lambda m: m.friction_level), color, short(condition))
            for points in _by_seed(experiment.rows, condition, who, command):
                axis.plot(*zip(*points, strict=True), color=color, linewidth=0.6, alpha=0.6, marker=".", markersize=3)
        axis.set(title=f"{who}, {DIRECTIONS[command]}", ylabel="speed reached / commanded")
    for axis in axes[2:]:
        axis.set_xlabel(UNITS[law])
    _names(axes[0])
    return figure


def _draw_mean(axis: Axes, means: Sequence[SeedMean], color: str, label: str) -> None:
    """Draw the mean over levels, and its band where there is more than one seed."""
    axis.plot([100 * m.friction_level for m in means], [m.mean for m in means], color=color, linewidth=2, label=label)
    known = [(100 * m.friction_level, m.low, m.high) for m in means if m.low is not None and m.high is not None]
    if known:
        levels, low, high = zip(*known, strict=True)
        axis.fill_between(levels, low, high, color=color, alpha=0.15, linewidth=0)


def _by_seed(rows: Sequence[ResultRow], condition: str, who: str, command: str) -> list[list[tuple[float, float]]]:
    """Return (level in %, speed ratio) of each seed of a condition, by rising level."""
    seeds: dict[int, list[tuple[float, float]]] = {}
    for row in rows:
        named = row.policy == f"{condition}-s{row.seed}/{who}"
        if named and row.command == command and row.speed_ratio is not None:
            seeds.setdefault(row.seed, []).append((100 * row.friction_level, row.speed_ratio))
    return [sorted(points) for points in seeds.values()]


def draw_learning(experiment: Experiment, conditions: Sequence[str]) -> Figure:
    """Return speed ratio in training over the teacher's iterations: a thin line a seed, a thick one their mean."""
    figure, axes = new_figure(1, 2, size=(9.6, 3.4))
    for axis, (name, title) in zip(axes, (("forward_ratio", "forward"), ("backward_ratio", "backward")), strict=True):
        _band(axis)
        for color, condition in zip(COLORS, conditions, strict=False):
            curves = _teacher_curves(experiment.curves, condition, name)
            for curve in curves:
                axis.plot(*zip(*curve, strict=True), color=color, linewidth=0.6, alpha=0.6)
            if curves:
                ends = [end for end, _ in min(curves, key=len)]
                mean = np.mean([[ratio for _, ratio in curve[: len(ends)]] for curve in curves], axis=0)
                axis.plot(ends, mean, color=color, linewidth=2, label=short(condition))
        axis.set(title=f"{title}, while training", xlabel="iteration of the teacher")
    axes[0].set_ylabel("speed reached / commanded")
    _names(axes[0])
    return figure


def _teacher_curves(points: Sequence[CurvePoint], condition: str, name: str) -> list[list[tuple[int, float]]]:
    """Return (iteration, ratio) of the teacher of each run of a condition."""
    runs: dict[str, list[tuple[int, float]]] = {}
    for point in points:
        if point.phase == "teacher" and point.run.rpartition("-s")[0] == condition:
            runs.setdefault(point.run, []).append((point.iteration, getattr(point, name)))
    return list(runs.values())


def draw_conditions(experiment: Experiment, conditions: Sequence[str]) -> Figure:
    """Return the students of many conditions, a line each: without friction, and at each one's nominal level.

    A triangle is a seed, to the right forward, to the left backward; a bar is the 95 % t-interval of a mean over seeds.
    """
    figure, axes = new_figure(1, 2, size=(9.6, 0.9 + 0.32 * max(3, len(conditions))))
    nominal = {condition.name: condition.nominal for condition in experiment.conditions}
    for axis, title in zip(axes, ("without friction", "at the nominal friction"), strict=True):
        axis.axvspan(*FOLLOWS, color=COLORS[2], alpha=0.12, linewidth=0)
        axis.axvline(0.0, color=INK, linewidth=0.8)
        for line, condition in enumerate(conditions):
            level = 0.0 if axis is axes[0] else nominal[condition]
            for command, marker, color, shift in (("vx=0.5", ">", COLORS[0], -0.12), ("vx=-0.5", "<", COLORS[1], 0.12)):
                _draw_line(axis, experiment, (condition, command), level, line + shift, marker, color)
        axis.set_yticks(range(len(conditions)), [short(name) for name in conditions])
        axis.set(title=title, xlabel="speed reached / commanded")
        axis.set_ylim(len(conditions) - 0.5, -0.5)
    axes[1].set_yticklabels([])
    return figure


def _draw_line(
    axis: Axes, experiment: Experiment, cell: tuple[str, str], level: float, y: float, marker: str, color: str
) -> None:
    """Draw the seeds of one condition and command at a level, and the interval of their mean."""
    condition, command = cell
    for row in experiment.rows:
        named = row.policy == f"{condition}-s{row.seed}/student" and row.command == command
        if named and abs(row.friction_level - level) < 1e-6 and row.speed_ratio is not None:
            axis.plot(row.speed_ratio, y, marker=marker, color=color, markersize=4, linewidth=0)
    for m in experiment.means:
        same = (m.condition, m.who, m.command) == (condition, "student", command)
        if same and abs(m.friction_level - level) < 1e-6 and m.low is not None and m.high is not None:
            axis.plot([m.low, m.high], [y, y], color=color, linewidth=1.5, alpha=0.6)


def draw_collapse(experiment: Experiment) -> Figure:
    """Return the slower direction's speed ratio over friction on each candidate axis; where curves agree, it predicts.

    One row a method, one panel an axis; logarithmic, so that a factor is a shift.
    """
    methods = list(dict.fromkeys(onset.method for onset in experiment.onsets))
    names = list(experiment.onsets[0].scales)
    figure, axes = new_figure(len(methods), len(names), size=(3.6 * len(names), 3.0 * len(methods)))
    for axis, (method, name) in zip(axes, [(m, n) for m in methods for n in names], strict=True):
        _band(axis)
        for color, onset in zip(COLORS, [o for o in experiment.onsets if o.method == method], strict=False):
            points = _slower(experiment.means, onset.condition)
            axis.plot(
                [level * onset.scales[name] for level, _ in points],
                [ratio for _, ratio in points],
                color=color,
                marker="o",
                markersize=3,
                label=short(onset.condition),
            )
        axis.set_xscale("log")
        axis.set(title=method, xlabel=name)
    axes[0].set_ylabel("speed reached / commanded")
    for axis in axes[:: len(names)]:
        _names(axis)
    return figure


def _slower(means: Sequence[SeedMean], condition: str) -> list[tuple[float, float]]:
    """Return (level, mean speed ratio of the slower direction) of a condition's students, above level 0."""
    lowest: dict[float, float] = {}
    for m in means:
        if (m.condition, m.who) == (condition, "student") and m.command in DIRECTIONS and m.friction_level > 0:
            lowest[m.friction_level] = min(lowest.get(m.friction_level, m.mean), m.mean)
    return sorted(lowest.items())
