"""The static page: a recorded scene that plays without a server, with the plots of the walk below it."""

from __future__ import annotations

import io
from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Any

import viser
from matplotlib import rc_context
from matplotlib.figure import Figure

from stiction.core.files import publish
from stiction.view.history import COLUMNS, History, belief_text
from stiction.view.plots import INK, top_of
from stiction.view.scene import Scene
from stiction.view.simulation import Simulation

FRAME = 0.04
"""Time between two frames [s]."""

AMBIENT = 2.0
"""Light from everywhere, as bright as the viewer's."""

STYLE = """\
<style>
#root { height: calc(100% - 15em) !important; }
#stiction-plots { position: fixed; bottom: 0; left: 0; right: 0; height: 15em; overflow: auto; display: flex;
  font: 0.8em sans-serif; gap: 0.5em; }
#stiction-plots svg { height: 14.5em; width: auto; flex: none; }
#stiction-plots p { min-width: 14em; margin: 1em; }
</style>"""
"""Style of the plots: a strip below the scene, which scrolls on narrow pages."""

GREY = "#969696"
"""Colour of estimates that are not trusted."""

PLOTS = (("Speed along the command", "m/s"), ("Motor torque", "N m"), ("Friction of the joints", "% of limit"))
"""Title and unit of the plots."""


def write_page(
    server: viser.ViserServer,
    simulation: Simulation,
    path: Path,
    seconds: float,
    dark: bool = False,
    progress: Callable[[float], None] = lambda share: None,
) -> None:
    """Continue a simulation for some time, and write scene and plots as one HTML file.

    server: builds the scene; no browser needs to look at it; progress: called with the share that is done.
    """
    scene, history = Scene(server, simulation, dark), History(simulation, seconds)
    # The player loads an environment map anew whenever it begins again, and the picture is blank meanwhile.
    server.scene.configure_environment_map(None)
    server.scene.add_light_ambient("/light", intensity=AMBIENT)
    # It has the scene as it is now, and records all changes from here on.
    recorded = server.get_scene_serializer()
    every = max(1, round(FRAME / simulation.period))
    steps = round(seconds / simulation.period)
    for number in range(steps):
        simulation.step()
        history.add()
        if number % every == 0:
            scene.draw()
            recorded.insert_sleep(every * simulation.period)
            progress((number + 1) / steps)
    page = recorded.as_html(dark_mode=dark)
    # The last one: text of the client's script may hold the same word.
    end = page.rindex("</body>")
    strip = plots_html(simulation, history, scene.colors, dark)
    with publish(path) as partial:
        partial.write_text(page[:end] + strip + page[end:], encoding="utf-8")


def plots_html(simulation: Simulation, history: History, colors: list[tuple[int, int, int]], dark: bool = False) -> str:
    """Return speed, torque and friction as SVG, and the estimates in words, HTML; colors: of the robots."""
    ink, lattice = INK[dark]
    style: Any = {"svg.fonttype": "none", "font.size": 8, "text.color": ink, "axes.labelcolor": ink, "axes.grid": True}
    style |= {"axes.edgecolor": lattice, "xtick.color": ink, "ytick.color": ink, "grid.color": lattice}
    shades = [tuple(part / 255 for part in color) for color in colors]
    names = [walker.policy.short for walker in simulation.walkers]
    with rc_context(style):
        figures = [figure(title, unit) for title, unit in PLOTS]
        speed, torque, friction = (each.axes[0] for each in figures)
        for axes, (time, *columns) in ((speed, history.speed.columns()), (torque, history.torque.columns())):
            if axes is speed:
                axes.plot(time, columns.pop(0), color=ink, label="command")
            for column, shade, name in zip(columns, shades, names, strict=True):
                axes.plot(time, column, color=shade, label=name, linewidth=1)
        time, true, *estimates = history.friction.columns()
        friction.plot(time, true, color=ink, label="true")
        for number, (shade, walker) in enumerate(zip(shades, simulation.walkers, strict=True)):
            numbers = estimates[COLUMNS * number : COLUMNS * (number + 1)]
            if walker.believes:
                for column, width in zip(numbers[:3], (1.5, 0.7, 0.7), strict=True):
                    # One entry in the legend for an estimate and the ends of its interval.
                    label = f"{walker.policy.short} estimate" if width > 1 else None
                    friction.plot(time, column, color=shade, linewidth=width, label=label)
                friction.plot(time, numbers[3], color=GREY, linestyle="--", label=f"{walker.policy.short} not trusted")
        friction.set_ylim(0, top_of((true, *estimates)))
        torque.set_title(f"Motor torque of {history.joint}")
        for axes in (speed, torque, friction):
            axes.legend(frameon=False, fontsize=7)
        pictures = "".join(map(svg, figures))
    words = "<br><br>".join(escape(line.replace("**", "")) for line in belief_text(simulation.walkers).split("\n\n"))
    background = "#1a1b1e" if dark else "white"
    return f'{STYLE}<div id="stiction-plots" style="background:{background};color:{ink}">{pictures}<p>{words}</p></div>'


def figure(title: str, unit: str) -> Figure:
    """Return an empty plot over time."""
    drawn = Figure((4.6, 2.4), layout="constrained", facecolor="none")
    drawn.add_subplot(title=title, xlabel="time [s]", ylabel=unit, facecolor="none")
    return drawn


def svg(drawn: Figure) -> str:
    """Return a figure as SVG for the body of an HTML file."""
    text = io.StringIO()
    drawn.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()[text.getvalue().index("<svg") :]
