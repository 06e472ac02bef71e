"""Progress of a training run, on standard error: a live display on a terminal, lines in a file."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from statistics import mean

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.text import Text

from stiction.core.errors import escaped
from stiction.core.provenance import num_threads
from stiction.learning.config import TrainCfg
from stiction.report.terminal import Terminal
from stiction.robots.catalog import find_robot

RECENT = 20
"""Iterations whose times count."""

WAITING = 0.2
"""Share of the time that this process could compute for which it waits for a core, from which on it is told."""

SHORTEST = 5.0
"""Wall time from which on shares of the processor are told [s]: a wait is counted when it ends."""

Processor = tuple[float, float, float | None]
"""Wall time, processor time of this process, and time for which its threads waited for a core, None if unknown [s]."""


def processor_times(tasks: Path = Path("/proc/self/task")) -> Processor:
    """Return the times of this process; Linux alone counts the waiting (`schedstat`, in ns, of each thread)."""
    waited = None
    for file in tasks.glob("*/schedstat"):
        with suppress(OSError, IndexError, ValueError):  # a thread that ends in the meantime
            waited = (waited or 0.0) + 1e-9 * int(file.read_text().split()[1])
    return time.monotonic(), time.process_time(), waited


def busy_text(before: Processor, now: Processor, load: float, threads: int) -> str:
    """Return that other work takes the cores, empty where it does not: `machine busy: this process gets 0.6 of a core`.

    load: of the machine, over its cores; threads: most cores that the process uses. Where the waiting is not counted
    the machine is busy if its load is above 1 and the process, which computes all the time, gets less than one core.
    """
    wall, used = now[0] - before[0], now[1] - before[1]
    if wall < SHORTEST:
        return ""
    got, wanted = used / wall, 1.0
    if before[2] is not None and now[2] is not None:
        # Threads that have ended take their waiting along; those of this process may wait for each other too.
        wanted = min(got + max(0.0, now[2] - before[2]) / wall, threads)
    elif load <= 1.0:
        return ""
    if got >= (1 - WAITING) * wanted:
        return ""
    whole = "a core" if wanted < 1.1 else f"the {wanted:.1f} cores that it can use"
    return f"machine busy: this process gets {got:.1f} of {whole}"


class RunClock:
    """Measures both phases; before the student has begun, its rate is inferred from the teacher's."""

    def __init__(self, cfg: TrainCfg, times: Callable[[], Processor] = processor_times) -> None:
        """Begin without a measurement. `times`: of this process."""
        self.cfg, self.times = cfg, times
        self._processor: deque[Processor] = deque([times()], maxlen=RECENT + 1)
        self._seconds: dict[str, deque[tuple[float, float]]] = {
            phase: deque(maxlen=RECENT) for phase in ("teacher", "student")
        }

    def add(self, phase: str, figures: Mapping[str, float]) -> None:
        """Take an iteration's `rollout_seconds` and `seconds`."""
        rollout, whole = figures["rollout_seconds"], figures["seconds"]
        self._seconds[phase].append((rollout, whole - rollout))
        self._processor.append(self.times())

    def rate(self, phase: str) -> float:
        """Return the seconds of one iteration of a phase, as measured; else as follows from the teacher's.

        Rollouts take time by their steps, updates by the samples that they pass over; the teacher's supervised losses
        are one pass more.
        """
        times = self._seconds[phase]
        if times:
            return mean(rollout + update for rollout, update in times)
        teacher, student = self.cfg.teacher, self.cfg.student
        steps = student.steps / teacher.steps
        passes = steps * student.epochs / (teacher.epochs + 1)
        return mean(rollout * steps + update * passes for rollout, update in self._seconds["teacher"])

    def remaining(self, phase: str, iteration: int) -> float:
        """Return the seconds to the end of the whole run, after an iteration of a phase."""
        if phase == "student":
            return (self.cfg.student.iterations - iteration) * self.rate("student")
        teacher = (self.cfg.teacher.iterations - iteration) * self.rate("teacher")
        return teacher + self.cfg.student.iterations * self.rate("student")

    def left(self, phase: str, iteration: int) -> str:
        """Return the time left in words, and whether other work slows the training: on a GPU that says little."""
        busy = busy_text(
            self._processor[0], self._processor[-1], os.getloadavg()[0] / (os.cpu_count() or 1), num_threads()
        )
        left = f"{span(self.remaining(phase, iteration))} left"
        return f"{left} ({busy})" if busy and self.cfg.device != "cuda" else left


def span(seconds: float) -> str:
    """Return a time as a person says it: `45 s`, `12 min`, `3 h 05 min`."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


PLAIN_EVERY = 30.0
"""Time between lines where standard error is not a terminal [s]."""


def figures_line(cfg: TrainCfg, figures: Mapping[str, float], gait: str = "") -> str:
    """Return how the robots walk, in one line: what a person looks at first. gait: name of the robot's, if any."""
    words = [
        f"reward {figures['reward']:.4f}",
        f"error {figures['walk/tracking_error']:.3f} m/s",
        *([f"{gait} {figures['walk/tripod_share']:.0%}"] if gait else []),
        f"falls {figures['walk/falls']:.3f}/s",
    ]
    if "terrain/level" in figures:
        words.append(f"terrain level {figures['terrain/level']:.2f}")
    friction = cfg.task.friction
    if friction.draws_law:
        nominal, sign = (1.0, "×") if friction.level is None else (friction.level, "")
        low, high = figures["friction/low"] * nominal, figures["friction/high"] * nominal
        words.append(f"friction {sign}{low:.3g} to {sign}{high:.3g}")
        if len(friction.schedule) > 1:
            words[-1] += f" (stage {figures['friction/stage'] + 1:.0f} of {len(friction.schedule)})"
    return ", ".join(words)


class Display:
    """Shows the phases, or the one that there is, the time left of the whole run, and how the robots walk."""

    def __init__(
        self,
        cfg: TrainCfg,
        console: Console,
        clock: Callable[[], float] = time.monotonic,
        times: Callable[[], Processor] = processor_times,
    ) -> None:
        """Begin before the first iteration. `clock` [s]: of the lines in a file; `times`: of this process."""
        self.cfg, self.console, self.clock = cfg, console, clock
        self._run = RunClock(cfg, times)
        self._next_line, self._gait = clock(), find_robot(cfg.task.robot).gait
        self._note = Text("the first iteration runs ...")
        self.lines: tuple[str, ...] = (self._note.plain,)
        """State of the training for the live page: iterations and time left, then how the robots walk."""
        self._bars = Progress(TextColumn("{task.description:<8}"), BarColumn(), MofNCompleteColumn(), console=console)
        sizes = {"teacher": cfg.teacher.iterations, "student": cfg.student.iterations}
        sizes = {phase: total for phase, total in sizes.items() if total}
        self._tasks = {phase: self._bars.add_task(cfg.name_of(phase), total=total) for phase, total in sizes.items()}
        self._seen: set[str] = set()

    @property
    def view(self) -> Group:
        """Display on a terminal."""
        return Group(self._bars, self._note)

    def __call__(self, phase: str, iteration: int, iterations: int, figures: dict[str, float]) -> None:
        """Take one iteration."""
        self._run.add(phase, figures)
        left = self._run.left(phase, iteration)
        pace = f"{left}, {figures['env_steps_per_second']:,.0f} env-steps/s"
        walk = figures_line(self.cfg, figures, self._gait)
        if phase == "student":
            # A teacher that reached its target, or was trained before a resume, is done whatever its bar says.
            self._bars.update(self._tasks["teacher"], completed=self.cfg.teacher.iterations)
        self._bars.update(self._tasks[phase], completed=iteration)
        self._note.plain = f"{pace}\n{walk}"
        self.lines = (f"Running: {self.cfg.name_of(phase)} {iteration}/{iterations}, {pace}.", walk)
        begins, self._seen = phase not in self._seen, self._seen | {phase}
        if not self.console.is_terminal and (begins or iteration == iterations or self.clock() >= self._next_line):
            self._next_line = self.clock() + PLAIN_EVERY
            self.say(f"{self.cfg.name_of(phase)} {iteration}/{iterations}: {pace}, {walk}")

    def say(self, text: str) -> None:
        """Print a line; on a terminal, above the live display."""
        self.console.print(escaped(text), soft_wrap=True, highlight=False, markup=False)


@contextmanager
def training_progress(cfg: TrainCfg) -> Iterator[Display]:
    """Show a training run on standard error while it lasts."""
    console = Terminal(stderr=True)
    display = Display(cfg, console)
    if not console.is_terminal:
        yield display
        return
    with Live(get_renderable=lambda: display.view, console=console, refresh_per_second=4):
        yield display
