"""One simulation, shown to any number of browsers: a loop that keeps time, and what browsers ask it to do."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import viser

from stiction.core.errors import LogError, StictionError
from stiction.deploy.control import ControlStep, Reading
from stiction.evaluation.course import parse_course
from stiction.files.contract import Contract
from stiction.files.log import JointSignals, Log, LogSetup, write_log
from stiction.view.history import History
from stiction.view.panel import Panel
from stiction.view.plots import Plots
from stiction.view.scene import Scene
from stiction.view.simulation import Simulation, ViewedPolicy, Walker

LATE = 0.1
"""A loop that is later than this gives real time up: its robots walk in slow motion [s]."""

SLOWEST = 1.0 / 30.0
"""Longest time between two frames of a loop that is late [s]."""

PLOTS_EVERY, STATUS_EVERY = 0.25, 0.5
"""Time between two updates of the plots and of the status [s]."""

PLOTS_WIDTH = 340
"""Of the window of the plots [pixels]."""

IDLE = 0.1
"""Time between two looks for a browser while there is none [s]."""

MOST_ASKED = 1000
"""What browsers asked for and was not done yet is kept up to so many; what comes beyond is dropped."""


LONGEST = 300.0
"""Longest recording [s]; it ends there by itself."""


class Viewer:
    """The session of a server: simulation, scene, panel, plots, recording."""

    def __init__(self, server: viser.ViserServer, simulation: Simulation, out: Path, dark: bool = False) -> None:
        """Show a simulation; out: folder of recordings."""
        self.server, self.simulation, self._out = server, simulation, out
        self._asked: queue.Queue[Callable[[], None]] = queue.Queue(MOST_ASKED)
        self.scene = Scene(server, simulation, dark)
        self.history = History(simulation)
        self.panel = Panel(server, self, dark)
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
        self.paused, self.factor = False, 1.0
        self._recorder: Recorder | None = None
        self._recorded: Walker | None = None
        self._due = {"plots": 0.0, "status": 0.0}
        self._show_theme(dark)

    def submit(self, action: Callable[[], None]) -> None:
        """Do something before the next control step; a `StictionError` of it is shown to everybody."""
        try:
            self._asked.put_nowait(action)
        except queue.Full:
            return

    def turn(self) -> None:
        """Do what was asked for, and take one control step unless time stands still."""
        self._answer()
        if self.paused:
            return
        self.simulation.step()
        self.history.add()
        self._record()

    def _answer(self) -> None:
        """Do what browsers asked for."""
        # So many and no more: browsers that ask without end must not hold up the step.
        for _ in range(MOST_ASKED):
            try:
                action = self._asked.get_nowait()
            except queue.Empty:
                return
            self._attempt(action)

    def _attempt(self, action: Callable[[], None]) -> None:
        """Do something; what cannot be done is said to everybody."""
        try:
            action()
        except StictionError as error:
            self.panel.say("That cannot be done", " ".join(str(error).split()))
            # A choice that could not be made is still shown in the browsers: it is put back.
            self.panel.show_world()

    def show(self, now: float, draw: bool = True) -> None:
        """Bring browsers up to date; now: a monotonic clock's time [s]; draw: the robots too."""
        if draw:
            self.scene.draw()
        if now >= self._due["plots"]:
            self._due["plots"] = now + PLOTS_EVERY
            self.plots.update()
        if now >= self._due["status"]:
            self._due["status"] = now + STATUS_EVERY
            recorded = None if self._recorder is None else self._recorder.seconds
            pace = "paused" if self.paused else f"{self.factor:.2f} × real time"
            self.panel.show_status(pace, self.history.speeds(), recorded)

    def run(self, ended: Callable[[], bool] = lambda: False, always: bool = False) -> None:
        """Keep time until `ended`. While no browser looks, time stands still unless `always`."""
        period = self.simulation.period
        due = began = time.monotonic()
        simulated, drawn = self.simulation.time, 0.0
        while not ended():
            if not always and not self.server.get_clients():
                self._answer()
                time.sleep(IDLE)
                # Time in which nobody looked is not caught up.
                due = began = time.monotonic()
                simulated = self.simulation.time
                continue
            self.turn()
            due += period
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
        """Stop the time, or let it go on."""
        self.paused = not self.paused

    def restart(self) -> None:
        """Put the robots to the start."""
        # First: a log must not go on behind the jump to the start.
        self._attempt(self._write)
        self.simulation.reset()
        self.history.clear()

    def show_world(self, engine: str, terrain: str) -> None:
        """Put the robots into another world."""
        # First: the robot that is recorded is about to be replaced.
        self._attempt(self._write)
        self.simulation.set_world(replace(self.simulation.cfg, engine=engine, course=parse_course(terrain)))
        self.history.clear()
        self.scene.rebuild()

    def teach(self, number: int, policy: ViewedPolicy) -> None:
        """Give a robot a newer policy, as it walks."""
        self.simulation.walkers[number].teach(policy)

    def show_joint(self, name: str) -> None:
        """Plot the torque of another joint."""
        if name in self.simulation.spec.joint_names:
            self.history.show_joint(name)

    def follow(self, robots: tuple[int, ...]) -> None:
        """Keep the middle of some robots in the middle of the picture; of none: stand still."""
        self.scene.followed = robots

    def set_dark(self, dark: bool) -> None:
        """Draw dark or light."""
        self._show_theme(dark)
        self.scene.dark = dark
        self.scene.rebuild()
        self.plots.rebuild(dark)

    def _show_theme(self, dark: bool) -> None:
        """Draw what is around the scene dark or light."""
        self.server.gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False, control_width="large")

    def toggle_recording(self, robot: int) -> None:
        """Begin to record a robot, or write what was recorded."""
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
        """Write what was recorded, and say where."""
        recorder, self._recorder = self._recorder, None
        if recorder is not None:
            path = write_recording(self._out, recorder.log())
            self.panel.say("Recorded", f"{path}: {recorder.seconds:.1f} s; read it with `stiction identify`")

    def close(self) -> None:
        """Write what is being recorded."""
        if self._recorder is not None and self._recorder.seconds > 0:
            self._write()


class Recorder:
    """A recording under way."""

    def __init__(self, contract: Contract) -> None:
        """Begin; contract: of the policy on the robot."""
        self._contract = contract
        self._readings: list[Reading] = []
        self._targets: list[np.ndarray] = []

    @property
    def seconds(self) -> float:
        """How much is recorded [s]."""
        return self._readings[-1].time - self._readings[0].time if self._readings else 0.0

    @property
    def full(self) -> bool:
        """Whether it is as long as it may be."""
        return self.seconds >= LONGEST

    def add(self, step: ControlStep) -> None:
        """Add the readings of a control step."""
        self._readings.extend(step.readings)
        self._targets.extend([step.policy.target] * len(step.readings))

    def log(self) -> Log:
        """Return the log. Raises `LogError` where nothing was recorded."""
        if not self._readings:
            raise LogError("nothing was recorded; let the robot walk before the recording ends")
        contract, readings = self._contract, self._readings
        signals = {
            "position": np.array([reading.sensors.joint_position for reading in readings]),
            "velocity": np.array([reading.sensors.joint_velocity for reading in readings]),
            "target": np.array(self._targets),
            "torque": np.array([reading.joint_torque for reading in readings]),
        }
        time = np.array([reading.time for reading in readings])
        joints = {
            name: JointSignals(**{signal: values[:, number] for signal, values in signals.items()})
            for number, name in enumerate(contract.joint_names)
        }
        own = {
            name: LogSetup(kp=kp, kd=kd, torque_limit=limit)
            for name, kp, kd, limit in zip(
                contract.joint_names, contract.kp, contract.kd, contract.torque_limit, strict=True
            )
        }
        setup = LogSetup(torque_source="motor_side", test_condition="loaded", joints=own)
        return Log("the viewer", time - time[0], joints, setup)


def write_recording(folder: Path, log: Log) -> Path:
    """Write a log as NPZ, and its sidecar, under the first free name in a folder; return its path."""
    number = 1
    while (path := folder / f"walk-{number}.npz").exists() or path.with_suffix(".json").exists():
        number += 1
    write_log(path, log)
    return path
