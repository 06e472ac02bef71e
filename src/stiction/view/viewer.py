"""One simulation in any number of browsers: the loop that keeps time and runs their actions between control steps."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import viser

from stiction.core.errors import StictionError
from stiction.evaluation.course import parse_course
from stiction.view.clip import ClipBuffer, render_shot
from stiction.view.history import History
from stiction.view.panel import PACES, Panel
from stiction.view.plots import Plots
from stiction.view.recorder import Recorder, write_recording
from stiction.view.scene import Scene
from stiction.view.server import LocalServer
from stiction.view.simulation import Run, Simulation, ViewedPolicy, Walker, viewed

LATE = 0.1
"""Delay from which the loop gives up its pace, and the robots walk in slow motion [s]."""

SLOWEST = 1.0 / 30.0
"""Longest time between two frames of a loop that is late [s]."""

PLOTS_EVERY, STATUS_EVERY = 0.25, 0.5
"""Time between two updates of the plots and of the status [s]."""

PLOTS_WIDTH = 340
"""Width of the window of the plots [pixels]."""

IDLE = 0.1
"""Time between two looks for a browser while there is none [s]."""

MOST_ACTIONS = 1000
"""Largest number of waiting actions of browsers; more are dropped."""


class Viewer:
    """The session of a server: simulation, scene, panel, plots, recording."""

    def __init__(
        self,
        server: LocalServer,
        simulation: Simulation,
        out: Path,
        dark: bool = False,
        runs: Mapping[int, Run] | None = None,
    ) -> None:
        """Show a simulation; out: folder of recordings; runs: training runs, by number of their robot."""
        self.server, self.simulation, self._out, self._runs = server, simulation, out, runs or {}
        self._actions: queue.Queue[Callable[[], None]] = queue.Queue(MOST_ACTIONS)
        self.scene = Scene(server, simulation, dark)
        self.history, self._clips = History(simulation), ClipBuffer(simulation)
        self._drawing: threading.Thread | None = None
        self.panel = Panel(server, self, dark, self._runs)
        self._axes: tuple[float, ...] | None = None
        server.pads.append(lambda axes: setattr(self, "_axes", axes))
        server.gui.main_panel.dock_right()
        window = server.gui.add_panel()
        window.dock_left()
        window.set_width(PLOTS_WIDTH)
        tab = window.add_tab("Plots")
        with tab:
            names = simulation.spec.joint_names
            self.joint = server.gui.add_dropdown("Joint", names, initial_value=self.history.joint)
            self.joint.on_update(lambda _: self.submit(lambda: self.show_joint(str(self.joint.value))))
        self.plots = Plots(server, tab, simulation, self.history, dark)
        self.paused, self.factor, self.pace = False, 1.0, 1.0
        self._recorder: Recorder | None = None
        self._recorded: Walker | None = None
        self._receiver: viser.ClientHandle | None = None
        self._due = {"plots": 0.0, "status": 0.0}
        self._show_theme(dark)

    def submit(self, action: Callable[[], None]) -> None:
        """Run an action before the next control step; its `StictionError` is shown in all browsers."""
        try:
            self._actions.put_nowait(action)
        except queue.Full:
            return

    def turn(self) -> None:
        """Run the waiting actions, and take one control step unless paused."""
        self._act()
        if not self.paused:
            self._advance()

    def _advance(self) -> None:
        """Take one control step."""
        self.simulation.step()
        self.history.add()
        self._clips.add()
        self._record()

    def _act(self) -> None:
        """Run the waiting actions of browsers."""
        # The newest state of a gamepad only: a browser that sends without end fills no queue.
        axes, self._axes = self._axes, None
        if axes is not None:
            self._attempt(lambda: self.panel.steer(axes))
        # So many and no more: browsers that ask without end must not hold up the step.
        for _ in range(MOST_ACTIONS):
            try:
                action = self._actions.get_nowait()
            except queue.Empty:
                return
            self._attempt(action)

    def _attempt(self, action: Callable[[], None]) -> None:
        """Run an action; show its error in all browsers."""
        try:
            action()
        except StictionError as error:
            self.panel.say("That cannot be done", " ".join(str(error).split()))
            # A choice that failed is still shown in the browsers: it is put back.
            self.panel.show_choices()

    def show(self, now: float, draw: bool = True) -> None:
        """Update the browsers; now: of a monotonic clock [s]; draw: the robots too."""
        if draw:
            self.scene.draw()
        if now >= self._due["plots"]:
            self._due["plots"] = now + PLOTS_EVERY
            self.plots.update()
        if now >= self._due["status"]:
            self._due["status"] = now + STATUS_EVERY
            recorded = None if self._recorder is None else self._recorder.seconds
            asked = "" if self.pace == 1.0 else f" of {self.pace:g}"
            pace = "paused" if self.paused else f"{self.factor:.2f}{asked} × real time"
            self.panel.show_status(pace, self.history.speeds(), recorded)

    def run(self, ended: Callable[[], bool] = lambda: False, always: bool = False) -> None:
        """Keep time until `ended`. While no browser is connected, time stands still unless `always`."""
        due = began = time.monotonic()
        simulated, drawn = self.simulation.time, 0.0
        while not ended():
            if not always and not self.server.get_clients():
                self._act()
                time.sleep(IDLE)
                # Time without browsers is not caught up.
                due = began = time.monotonic()
                simulated = self.simulation.time
                continue
            self.turn()
            due += self.simulation.period / self.pace
            now = time.monotonic()
            # A loop that is late draws less, so that the robots fall behind as little as can be.
            draw = now < due or now - drawn >= SLOWEST
            drawn = now if draw else drawn
            self.show(now, draw)
            if now - began >= 1.0:
                self.factor = max(self.simulation.time - simulated, 0.0) / (now - began)
                began, simulated = now, self.simulation.time
            left = due - time.monotonic()
            if left > 0:
                time.sleep(left)
            elif left < -LATE:
                due = time.monotonic()

    def toggle_pause(self) -> None:
        """Pause or continue."""
        self.paused = not self.paused

    def step_once(self) -> None:
        """Pause, and take one control step."""
        self.paused = True
        self._advance()

    def set_pace(self, pace: float) -> None:
        """Set the speed of the simulation, as a multiple of real time, one of `PACES`."""
        if pace in PACES.values():
            self.pace = pace

    def restart(self) -> None:
        """Put the robots to the start."""
        # First: a log must not go on behind the jump to the start.
        self._attempt(self._write)
        self.simulation.reset()
        self._forget()

    def show_world(self, engine: str, terrain: str) -> None:
        """Put the robots into another world."""
        # First: the robot that is recorded is about to be replaced.
        self._attempt(self._write)
        self.simulation.set_world(replace(self.simulation.cfg, engine=engine, course=parse_course(terrain)))
        self._forget()
        self.scene.rebuild()

    def _forget(self) -> None:
        """Forget the plots and the clip, after a jump to the start."""
        self.history.clear()
        self._clips.clear()

    def teach(self, number: int, policy: ViewedPolicy) -> None:
        """Replace a robot's policy while it walks."""
        self.simulation.walkers[number].teach(policy)

    def refresh(self, robot: int) -> None:
        """Give a robot the newest checkpoint of its run before the next control step; called in any thread."""
        self.submit(lambda: self.teach(robot, viewed(self._runs[robot])))

    def choose_checkpoint(self, robot: int, name: str) -> None:
        """Replace a robot's policy by a checkpoint of its run."""
        self._runs[robot].choose(name)
        self.teach(robot, viewed(self._runs[robot]))

    def show_joint(self, name: str) -> None:
        """Plot the torque of another joint."""
        if name in self.simulation.spec.joint_names:
            self.history.show_joint(name)

    def follow(self, robots: tuple[int, ...]) -> None:
        """Let the camera follow some robots; none: it stands still."""
        self.scene.followed = robots

    def show_forces(self, shown: bool) -> None:
        """Draw contact forces or not."""
        self.scene.shows_forces = shown
        if shown and not all(walker.senses_contacts for walker in self.simulation.walkers):
            self.panel.say("Contact forces", "this engine reports none; choose mujoco or physx")

    def set_dark(self, dark: bool) -> None:
        """Draw dark or light."""
        self._show_theme(dark)
        self.scene.dark = dark
        self.scene.rebuild()
        self.plots.rebuild(dark)

    def _show_theme(self, dark: bool) -> None:
        """Draw the page around the scene dark or light."""
        self.server.gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False, control_width="large")

    def toggle_recording(self, robot: int, client: viser.ClientHandle | None = None) -> None:
        """Start to record a robot, or write the recording and send it to a browser."""
        self._receiver = client
        if self._recorder is not None:
            self._write()
            return
        self._recorded = self.simulation.walkers[robot]
        self._recorder = Recorder(self._recorded.policy.contract)

    def _record(self) -> None:
        """Record the last step; a fall ends it."""
        if self._recorder is None or self._recorded is None:
            return
        step = self._recorded.seen.step
        if step is None or self._recorder.full:
            self._attempt(self._write)
        else:
            self._recorder.add(step)

    def _write(self) -> None:
        """Write the recording, say where, and send it to the browser that asked for it."""
        recorder, self._recorder = self._recorder, None
        if recorder is not None:
            path = write_recording(self._out, recorder.log())
            self.panel.say("Recorded", f"{path}: {recorder.seconds:.1f} s; read it with `stiction identify`")
            for file in (path, path.with_suffix(".json")):
                self._send(file.name, file.read_bytes(), self._receiver)

    def _send(self, name: str, content: bytes, client: viser.ClientHandle | None) -> None:
        """Let a browser download a file, None: all of them."""
        for each in self.server.get_clients().values() if client is None else (client,):
            each.send_file_download(name, content, save_immediately=True)

    def make_clip(self, seconds: float, client: viser.ClientHandle | None = None) -> None:
        """Draw a clip of the last seconds and send it to a browser, None: to all; the robots walk on meanwhile."""
        if self._drawing is not None and self._drawing.is_alive():
            self.panel.say("Clip", "one clip is being drawn; wait for it")
            return
        shot = self._clips.shot(seconds, self.scene.width)
        self.panel.say("Clip", f"drawing the last {shot.seconds:.1f} s")

        def draw() -> None:
            try:
                content = render_shot(shot, self.simulation.spec)
            except StictionError as error:
                words = str(error)
                self.submit(lambda: self.panel.say("Clip", words))
                return
            self.submit(lambda: self._send("stiction-clip.webp", content, client))

        self._drawing = threading.Thread(target=draw, name="clip", daemon=True)
        self._drawing.start()

    def close(self) -> None:
        """Write the recording, if any."""
        if self._recorder is not None and self._recorder.seconds > 0:
            self._write()
