"""Watches a training run: whether it has diverged, since when, what to try; and whether it has learned enough.

A policy that stands still, and exploration at its lower bound, are results of training with friction and no divergence.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from stiction.learning.config import STD_RANGE, StopCfg

Row = Mapping[str, float]

LOSSES = ("loss/value", "loss/clone", "loss/adaptation", "loss/estimator")
"""Losses that stay within a factor of ten in healthy runs; a hundredfold is an explosion."""

LOSS_FACTOR, LOSS_BEFORE = 100.0, 20
"""An exploded loss over the median of all iterations before; how many of those there must be."""

KL_FACTOR = 10.0
"""KL divergence over the desired one, with the learning rate at its floor: the step cannot get smaller any more."""

LOWEST_RATE = 1e-5
"""Floor of rsl_rl's adaptive learning rate."""

BLOWN_UP_SHARE = 0.05
"""Share of the robots whose simulation became unstable within one rollout; 0 in healthy runs."""

FALLS = 2.5
"""Falls of every robot [1/s]: an episode of 0.4 s, which is what it takes to drop. Untrained quadrupeds reach 1."""


@dataclass(frozen=True)
class Symptom:
    """One kind of divergence."""

    lasting: int
    """Iterations in a row that must show it."""
    advice: str
    seen: Callable[[Row, Sequence[Row]], str]
    """Symptom of an iteration in words, from it and the healthy ones before it; empty where it is healthy."""


@dataclass(frozen=True)
class Diagnosis:
    """A run has diverged."""

    what: str
    since: int
    advice: str


def _not_finite(row: Row, _: Sequence[Row]) -> str:
    """Name the figures that are not finite."""
    bad = [name for name, value in row.items() if not math.isfinite(value)]
    return f"{', '.join(bad)} not finite" if bad else ""


def _loss_exploded(row: Row, before: Sequence[Row]) -> str:
    """Name a loss that is far above its median."""
    for name in LOSSES:
        usual = [other[name] for other in before if name in other]
        if name in row and len(usual) >= LOSS_BEFORE and row[name] > LOSS_FACTOR * median(usual):
            return f"{name} is {row[name]:.3g}, its median before was {median(usual):.3g}"
    return ""


def _noise_exploded(row: Row, before: Sequence[Row]) -> str:
    """Return that the action noise has grown to its bound; a run that began there chose it."""
    bound = STD_RANGE[1]
    grown = bool(before) and before[0].get("action_std", bound) < 0.75 * bound
    if grown and row.get("action_std", 0.0) > 0.99 * bound:
        return f"action_std has grown from {before[0]['action_std']:.2f} to its bound of {bound:g}"
    return ""


def _falling(row: Row, _: Sequence[Row]) -> str:
    """Return that robots fall as soon as they are placed."""
    falls = row.get("walk/falls", 0.0)
    return f"walk/falls is {falls:.1f}/s: every episode ends after {1 / falls:.2f} s" if falls > FALLS else ""


def symptoms(num_envs: int, desired_kl: float) -> tuple[Symptom, ...]:
    """Return all kinds of divergence, for a fleet of `num_envs` robots and PPO's `desired_kl`."""

    def blown_up(row: Row, _: Sequence[Row]) -> str:
        share = row.get("walk/blown_up", 0.0) / num_envs
        return f"walk/blown_up: {share:.0%} of the simulations became unstable" if share > BLOWN_UP_SHARE else ""

    def step_too_large(row: Row, _: Sequence[Row]) -> str:
        kl, rate = row.get("kl", 0.0), row.get("learning_rate", 1.0)
        if kl > KL_FACTOR * desired_kl and rate <= 1.01 * LOWEST_RATE:
            return f"the KL divergence is {kl:.3g}, desired is {desired_kl:g}, and the learning rate at its floor"
        return ""

    slower = "a smaller --set teacher.learning_rate or student.learning_rate, or more --num-envs"
    return (
        Symptom(1, slower, _not_finite),
        Symptom(10, slower, _loss_exploded),
        Symptom(50, "a smaller --set teacher.entropy", _noise_exploded),
        Symptom(20, "fewer passes, --set teacher.epochs, or more --num-envs", step_too_large),
        Symptom(5, "a shorter --set task.timestep, and `stiction doctor --randomization` on this robot", blown_up),
        Symptom(50, "another standing pose or standing height in the robot's spec", _falling),
    )


class Health:
    """Watches the iterations of one phase, in order."""

    def __init__(self, num_envs: int, desired_kl: float) -> None:
        """Begin before the first iteration."""
        self._symptoms = symptoms(num_envs, desired_kl)
        self._healthy: list[list[Row]] = [[] for _ in self._symptoms]
        self._since: list[int | None] = [None] * len(self._symptoms)

    @property
    def suspicious(self) -> bool:
        """True if the last iteration showed a symptom: its parameters must not replace good ones."""
        return any(since is not None for since in self._since)

    def check(self, iteration: int, row: Row) -> Diagnosis | None:
        """Take the figures of an iteration; return a diagnosis once a symptom has lasted."""
        diagnosis = None
        for index, symptom in enumerate(self._symptoms):
            # All symptoms, also after a diagnosis: each counts its own iterations.
            what, since = symptom.seen(row, self._healthy[index]), self._since[index]
            if not what:
                self._since[index] = None
                self._healthy[index].append(row)
                continue
            since = self._since[index] = iteration if since is None else since
            if diagnosis is None and iteration - since + 1 >= symptom.lasting:
                diagnosis = Diagnosis(what, since, symptom.advice)
        return diagnosis


class EarlyStop:
    """Averages the last iterations of one phase."""

    def __init__(self, cfg: StopCfg, last_stage: int, not_before: int = 0) -> None:
        """`last_stage`: of the friction, to which all averaged iterations must belong; `not_before`: first iteration
        that counts, from which robots walk with their least noise, and are disturbed up to the limit.
        """
        self.cfg, self.last_stage, self.not_before = cfg, last_stage, not_before
        self._rows: deque[Row] = deque(maxlen=cfg.iterations)

    def check(self, row: Row, iteration: int = 0) -> dict[str, float] | None:
        """Take the figures of an iteration; return the means that met the target, or None."""
        if self.cfg.tracking_error is None:
            return None
        if row["friction/stage"] != self.last_stage or iteration < self.not_before:
            self._rows.clear()
            return None
        self._rows.append(row)
        if len(self._rows) < self.cfg.iterations:
            return None
        names = ("walk/tracking_error", "walk/falls", "terrain/level")
        means = {name: sum(r[name] for r in self._rows) / len(self._rows) for name in names if name in row}
        level = self.cfg.terrain_level
        met = means["walk/tracking_error"] < self.cfg.tracking_error and means["walk/falls"] <= self.cfg.falls
        return means if met and (level is None or means["terrain/level"] >= level) else None
