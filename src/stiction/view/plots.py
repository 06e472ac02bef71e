"""The plots: speed, one joint's torque, true and estimated friction, reward terms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
import viser

from stiction.view.history import COLUMNS, FRICTION, SPEED, TORQUE, History, belief_text
from stiction.view.scene import colors
from stiction.view.simulation import Simulation

DASHES = ((), (10, 4), (3, 3), (12, 3, 3, 3), (6, 6), (2, 6))
"""Dashes of the robots' lines in turn: distinguishable without colour."""

DOUBTED, DOUBTED_DASH = "rgb(150, 150, 150)", (6, 5)
"""Colour and dashes of estimates that are not trusted."""

HEIGHT = 140
"""Height of a plot [pixels]."""

TOPS = (10.0, 25.0, 50.0, 100.0)
"""Upper ends of the axis of friction to choose from [%]."""

INK = {False: ("#222222", "#dddddd"), True: ("#e0e0e0", "#444444")}
"""Dark or not -> colour of text and of true or commanded values, colour of the lattice."""


class Plots:
    """The plots of one simulation."""

    def __init__(
        self,
        server: viser.ViserServer,
        tab: viser.GuiTabHandle,
        simulation: Simulation,
        history: History,
        dark: bool = False,
    ) -> None:
        """Add them, empty, to a tab."""
        self._gui, self._tab, self._simulation, self._history = server.gui, tab, simulation, history
        self._dark = dark
        with tab:
            # Ordered behind the plots, which are made anew in another colour scheme.
            self._beliefs = server.gui.add_markdown("", order=1e6)
            self._rewards = server.gui.add_html("", order=2e6, visible=False)
        self._handles: list[viser.GuiUplotHandle] = []
        self._top = TOPS[0]
        self.rebuild(dark)

    def rebuild(self, dark: bool) -> None:
        """Draw them anew in a colour scheme."""
        self._dark = dark
        walkers, (ink, _) = self._simulation.walkers, INK[dark]
        lines, beliefs = [], []
        for number, (walker, color) in enumerate(zip(walkers, colors(len(walkers)), strict=True)):
            name, stroke = walker.policy.short, rgb(color)
            lines.append(line(name, stroke, DASHES[number % len(DASHES)]))
            if walker.believes:
                beliefs += [line(f"{name} not trusted", DOUBTED, DOUBTED_DASH), dots(f"{name} estimate", stroke, 5)]
                beliefs += [dots(end, stroke, 2) for end in ("from", "to")]
        for old in self._handles:
            old.remove()
        self._top = top_of(self._data("friction")[1:])
        plots: tuple[tuple[str, str, list[Any], str], ...] = (
            (f"Speed along the command, last {SPEED:.0f} s", "m/s", [line("command", ink), *lines], "speed"),
            (f"Motor torque of that joint, last {TORQUE:.0f} s", "N m", lines, "torque"),
            (f"Friction of the joints, last {FRICTION:.0f} s", "% of limit", [line("true", ink), *beliefs], "friction"),
        )
        with self._tab:
            self._handles = [self._plot(*plot, dark) for plot in plots]

    def _plot(self, title: str, unit: str, lines: list[Any], columns: str, dark: bool) -> viser.GuiUplotHandle:
        """Add a plot to the tab."""
        return self._gui.add_uplot(
            self._data(columns),
            ({"label": "time [s]"}, *lines),
            title=title,
            scales=friction_scales(self._top) if columns == "friction" else {"x": {"time": False}},
            axes=axes(unit, dark),
            legend={"show": True},
            height=HEIGHT,
        )

    def update(self) -> None:
        """Show the present history."""
        top = top_of(self._data("friction")[1:])
        if top != self._top:
            # New plots: viser keeps a wrong range of time where the scales of one are changed.
            self.rebuild(self._dark)
        for handle, columns in zip(self._handles, ("speed", "torque", "friction"), strict=True):
            handle.data = self._data(columns)
        text = belief_text(self._simulation.walkers)
        if self._beliefs.content != text:
            self._beliefs.content = text
        rewards = {
            walker.policy.short: (rgb(color), self._history.rewards(number))
            for number, (walker, color) in enumerate(
                zip(self._simulation.walkers, colors(len(self._simulation.walkers)), strict=True)
            )
            if walker.rewards is not None
        }
        if rewards:
            self._rewards.content = reward_bars(rewards, INK[self._dark][0])
            self._rewards.visible = True

    def _data(self, name: str) -> tuple[np.ndarray, ...]:
        """Return the columns of a plot; friction without robots that have no map."""
        columns = getattr(self._history, name).columns()
        if name != "friction":
            return tuple(columns)
        time, true, *estimates = columns
        believed = []
        for number, walker in enumerate(self._simulation.walkers):
            if walker.believes:
                *trusted, doubted = estimates[COLUMNS * number : COLUMNS * (number + 1)]
                # uPlot draws lines across NaN: the grey line runs below the dots of trusted estimates instead.
                believed += [np.where(np.isnan(doubted), trusted[0], doubted), *trusted]
        return (time, true, *believed)


def top_of(columns: tuple[np.ndarray, ...]) -> float:
    """Return the upper end of the axis of friction for columns, NaN left out [%]."""
    highest = max((float(np.nanmax(column)) for column in columns if not np.isnan(column).all()), default=0.0)
    return next((top for top in TOPS if 1.1 * highest <= top), TOPS[-1])


def friction_scales(top: float) -> dict[str, Any]:
    """Return the scales of the plot of friction; NaN alone would give it no range."""
    return {"x": {"time": False}, "y": {"auto": False, "range": (0.0, top)}}


def reward_bars(rewards: Mapping[str, tuple[str, Mapping[str, float]]], ink: str) -> str:
    """Return the reward terms as bars, HTML, the largest as long as the row; left of the middle costs.

    rewards: name of the robot -> colour and weighted mean of every term [1/s]; ink: colour of text.
    """
    names = list(dict.fromkeys(name for _, terms in rewards.values() for name in terms))
    largest = max((abs(value) for _, terms in rewards.values() for value in terms.values()), default=0.0) or 1.0
    rows = []
    for name in names:
        bars: Sequence[str] = [
            f'<div title="{escape(robot)} {terms.get(name, 0.0):+.3f}" style="height:4px;background:{color};'
            f"width:{50 * abs(terms.get(name, 0.0)) / largest:.1f}%;"
            f'margin-left:{50 - 50 * max(-terms.get(name, 0.0), 0.0) / largest:.1f}%"></div>'
            for robot, (color, terms) in rewards.items()
        ]
        numbers = " ".join(f"{terms.get(name, 0.0):+.2f}" for _, terms in rewards.values())
        rows.append(
            f'<tr><td>{escape(name)}</td><td style="width:45%">{"".join(bars)}</td>'
            f'<td style="text-align:right">{numbers}</td></tr>'
        )
    title = f"<b>Reward terms of {escape(', '.join(rewards))}</b>, weighted, 1/s"
    return (
        f'<div style="padding:0 0.8em;font-size:0.8em;color:{ink}">{title}'
        f'<table style="width:100%">{"".join(rows)}</table></div>'
    )


def rgb(color: tuple[int, int, int]) -> str:
    """Return a colour in the notation of style sheets."""
    return f"rgb({color[0]}, {color[1]}, {color[2]})"


def line(label: str, stroke: str, dash: tuple[int, ...] = (), width: float = 2) -> dict[str, Any]:
    """Return one line of a plot."""
    return {"label": label, "stroke": stroke, "width": width, "points": {"show": False}} | (
        {"dash": list(dash)} if dash else {}
    )


def dots(label: str, stroke: str, size: float) -> dict[str, Any]:
    """Return a series of dots without a line; size: of a dot [pixels]."""
    return line(label, stroke, width=0) | {"points": {"show": True, "size": size, "fill": stroke, "width": 0}}


def axes(unit: str, dark: bool) -> tuple[dict[str, Any], ...]:
    """Return the axes of a plot: time [s], and something in a unit."""
    ink, lattice = INK[dark]
    both: dict[str, Any] = {"stroke": ink, "grid": {"stroke": lattice}, "ticks": {"stroke": lattice}}
    return ({**both, "label": "time [s]", "labelSize": 16, "size": 32}, {**both, "label": unit, "size": 44})
