"""Figures of the study of engines: a joint that breaks away, a free flight, and how fast policies walk."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from stiction.formats.engines import EpisodeRow, Traces, WalkRow
from stiction.report.engine_words import CLOSE
from stiction.report.page import COLORS, INK, legend, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FLOOR = 1e-9
"""Smallest error that is drawn [rad]: a logarithm has no zero."""

STYLES = ("-", "--", "-.", ":")
"""Of the engines' lines, which often lie on each other."""


def draw_motions(motions: Traces) -> Figure:
    """Return a joint's torque, its speed in all engines and in closed form, the error of its angle, and the flight."""
    figure, (load, speed, error, flight) = new_figure(2, 2, size=(9.5, 5.6))
    load.plot(motions.time, motions.load, color=INK)
    load.axhline(1.0, color=INK, linewidth=0.8, linestyle="--")
    load.set(xlabel="time [s]", ylabel="torque over dry friction", title="one joint: held, driven, let go")
    speed.plot(motions.time, motions.exact_speed, color=INK, linewidth=3.0, alpha=0.5, label="exact")
    for number, name in enumerate(motions.speed):
        style = {"color": COLORS[number % len(COLORS)], "linestyle": STYLES[number % len(STYLES)], "linewidth": 1.3}
        speed.plot(motions.time, motions.speed[name], label=name, **style)
        error.semilogy(motions.time, np.maximum(motions.error[name], FLOOR), label=name, **style)
        flight.semilogy(motions.flight_time, np.maximum(motions.flight[name], FLOOR), label=name, **style)
    speed.set(xlabel="time [s]", ylabel="speed [rad/s]", title="its speed, all engines and exact")
    error.set(xlabel="time [s]", ylabel="error of the angle [rad]", title="its angle, against the exact one")
    flight.set(xlabel="time [s]", ylabel="largest error of a joint [rad]", title="free flight, against fine MuJoCo")
    flight.set_ylim(bottom=1e-6)
    for axis in (speed, flight):
        legend(axis)
    return figure


def draw_walks(rows: Sequence[WalkRow], episodes: Sequence[EpisodeRow]) -> Figure:
    """Return speed over commanded speed, a panel a friction level: policies and commands down, simulators by colour."""
    levels = list(dict.fromkeys(row.friction_level for row in rows))
    cells = list(dict.fromkeys((row.policy, row.command) for row in rows))
    names = list(dict.fromkeys(row.simulator for row in rows))
    figure, axes = new_figure(1, len(levels), size=(5.2 * len(levels), 1.6 + 0.8 * len(cells)))
    for axis, level in zip(axes, levels, strict=True):
        axis.axvspan(1 - CLOSE, 1 + CLOSE, color=INK, alpha=0.15, linewidth=0)
        for number, name in enumerate(names):
            offset, color = 0.7 * (number - (len(names) - 1) / 2) / len(names), _color(number)
            mine = [one for one in episodes if (one.simulator, one.friction_level) == (name, level)]
            heights = [cells.index((one.policy, one.command)) + offset for one in mine]
            axis.plot([one.speed_ratio for one in mine], heights, ".", color=color, markersize=3, alpha=0.5)
            means = [row for row in rows if (row.simulator, row.friction_level) == (name, level)]
            heights = [cells.index((row.policy, row.command)) + offset for row in means]
            axis.plot([row.speed_ratio for row in means], heights, "|", color=color, markersize=9, label=name)
        axis.set(xlabel="speed over commanded speed", title=f"{level:.0%} friction", ylim=(len(cells) - 0.5, -0.5))
        axis.set_yticks(range(len(cells)), [f"{policy}\n{command}" for policy, command in cells])
        axis.tick_params(axis="y", labelsize=6)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8, labelcolor=INK, frameon=False)
    return figure


def _color(number: int) -> str:
    """Return the colour of a simulator, one of the page's or of two more."""
    return (INK, *COLORS, "#c9556a")[number % (len(COLORS) + 2)]
