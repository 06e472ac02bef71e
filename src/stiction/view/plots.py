"""The plots of the panel: speed, one joint's torque, friction believed and true."""

from __future__ import annotations

from itertools import chain
from typing import Any

import numpy as np
import viser

from stiction.view.history import FRICTION, SPEED, TORQUE, History
from stiction.view.scene import colors
from stiction.view.simulation import Simulation

DASHES = ((), (10, 4), (3, 3), (12, 3, 3, 3), (6, 6), (2, 6))
"""Of the robots' lines, in turn: told apart without colour too."""

HEIGHT = 140
"""Of a plot [pixels]."""

TOPS = (10.0, 25.0, 50.0, 100.0)
"""Upper ends that the axis of friction may have [%]."""

INK = {False: ("#222222", "#dddddd"), True: ("#e0e0e0", "#444444")}
"""Dark or not -> colour of text and of what was asked for, colour of the plot's lattice."""


class Plots:
    """The three plots of one simulation."""

    def __init__(
        self,
        server: viser.ViserServer,
        tab: viser.GuiTabHandle,
        simulation: Simulation,
        history: History,
        dark: bool = False,
    ) -> None:
        """Make them, empty, in a tab."""
        self._gui, self._tab, self._simulation, self._history = server.gui, tab, simulation, history
        self._handles: list[viser.GuiUplotHandle] = []
        self._top = TOPS[0]
        self.rebuild(dark)

    def rebuild(self, dark: bool) -> None:
        """Draw them anew in a colour scheme."""
        walkers, (ink, _) = self._simulation.walkers, INK[dark]
        lines, beliefs = [], []
        for number, (walker, color) in enumerate(zip(walkers, colors(len(walkers)), strict=True)):
            name, stroke = walker.policy.short, rgb(color)
            lines.append(line(name, stroke, DASHES[number % len(DASHES)]))
            if walker.believes:
                beliefs += [line(f"{name} tells", stroke), *(line(end, stroke, (2, 4), 1) for end in ("from", "to"))]
        for old in self._handles:
            old.remove()
        plots: tuple[tuple[str, str, list[Any], str], ...] = (
            (f"Speed along the command, last {SPEED:.0f} s", "m/s", [line("command", ink), *lines], "speed"),
            (f"Motor torque of that joint, last {TORQUE:.0f} s", "N m", lines, "torque"),
            (f"Friction of the joints, last {FRICTION:.0f} s", "% of limit", [line("true", ink), *beliefs], "friction"),
        )
        with self._tab:
            self._handles = [self._plot(*plot, dark) for plot in plots]
        self._handles[-1].scales = friction_scales(self._top)

    def _plot(self, title: str, unit: str, lines: list[Any], columns: str, dark: bool) -> viser.GuiUplotHandle:
        """Add a plot to the tab."""
        return self._gui.add_uplot(
            self._data(columns),
            ({"label": "time [s]"}, *lines),
            title=title,
            scales={"x": {"time": False}, "y": {"auto": True}},
            axes=axes(unit, dark),
            legend={"show": True},
            height=HEIGHT,
        )

    def update(self) -> None:
        """Show what the history has now."""
        top = top_of(self._data("friction")[1:])
        if top != self._top:
            self._top = top
            self._handles[-1].scales = friction_scales(top)
        for handle, columns in zip(self._handles, ("speed", "torque", "friction"), strict=True):
            handle.data = self._data(columns)

    def _data(self, name: str) -> tuple[np.ndarray, ...]:
        """Return the columns of a plot; that of friction leaves out robots whose walk does not show it."""
        columns = getattr(self._history, name).columns()
        if name != "friction":
            return tuple(columns)
        time, true, *estimates = columns
        believed = [
            estimates[3 * n : 3 * n + 3] for n, walker in enumerate(self._simulation.walkers) if walker.believes
        ]
        return (time, true, *chain(*believed))


def top_of(columns: tuple[np.ndarray, ...]) -> float:
    """Return the upper end of the axis of friction over all numbers of some columns that are any [%]."""
    highest = max((float(np.nanmax(column)) for column in columns if not np.isnan(column).all()), default=0.0)
    return next((top for top in TOPS if 1.1 * highest <= top), TOPS[-1])


def friction_scales(top: float) -> dict[str, Any]:
    """Return the scales of the plot of friction: by itself it finds no range among numbers that are not there yet."""
    return {"x": {"time": False}, "y": {"auto": False, "range": (0.0, top)}}


def rgb(color: tuple[int, int, int]) -> str:
    """Return a colour as a style sheet writes it."""
    return f"rgb({color[0]}, {color[1]}, {color[2]})"


def line(label: str, stroke: str, dash: tuple[int, ...] = (), width: float = 2) -> dict[str, Any]:
    """Return one line of a plot."""
    return {"label": label, "stroke": stroke, "width": width, "points": {"show": False}} | (
        {"dash": list(dash)} if dash else {}
    )


def axes(unit: str, dark: bool) -> tuple[dict[str, Any], ...]:
    """Return the axes of a plot: time [s], and something in a unit."""
    ink, lattice = INK[dark]
    both: dict[str, Any] = {"stroke": ink, "grid": {"stroke": lattice}, "ticks": {"stroke": lattice}}
    return ({**both, "label": "time [s]", "labelSize": 16, "size": 32}, {**both, "label": unit, "size": 44})
