"""The controls: what is moved in one browser moves in all, and is done before the next control step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol

import viser

from stiction.engines.catalog import ENGINES
from stiction.joints.friction import MAX_LEVEL, has_coefficient
from stiction.view.history import belief_text
from stiction.view.simulation import MAX_WEAR, Simulation, finite

TERRAINS = ("flat", "stairs=0.05", "stairs=0.1", "slope=0.2", "rough=0.05")
"""Grounds to choose from, beside the one that was asked for."""

AXES = ("Forward, m/s", "Left, m/s", "Turn, rad/s")
"""Labels of the command."""

COMMAND_STEP, FRICTION_STEP, COEFFICIENT_STEP = 0.1, 5.0, 0.01
"""By which a key moves a slider [m/s and rad/s; % of the torque limit; 1]."""

MOST_COEFFICIENT = 0.3
"""End of the friction sliders of laws with a coefficient [1]."""

EVERYBODY, NOBODY = "everybody", "nobody"
"""Words for a camera that follows the middle of all robots, and for one that stands still."""

KEYS = """\
**I K** faster, slower · **J L** turn left, right · **U O** go left, right · **X** stand\\
**G** more friction, **Shift G** less · **M** more wear, **Shift M** less\\
**P** push · **R** back to the start · **Space** pause · **C** record\\
Mouse: turn, move, zoom. Keys act while the pointer is over the scene and not in a field."""


class Session(Protocol):
    """What the panel needs of the viewer, which imports it; all runs before the next control step, in its thread."""

    simulation: Simulation

    def submit(self, action: Callable[[], None]) -> None:
        """Do something before the next control step; a `StictionError` of it is shown to everybody."""

    def toggle_pause(self) -> None:
        """Stop the time, or let it go on."""

    def toggle_recording(self, robot: int) -> None:
        """Begin to record a robot, or write what was recorded."""

    def show_world(self, engine: str, terrain: str) -> None:
        """Put the robots into another world."""

    def restart(self) -> None:
        """Put the robots to the start."""

    def follow(self, robots: tuple[int, ...]) -> None:
        """Keep the middle of some robots in the middle of the picture; of none: stand still."""

    def set_dark(self, dark: bool) -> None:
        """Draw dark or light."""


class Panel:
    """The controls of one viewer; values of browsers are taken for what they are: words of strangers."""

    def __init__(self, server: viser.ViserServer, viewer: Session, dark: bool = False) -> None:
        """Make the controls, showing what the simulation has; what they do is done by `viewer.submit`."""
        self._server, self._viewer, self._simulation = server, viewer, viewer.simulation
        self._gui = gui = server.gui
        self.names = [walker.policy.name for walker in self._simulation.walkers]
        self.status = gui.add_markdown("")
        with gui.add_folder("Command"):
            self.command = [self._command(axis) for axis in range(3)]
            self._button("Stand", self.stand, viser.Icon.HAND_STOP)
        self._add_friction()
        with gui.add_folder("World"):
            self._add_world(dark)
        with gui.add_folder("Record", expand_by_default=False):
            self.recorded = gui.add_dropdown("Robot", self.names, initial_value=self.names[0])
            self.record = gui.add_button("Record", icon=viser.Icon.PLAYER_RECORD, hint="A canonical log, NPZ")
            self.record.on_click(lambda _: self.toggle_recording())
        with gui.add_folder("Keys", expand_by_default=False):
            gui.add_markdown(KEYS)
        self._add_keys()

    def _command(self, axis: int) -> viser.GuiSliderHandle[float]:
        low, high = self._simulation.range[:, axis].tolist()
        value = float(self._simulation.velocity[axis])
        slider = self._gui.add_slider(
            AXES[axis],
            low,
            max(high, low + 0.05),
            0.05,
            value,
            disabled=high <= low,
            hint="What the policies trained for",
        )
        slider.on_update(lambda _: self.submit(self._set_velocity))
        return slider

    def _add_friction(self) -> None:
        """Add a slider for each kind of joint, one for all of them, and wear."""
        simulation = self._simulation
        law = simulation.cfg.law.name
        self._share = not has_coefficient(law)
        end, step = (100.0 * MAX_LEVEL, 1.0) if self._share else (MOST_COEFFICIENT, 0.002)
        scale = 100.0 if self._share else 1.0
        with self._gui.add_folder(f"Dry friction of the joints ({law})"):
            unit = ", %" if self._share else ""
            same = set(simulation.levels.values())
            value = scale * same.pop() if len(same) == 1 else 0.0
            self.all = self._gui.add_slider(f"All joints{unit}", 0.0, end, step, value, hint="Moves all kinds at once")
            self.all.on_update(lambda _: self.submit(self._spread))
            self.levels: dict[str, viser.GuiSliderHandle[float]] = {}
            for kind in simulation.kinds:
                limit = next(joint.torque_limit for joint in simulation.spec.joints if joint.kind == kind)
                hint = f"Of its torque limit, {limit:g} N m" if self._share else "Coefficient of the law"
                slider = self._gui.add_slider(
                    f"{kind}{unit}", 0.0, end, step, scale * simulation.levels[kind], hint=hint
                )
                slider.on_update(lambda _, kind=kind: self._set_level(kind))
                self.levels[kind] = slider
            self.wear = self._gui.add_slider(
                "Wear ×", 0.3, MAX_WEAR, 0.1, simulation.wear, hint="0.3: seals taken out; above 1: worn in badly"
            )
            self.wear.on_update(lambda _: self._number(self.wear, simulation.set_wear))
            self.wear.visible = self._share
            self.beliefs = self._gui.add_markdown("")

    def _add_world(self, dark: bool) -> None:
        """Add engine, ground, pushes, start, pause, camera, colours."""
        gui, cfg = self._gui, self._simulation.cfg
        engines = tuple(dict.fromkeys((*ENGINES, cfg.engine)))
        self.engine = gui.add_dropdown("Engine", engines, initial_value=cfg.engine)
        terrains = tuple(dict.fromkeys((*TERRAINS, cfg.course.label)))
        hint = "Height of a step [m], angle [rad], highest slab [m]"
        self.terrain = gui.add_dropdown("Ground", terrains, initial_value=cfg.course.label, hint=hint)
        for choice in (self.engine, self.terrain):
            choice.on_update(lambda _: self._choose_world())
        self.strength = gui.add_slider("Push, m/s", 0.1, 2.0, 0.1, 0.5)
        self._button("Push to the left", self.push, viser.Icon.ARROW_BIG_LEFT)
        self._button("Back to the start", self._viewer.restart, viser.Icon.REFRESH)
        self._button("Pause", self._viewer.toggle_pause, viser.Icon.PLAYER_PAUSE)
        self.camera = gui.add_dropdown("Camera follows", (EVERYBODY, *self.names, NOBODY), initial_value=EVERYBODY)
        self.camera.on_update(lambda _: self._follow())
        self.straight = gui.add_checkbox("Hold straight on", True, hint="Corrects the turn, unless a turn is commanded")
        hold = partial(setattr, self._simulation, "straight")
        self.straight.on_update(lambda _: self.submit(lambda: hold(bool(self.straight.value))))
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
            ("X", None, "Stand", self.stand),
            ("G", None, "More friction", lambda: self.rub(1)),
            ("G", "shift", "Less friction", lambda: self.rub(-1)),
            ("M", None, "More wear", lambda: self._move(self.wear, 0.1)),
            ("M", "shift", "Less wear", lambda: self._move(self.wear, -0.1)),
            ("P", None, "Push to the left", self.push),
            ("R", None, "Back to the start", self._viewer.restart),
            ("space", None, "Pause", self._viewer.toggle_pause),
            ("C", None, "Record", self.toggle_recording),
        ):
            command = self._gui.add_command(label, hotkey=key, modifier=modifier)
            command.on_trigger(lambda _, action=action: self.submit(action))

    def nudge(self, axis: int, direction: int) -> None:
        """Move the command along one axis by one step of its key."""
        self._move(self.command[axis], direction * COMMAND_STEP)

    def rub(self, direction: int) -> None:
        """Move the friction of all joints by one step of its key."""
        self._move(self.all, direction * (FRICTION_STEP if self._share else COEFFICIENT_STEP))

    def stand(self) -> None:
        """Command the robots to stand still."""
        for slider in self.command:
            slider.value = min(max(0.0, slider.min), slider.max)

    def push(self) -> None:
        """Push the robots to the left."""
        strength = number_of(self.strength)
        self._simulation.push((0.0, strength))

    def toggle_recording(self) -> None:
        """Begin to record the chosen robot, or write what was recorded."""
        if self.recorded.value in self.names:
            self.submit(lambda: self._viewer.toggle_recording(self.names.index(self.recorded.value)))

    def submit(self, action: Callable[[], None]) -> None:
        """Do something before the next control step."""
        self._viewer.submit(action)

    def say(self, title: str, text: str) -> None:
        """Tell everybody something."""
        for client in self._server.get_clients().values():
            client.add_notification(title, text, auto_close_seconds=8.0)

    def show_status(self, pace: str, speeds: Sequence[float], recording: float | None) -> None:
        """Show time, speeds and what robots say of themselves.

        pace: in words; speeds: commanded, then of each robot; recording: how much is recorded [s], None: nothing is.
        """
        simulation = self._simulation
        unit = "rad/s" if simulation.velocity[2] and not any(simulation.velocity[:2]) else "m/s"
        rows = [f"**{simulation.time:.1f} s**, {pace}", f"commanded {speeds[0]:.2f} {unit}"]
        for walker, speed in zip(simulation.walkers, speeds[1:], strict=True):
            fallen = f", fell {walker.falls} times" if walker.falls > 1 else ", fell once" if walker.falls else ""
            rows.append(f"{walker.policy.short} {round(speed, 2) + 0.0:.2f} {unit}{fallen}")
        if recording is not None:
            rows.append(f"recording, {recording:.0f} s")
        self._show(self.status, "\\\n".join(rows))
        self._show(self.beliefs, belief_text(simulation.walkers))
        self.record.label = "Stop and write" if recording is not None else "Record"

    def show_world(self) -> None:
        """Show the world that there is, after one that there could not be."""
        cfg = self._simulation.cfg
        self.engine.value, self.terrain.value = cfg.engine, cfg.course.label

    @staticmethod
    def _show(handle: viser.GuiMarkdownHandle, text: str) -> None:
        if handle.content != text:
            handle.content = text

    def _button(self, label: str, action: Callable[[], None], icon: Any) -> viser.GuiButtonHandle:
        button = self._gui.add_button(label, icon=icon)
        # Called in a thread of the server: what it does waits until the loop has finished a control step.
        button.on_click(lambda _: self.submit(action))
        return button

    def _set_velocity(self) -> None:
        self._simulation.set_velocity([number_of(slider) for slider in self.command])

    def _set_level(self, kind: str) -> None:
        scale = 0.01 if self._share else 1.0
        self._number(self.levels[kind], lambda value: self._simulation.set_level(kind, scale * value))

    def _spread(self) -> None:
        """Give all kinds of joints what the slider of all says."""
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

    def _choose_world(self) -> None:
        engine, terrain = self.engine.value, self.terrain.value
        cfg = self._simulation.cfg
        if (engine, terrain) != (cfg.engine, cfg.course.label):
            self.submit(lambda: self._viewer.show_world(str(engine), str(terrain)))

    def _follow(self) -> None:
        name = self.camera.value
        chosen = range(len(self.names)) if name == EVERYBODY else [n for n, own in enumerate(self.names) if own == name]
        self.submit(lambda: self._viewer.follow(tuple(chosen)))


def number_of(slider: viser.GuiSliderHandle[float]) -> float:
    """Return what a slider says, within its ends; raise `StictionError` where that is no number."""
    return min(max(finite(slider.value), slider.min), slider.max)
