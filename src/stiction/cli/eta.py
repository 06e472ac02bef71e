"""How long a training run still takes, from what its iterations have taken so far."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from statistics import mean

from stiction.rma.config import TrainCfg

RECENT = 20
"""Iterations whose times count."""


class RunClock:
    """Measures both phases; before the student has begun, its rate is inferred from the teacher's."""

    def __init__(self, cfg: TrainCfg) -> None:
        """Begin without a measurement."""
        self.cfg = cfg
        self._seconds: dict[str, deque[tuple[float, float]]] = {
            phase: deque(maxlen=RECENT) for phase in ("teacher", "student")
        }

    def add(self, phase: str, figures: Mapping[str, float]) -> None:
        """Take an iteration's `rollout_seconds` and `seconds`."""
        rollout, whole = figures["rollout_seconds"], figures["seconds"]
        self._seconds[phase].append((rollout, whole - rollout))

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


def span(seconds: float) -> str:
    """Return a time as a person says it: `45 s`, `12 min`, `3 h 05 min`."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
