"""The control panel: changes in one browser show in all, and act before the next control step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from html import escape
from typing import Any, Protocol

import viser

from stiction.engines.catalog import ENGINES
from stiction.joints.friction import MAX_LEVEL, has_coefficient
from stiction.view.clip import LONGEST_CLIP
from stiction.view.page import page_parts
from stiction.view.scene import colors
from stiction.view.simulation import MAX_WEAR, WALKING, Run, Simulation, finite

TERRAINS = ("flat", "stairs=0.05", "stairs=0.1", "slope=0.2", "rough=0.05")
"""Grounds to choose from, in addition to the one of the command line."""

AXES = ("Forward, m/s", "Left, m/s", "Turn, rad/s")
"""Labels of the command."""

COMMAND_STEP, FRICTION_STEP, COEFFICIENT_STEP = 0.1, 5.0, 0.01
"""Steps of the sliders per key press [m/s and rad/s; % of the torque limit; 1]."""

MOST_COEFFICIENT = 0.3
"""Upper end of the friction sliders of laws with a coefficient [1]."""

PRESETS, COEFFICIENTS = ("0", "5", "10", "15", "20"), ("0", "0.05", "0.1", "0.15", "0.2")
"""Friction presets [% of the torque limit], and of laws with a coefficient [1]."""

PACES = {"¼ ×": 0.25, "½ ×": 0.5, "1 ×": 1.0, "2 ×": 2.0, "4 ×": 4.0}
"""Speeds of the simulation, as multiples of real time."""

EVERYBODY, NOBODY = "everybody", "nobody"
"""Choices of a camera that follows all robots, and of one that stands still."""

KEYS = """\
**I K** faster, slower · **J L** turn left, right · **U O** go left, right · **X** stand\\
**G** more friction, **Shift G** less · **M** more wear, **Shift M** less\\
**P** push · **R** restart · **Space** pause · **N** single step · **C** record · **V** clip\\
Mouse: turn, move, zoom. Keys act while the pointer is over the scene and not in a field."""


class Session(Protocol):
    """Interface of the viewer to its panel, run in the viewer's thread before the next control step."""

    simulation: Simulation

    def submit(self, action: Callable[[], None]) -> None:
        """Run an action before the next control step; its `StictionError` is shown in all browsers."""

    def toggle_pause(self) -> None:
        """Pause or continue."""

    def step_once(self) -> None:
        """Pause, and take one control step."""

    def set_pace(self, pace: float) -> None:
        """Set the speed of the simulation, as a multiple of real time."""

    def toggle_recording(self, robot: int, client: viser.ClientHandle | None) -> None:
        """Start to record a robot, or write the recording and send it to a browser."""

    def make_clip(self, seconds: float, client: viser.ClientHandle | None) -> None:
        """Draw a clip of the last seconds and send it to a browser, None: to all."""

    def choose_checkpoint(self, robot: int, name: str) -> None:
        """Replace a robot's policy by a checkpoint of its run."""

    def show_world(self, engine: str, terrain: str) -> None:
        """Put the robots into another world."""

    def restart(self) -> None:
        """Put the robots to the start."""

    def follow(self, robots: tuple[int, ...]) -> None:
        """Let the camera follow some robots; none: it stands still."""

    def show_forces(self, shown: bool) -> None:
        """Draw contact forces or not."""

    def set_dark(self, dark: bool) -> None:
        """Draw dark or light."""


class Panel:
    """The controls of one viewer; values from browsers are untrusted."""

    def __init__(
        self,
        server: viser.ViserServer,
        viewer: Session,
        dark: bool = False,
        runs: Mapping[int, Run] | None = None,
    ) -> None:
        """Add the controls; runs: by number of the robot."""
        self._server, self._viewer, self._simulation = server, viewer, viewer.simulation
        self._runs = runs or {}
        self._gui = gui = server.gui
        self.names = [walker.policy.short for walker in self._simulation.walkers]
        self._colors = colors(len(self.names))
        gui.add_html(page_parts())
        self.status = gui.add_html("")
        self.pace = self._group("Speed", tuple(PACES), lambda word, _: viewer.set_pace(PACES[word]))
        self.time = self._group("Time", ("Pause", "Step", "Restart"), self._change_time)
        self._add_friction()
        with gui.add_folder("Command"):
            self.command = [self._command(axis) for axis in range(3)]
            self.motion = self._group("Robots", ("Walk", "Stand", "Push"), self._change_motion)
            self.gamepad = gui.add_checkbox(
                "Gamepad steers", False, visible=False, hint="Left stick walks, right turns"
            )
        self._add_checkpoints()
        self._add_recordings()
        with gui.add_folder("World", expand_by_default=False):
            self._add_world(dark)
        with gui.add_folder("Keys", expand_by_default=False):
            gui.add_markdown(KEYS)
        self._add_keys()

    def _command(self, axis: int) -> viser.GuiSliderHandle[float]:
        low, high = self._simulation.range[:, axis].tolist()
        value = float(self._simulation.velocity[axis])
        slider = self._gui.add_slider(
            AXES[axis], low, max(high, low + 0.05), 0.05, value, disabled=high <= low, hint="Range of the training"
        )
        slider.on_update(lambda _: self.submit(self._set_velocity))
        return slider

    def _add_friction(self) -> None:
        """Add presets, a slider for all joints and one for each kind, and wear."""
        simulation, gui = self._simulation, self._gui
        law = simulation.cfg.law.name
        self._share = not has_coefficient(law)
        end, step = (100.0 * MAX_LEVEL, 1.0) if self._share else (MOST_COEFFICIENT, 0.002)
        scale, unit = (100.0, ", %") if self._share else (1.0, "")
        with gui.add_folder(f"Dry friction of the joints ({law})"):
            words = PRESETS if self._share else COEFFICIENTS
            self.presets = self._group(f"Preset{unit}", words, lambda word, _: self._preset(word))
            same = set(simulation.levels.values())
            value = scale * same.pop() if len(same) == 1 else 0.0
            self.all = gui.add_slider(f"All joints{unit}", 0.0, end, step, value, hint="Moves all kinds at once")
            self.all.on_update(lambda _: self.submit(self._spread))
            self.levels: dict[str, viser.GuiSliderHandle[float]] = {}
            with gui.add_folder("By kind of joint, and wear", expand_by_default=False):
                for kind in simulation.kinds:
                    limit = next(joint.torque_limit for joint in simulation.spec.joints if joint.kind == kind)
                    hint = f"Share of its torque limit, {limit:g} N m" if self._share else "Coefficient of the law"
                    value = scale * simulation.levels[kind]
                    slider = gui.add_slider(f"{kind}{unit}", 0.0, end, step, value, hint=hint)
                    slider.on_update(lambda _, kind=kind: self._set_level(kind))
                    self.levels[kind] = slider
                hint = "0.3: seals taken out; above 1: worn in badly"
                self.wear = gui.add_slider("Wear ×", 0.3, MAX_WEAR, 0.1, simulation.wear, hint=hint)
                self.wear.on_update(lambda _: self._number(self.wear, simulation.set_wear))
                self.wear.visible = self._share

    def _add_checkpoints(self) -> None:
        """Add a choice of checkpoint for each training run."""
        self.checkpoints: dict[int, viser.GuiDropdownHandle[str]] = {}
        for robot, run in self._runs.items():
            label = "Checkpoint" if len(self._runs) == 1 else f"Checkpoint of {self.names[robot]}"
            choice = self._gui.add_dropdown(label, run.checkpoints, initial_value=run.chosen)
            choice.on_update(lambda _, robot=robot: self._choose_checkpoint(robot))
            self.checkpoints[robot] = choice

    def _add_recordings(self) -> None:
        """Add logs and clips."""
        gui = self._gui
        with gui.add_folder("Record", expand_by_default=False):
            self.recorded = gui.add_dropdown("Robot", self.names, initial_value=self.names[0])
            self.record = gui.add_button("Record a log", icon=viser.Icon.PLAYER_RECORD, hint="A canonical log, NPZ")
            self.record.on_click(lambda event: self.toggle_recording(event.client))
            self.length = gui.add_slider("Clip, last s", 1.0, LONGEST_CLIP, 1.0, 5.0)
            self.clip = gui.add_button("Clip", icon=viser.Icon.MOVIE, hint="WebP of all robots, downloaded")
            self.clip.on_click(lambda event: self.make_clip(event.client))

    def _add_world(self, dark: bool) -> None:
        """Add engine, ground, push, camera, contact forces, colours."""
        gui, cfg = self._gui, self._simulation.cfg
        engines = tuple(dict.fromkeys((*ENGINES, cfg.engine)))
        self.engine = gui.add_dropdown("Engine", engines, initial_value=cfg.engine)
        terrains = tuple(dict.fromkeys((*TERRAINS, cfg.course.label)))
        hint = "Height of a step [m], angle [rad], highest slab [m]"
        self.terrain = gui.add_dropdown("Ground", terrains, initial_value=cfg.course.label, hint=hint)
        for choice in (self.engine, self.terrain):
            choice.on_update(lambda _: self._choose_world())
        self.strength = gui.add_slider("Push, m/s", 0.1, 2.0, 0.1, 0.5)
        self.camera = gui.add_dropdown("Camera follows", (EVERYBODY, *self.names, NOBODY), initial_value=EVERYBODY)
        self.camera.on_update(lambda _: self._follow())
        self.straight = gui.add_checkbox("Hold straight on", True, hint="Corrects the turn, unless a turn is commanded")
        hold = partial(setattr, self._simulation, "straight")
        self.straight.on_update(lambda _: self.submit(lambda: hold(bool(self.straight.value))))
        self.forces = gui.add_checkbox("Contact forces", False, hint="In MuJoCo and PhysX; 100 N are 0.4 m long")
        self.forces.on_update(lambda _: self.submit(lambda: self._viewer.show_forces(bool(self.forces.value))))
        self.dark = gui.add_checkbox("Dark", dark)
        self.dark.on_update(lambda _: self.submit(lambda: self._viewer.set_dark(bool(self.dark.value))))

    def _add_keys(self) -> None:
        """Bind the keys."""
        for key, modifier, label, action in (
            ("I", None, "Faster", lambda: self.nudge(0, 1)),
            ("K", None, "Slower", lambda: self.nudge(0, -1)),
            ("U", None, "More to the left", lambda: self.nudge(1, 1)),
            ("O", None, "More to the right", lambda: self.nudge(1, -1)),
            ("J", None, "Turn more to the left", lambda: self.nudge(2, 1)),
            ("L", None, "Turn more to the right", lambda: self.nudge(2, -1)),
            ("X", None, "Stand", lambda: self.walk(0.0)),
            ("G", None, "More friction", lambda: self.rub(1)),
            ("G", "shift", "Less friction", lambda: self.rub(-1)),
            ("M", None, "More wear", lambda: self._move(self.wear, 0.1)),
            ("M", "shift", "Less wear", lambda: self._move(self.wear, -0.1)),
            ("P", None, "Push to the left", self.push),
            ("R", None, "Restart", self._viewer.restart),
            ("space", None, "Pause", self._viewer.toggle_pause),
            ("N", None, "Single step", self._viewer.step_once),
            ("C", None, "Record", self.toggle_recording),
            ("V", None, "Clip", self.make_clip),
        ):
            command = self._gui.add_command(label, hotkey=key, modifier=modifier)
            command.on_trigger(lambda _, action=action: self.submit(action))

    def nudge(self, axis: int, direction: int) -> None:
        """Move the command along one axis by one step."""
        self._move(self.command[axis], direction * COMMAND_STEP)

    def rub(self, direction: int) -> None:
        """Move the friction of all joints by one step."""
        self._move(self.all, direction * (FRICTION_STEP if self._share else COEFFICIENT_STEP))

    def walk(self, speed: float) -> None:
        """Command the robots to walk straight forward [m/s]; 0: to stand."""
        for slider, value in zip(self.command, (speed, 0.0, 0.0), strict=True):
            slider.value = min(max(value, slider.min), slider.max)

    def steer(self, axes: Sequence[float]) -> None:
        """Show that there is a gamepad, and if it steers, command what its axes say: forward, left, turn, -1 to 1."""
        self.gamepad.visible = bool(axes)
        if axes and self.gamepad.value is True:
            for slider, axis in zip(self.command, axes, strict=True):
                if not slider.disabled:
                    slider.value = round(axis * (slider.max if axis > 0 else -slider.min), 2)

    def push(self) -> None:
        """Push the robots to the left."""
        self._simulation.push((0.0, number_of(self.strength)))

    def toggle_recording(self, client: viser.ClientHandle | None = None) -> None:
        """Start to record the chosen robot, or write the recording and send it to a browser."""
        if self.recorded.value in self.names:
            robot = self.names.index(self.recorded.value)
            self.submit(lambda: self._viewer.toggle_recording(robot, client))

    def make_clip(self, client: viser.ClientHandle | None = None) -> None:
        """Send a clip of the last seconds to a browser."""
        self.submit(lambda: self._viewer.make_clip(number_of(self.length), client))

    def submit(self, action: Callable[[], None]) -> None:
        """Run an action before the next control step."""
        self._viewer.submit(action)

    def say(self, title: str, text: str) -> None:
        """Show a notification in all browsers."""
        for client in self._server.get_clients().values():
            client.add_notification(title, text, auto_close_seconds=8.0)

    def show_status(self, pace: str, speeds: Sequence[float], recording: float | None) -> None:
        """Show time, speeds and falls.

        pace: in words; speeds: commanded, then of each robot; recording: length so far [s], None: none.
        """
        simulation = self._simulation
        unit = "rad/s" if simulation.velocity[2] and not any(simulation.velocity[:2]) else "m/s"
        head = f"<b>{simulation.time:.1f} s</b>, {escape(pace)}; commanded {speeds[0]:.2f} {unit}"
        rows = []
        for walker, speed, color in zip(simulation.walkers, speeds[1:], self._colors, strict=True):
            fallen = f", fell {walker.falls} times" if walker.falls > 1 else ", fell once" if walker.falls else ""
            short, _, words = walker.policy.name.partition(":")
            square = f'<span style="color:rgb{color}">■</span>'
            speed_text = f"{round(speed, 2) + 0.0:.2f} {unit}"
            rows.append(f"{square} <b>{escape(short)}</b> {speed_text}{fallen} <small>{escape(words)}</small>")
        if recording is not None:
            rows.append(f"recording, {recording:.0f} s")
        text = f'<div style="padding:0 0.8em 0.5em;font-size:0.85em">{"<br>".join([head, *rows])}</div>'
        if self.status.content != text:
            self.status.content = text
        label = "Stop and write" if recording is not None else "Record a log"
        if self.record.label != label:
            self.record.label = label
        for robot, choice in self.checkpoints.items():
            if choice.options != (names := self._runs[robot].checkpoints):
                choice.options = names

    def show_choices(self) -> None:
        """Show the world and the checkpoints that there are, after a choice that failed."""
        cfg = self._simulation.cfg
        self.engine.value, self.terrain.value = cfg.engine, cfg.course.label
        for robot, choice in self.checkpoints.items():
            choice.value = self._runs[robot].chosen

    def _group(
        self, label: str, words: tuple[str, ...], action: Callable[[str, viser.ClientHandle | None], None]
    ) -> viser.GuiButtonGroupHandle[str]:
        """Add a row of buttons; the action gets the word of the pressed one."""
        group = self._gui.add_button_group(label, words)

        def press(event: Any) -> None:
            # Called in a thread of the server; the action waits until the loop has finished a control step.
            word = str(event.target.value)
            if word in words:
                self.submit(lambda: action(word, event.client))

        group.on_click(press)
        return group

    def _change_time(self, word: str, _: Any) -> None:
        session = self._viewer
        {"Pause": session.toggle_pause, "Step": session.step_once, "Restart": session.restart}[word]()

    def _change_motion(self, word: str, _: Any) -> None:
        if word == "Push":
            self.push()
        else:
            self.walk(WALKING if word == "Walk" else 0.0)

    def _preset(self, word: str) -> None:
        """Set the friction of all joints to a preset, also if the slider of all joints is there already."""
        self.all.value = float(word)
        self._spread()

    def _set_velocity(self) -> None:
        self._simulation.set_velocity([number_of(slider) for slider in self.command])

    def _set_level(self, kind: str) -> None:
        scale = 0.01 if self._share else 1.0
        self._number(self.levels[kind], lambda value: self._simulation.set_level(kind, scale * value))

    def _spread(self) -> None:
        """Set all kinds of joints to the slider of all joints."""
        value = number_of(self.all)
        # To set a slider from here calls its `on_update`, as a browser does.
        for slider in self.levels.values():
            slider.value = value

    def _number(self, slider: viser.GuiSliderHandle[float], use: Callable[[float], None]) -> None:
        self.submit(lambda: use(number_of(slider)))

    def _move(self, slider: viser.GuiSliderHandle[float], step: float) -> None:
        """Move a slider by a step, within its ends."""
        if not slider.disabled:
            slider.value = round(min(max(number_of(slider) + step, slider.min), slider.max), 6)

    def _choose_checkpoint(self, robot: int) -> None:
        name = str(self.checkpoints[robot].value)
        if name != self._runs[robot].chosen:
            self.submit(lambda: self._viewer.choose_checkpoint(robot, name))

    def _choose_world(self) -> None:
        engine, terrain = self.engine.value, self.terrain.value
        cfg = self._simulation.cfg
        if (engine, terrain) != (cfg.engine, cfg.course.label):
            self.submit(lambda: self._viewer.show_world(str(engine), str(terrain)))

    def _follow(self) -> None:
        name = self.camera.value
        everybody = range(len(self.names))
        chosen = everybody if name == EVERYBODY else [n for n in everybody if self.names[n] == name]
        self.submit(lambda: self._viewer.follow(tuple(chosen)))


def number_of(slider: viser.GuiSliderHandle[float]) -> float:
    """Return the value of a slider, within its ends; raise `StictionError` if it is not a number."""
    return min(max(finite(slider.value), slider.min), slider.max)
