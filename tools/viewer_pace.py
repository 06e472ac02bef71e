"""Measure the viewer with one robot: frames a second, and how long a slider and a key take to act.

    python tools/viewer_pace.py --seconds 10 --presses 12

One JSON object. The viewer runs in a process of its own: first as fast as it can, then at real time without a browser,
then at real time for a headless Chromium that draws the page on the same machine, in software. A press is timed from
before the browser is told of it to the viewer being asked, to the friction being set in the simulation, to the end of
the first control step under it, and to the first frame after that being sent; up to the viewer being asked the browser
works. Needs the extras `view` and `dev`, and Chromium.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tools/shipped_robots"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests/helpers"))

from browser import Tab, chromium, find_chromium

Event = tuple[str, float, float]
"""Event (`asked`, `level`, `step`, `frame`), time by the clock of all processes, and processor time [s]."""

SLIDER = "[...document.querySelectorAll('[role=slider]')].find(one => one.getAttribute('aria-valuemax') === '90')"
"""The handle of the first slider of friction, which is that of all joints."""

PAINTED = """new Promise(done => {
  let frames = 0; const began = performance.now();
  const paint = () => {
    const passed = (performance.now() - began) / 1000; frames += 1;
    passed < %g ? requestAnimationFrame(paint) : done(frames / passed);
  };
  requestAnimationFrame(paint);
})"""
"""Counts how often the page is painted a second, for so many seconds."""

READY = 5
"""Looks of three seconds at a page that loads the robot and makes ready to draw, before it is measured as it is."""

PAUSE = 1.0
"""Between two presses [s]."""


def watch(owner: Any, method: str, kind: str, events: list[Event]) -> None:
    """Note every end of a call of a method."""
    original: Callable[..., Any] = getattr(owner, method)

    def called(*words: Any) -> Any:
        result = original(*words)
        events.append((kind, time.monotonic(), time.process_time()))
        return result

    setattr(owner, method, called)


def rates(events: list[Event], began: float, ended: float, period: float) -> dict[str, float]:
    """Return what happened between two times: pace [1], frames a second, cores used for a simulated second [s]."""
    inside = [event for event in events if began <= event[1] <= ended]
    steps, frames = (sum(kind == event[0] for event in inside) for kind in ("step", "frame"))
    if not steps:
        raise SystemExit("the viewer took no control step; is the machine too busy?")
    passed, used = (inside[-1][k] - inside[0][k] for k in (1, 2))
    return {
        "times_real_time": round(steps * period / passed, 2),
        "frames_per_second": round(frames / passed, 1),
        "core_seconds_per_simulated_second": round(used / (steps * period), 3),
    }


def viewer(name: str, seconds: float, parent: Connection) -> None:
    """Show a policy to the parent: two measurements, the address, and when that is told to end every event."""
    from stiction.cli.view import ViewCfg, policies_of, simulation_of
    from stiction.view.server import serve
    from stiction.view.viewer import Viewer

    cfg = ViewCfg(policies=(Path(name),), command="vx=0.5")
    policies, robot, _ = policies_of(cfg)
    simulation = simulation_of(cfg, policies, robot)
    with serve() as server, tempfile.TemporaryDirectory() as folder:
        shown = Viewer(server, simulation, Path(folder))
        events: list[Event] = []
        for owner, method, kind in (
            (simulation, "step", "step"),
            (shown.scene, "draw", "frame"),
            (simulation, "set_level", "level"),
            (shown, "submit", "asked"),
        ):
            watch(owner, method, kind, events)
        measured = {}
        began = time.monotonic()
        while time.monotonic() < began + seconds:
            shown.turn()
            shown.show(time.monotonic())
        measured["flat_out"] = rates(events, began, time.monotonic(), simulation.period)
        began = time.monotonic()
        shown.run(lambda: time.monotonic() > began + seconds, always=True)
        measured["real_time_no_browser"] = rates(events, began, time.monotonic(), simulation.period)
        parent.send((f"http://127.0.0.1:{server.get_port()}", simulation.period, measured))
        shown.run(parent.poll)
        parent.send(events)


def press(tab: Tab, times: int, key: str, code: str) -> list[float]:
    """Press a key so often; return when."""
    pressed = []
    for _ in range(times):
        pressed.append(time.monotonic())
        tab.press(key, code)
        time.sleep(PAUSE)
    return pressed


def delays(pressed: list[float], events: list[Event]) -> dict[str, list[float | None]]:
    """Return how long each press took to each of its effects [s]; None: the next press came before."""
    waits: dict[str, list[float | None]] = {"asked": [], "friction_set": [], "control_step": [], "frame_sent": []}
    for at, end in zip(pressed, [*pressed[1:], float("inf")], strict=True):
        after = at
        for name, kind in zip(waits, ("asked", "level", "step", "frame"), strict=True):
            after = next((when for what, when, _ in events if what == kind and when > after), float("inf"))
            waits[name].append(round(after - at, 3) if after < end else None)
    return waits


def main() -> None:
    """Measure, and print the results."""
    reader = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    reader.add_argument("--policy", default="saturn_lite-flat-deception-0.2", help="name or folder of a bundle")
    reader.add_argument("--seconds", type=float, default=10.0, help="length of each measurement [s]")
    reader.add_argument("--presses", type=int, default=12, help="of the slider, and as many of the key")
    options = reader.parse_args()
    if find_chromium() is None:
        raise SystemExit("there is no Chromium here (Debian: apt install chromium)")
    load = [os.getloadavg()[0]]
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=viewer, args=(options.policy, options.seconds, there), daemon=True)
    process.start()
    there.close()  # so that a viewer that ends early is no reason to wait
    address, period, measured = here.recv()
    with tempfile.TemporaryDirectory() as folder, chromium(Path(folder) / "profile") as browser:
        tab = browser.tab(address)
        tab.call("Page.bringToFront")  # a page behind another one is not painted
        tab.wait(f"!!({SLIDER})")
        for _ in range(READY):
            if tab.run(PAINTED % 3.0) > 1.0:
                break
        began = time.monotonic()
        painted = tab.run(PAINTED % options.seconds)
        ended = time.monotonic()
        keyed = press(tab, options.presses, "g", "KeyG")
        tab.run(f"{SLIDER}.focus()")
        slid = press(tab, options.presses, "ArrowRight", "ArrowRight")
        here.send("end")
        events = here.recv()
    process.join()
    load.append(os.getloadavg()[0])
    measured["real_time_browser"] = rates(events, began, ended, period) | {"page_painted_per_second": round(painted, 1)}
    measured["key_to"], measured["slider_to"] = delays(keyed, events), delays(slid, events)
    measured |= {"policy": options.policy, "cores": os.cpu_count(), "load_average_before_after": load}
    print(json.dumps(measured, indent=1))


if __name__ == "__main__":
    main()
