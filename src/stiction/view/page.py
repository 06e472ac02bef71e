"""A page that needs no server: some seconds of the robots, in viser's own player, to be turned and zoomed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import viser

from stiction.core.files import publish
from stiction.view.scene import Scene
from stiction.view.simulation import Simulation

FRAME = 0.04
"""Time between two frames [s]."""

AMBIENT = 2.0
"""Light from everywhere, as bright as the viewer's."""


def write_page(
    server: viser.ViserServer,
    simulation: Simulation,
    path: Path,
    seconds: float,
    dark: bool = False,
    progress: Callable[[float], None] = lambda share: None,
) -> None:
    """Let a simulation go on for some seconds and write what is to be seen as one HTML file.

    server: makes the scene; nobody needs to look at it.
    """
    scene = Scene(server, simulation, dark)
    # The player loads an environment map anew whenever it begins again, and the picture is blank meanwhile.
    server.scene.configure_environment_map(None)
    server.scene.add_light_ambient("/light", intensity=AMBIENT)
    # It has the scene as it is now, and records what changes from here on.
    recorded = server.get_scene_serializer()
    every = max(1, round(FRAME / simulation.period))
    steps = round(seconds / simulation.period)
    for number in range(steps):
        simulation.step()
        if number % every == 0:
            scene.draw()
            recorded.insert_sleep(every * simulation.period)
            progress((number + 1) / steps)
    with publish(path) as partial:
        partial.write_text(recorded.as_html(dark_mode=dark), encoding="utf-8")
