"""The rows of the torque equation: what each sample that counts says about the parameters.

Several runs of the same joint stack into one set of rows. A known payload, and a known torque from outside, enter as
what they are known to ask for, in the unit of the torque: N m over the motor strength where that was declared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stiction.identify.prepare import Prepared
from stiction.identify.setup import Payload


@dataclass(frozen=True)
class Rows:
    """Samples of one or more runs; arrays of shape (num_rows,), filtered."""

    position: np.ndarray
    """θ [rad]."""
    velocity: np.ndarray
    """θ' [rad/s]."""
    acceleration: np.ndarray
    """θ'' [rad/s²]."""
    direction: np.ndarray
    """sign(θ') [1]."""
    torque: np.ndarray
    """τ, what the motor was asked for or gave, in its own unit [N m where that is known]."""
    load: np.ndarray
    """What the gear carries of what is known: the payload's weight less d [N m over the declared strength]."""
    payload: np.ndarray
    """Torque known to be asked for: the payload's weight and inertia, less d [N m over the declared strength]."""
    time: np.ndarray
    """From the start of the first run [s]; later runs follow on."""
    run: np.ndarray
    """Index of the run."""
    slowest: float
    """Speed under which rows were left out [rad/s]."""
    attenuation: float = 0.0
    """Share by which noise of the acceleration makes the inertia too small, in least squares [1]."""

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.torque)

    def take(self, chosen: np.ndarray) -> Rows:
        """Return some of the rows; chosen: indices or booleans."""
        fields = ("position", "velocity", "acceleration", "direction", "torque", "load", "payload", "time", "run")
        return replace(self, **{name: getattr(self, name)[chosen] for name in fields})

    def blocks(self, count: int) -> np.ndarray:
        """Return the block of each row, 0 to about `count` − 1, equal spans of time; no block spans two runs."""
        index = np.zeros(len(self), int)
        total, start = 0.0, 0
        spans = {run: np.ptp(self.time[self.run == run]) + 1e-9 for run in np.unique(self.run)}
        total = sum(spans.values())
        for run, span in spans.items():
            mine = self.run == run
            pieces = max(2, round(count * span / total)) if len(spans) > 1 else count
            share = (self.time[mine] - self.time[mine].min()) / span
            index[mine] = start + np.minimum((share * pieces).astype(int), pieces - 1)
            start += pieces
        return index


def make_rows(runs: Sequence[Prepared], payloads: Sequence[Payload | None], strength: float = 1.0) -> Rows:
    """Collect the rows of each run's clear samples.

    payloads: one entry a run, None without; strength: k where it was declared, else 1.
    """
    parts: dict[str, list[np.ndarray]] = {}
    begin = 0.0
    for index, (run, payload) in enumerate(zip(runs, payloads, strict=True)):
        weight, asked = _payload(run, payload)
        signals = {
            "position": run.position,
            "velocity": run.velocity,
            "acceleration": run.acceleration,
            "direction": run.direction,
            "torque": run.torque - run.outside,
            "load": (weight - run.outside) / strength,
            "payload": (asked - run.outside) / strength,
            "time": run.time + begin,
            "run": np.full(len(run.torque), index),
        }
        for name, values in signals.items():
            parts.setdefault(name, []).append(values[run.used])
        begin += len(run.torque) * run.step
    joined = {name: np.concatenate(values) for name, values in parts.items()}
    return Rows(**joined, slowest=max(run.threshold for run in runs), attenuation=max(run.attenuation for run in runs))


def _payload(run: Prepared, payload: Payload | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the weight's torque, and all that the payload asks for, at every sample [N m]."""
    if payload is None:
        return np.zeros_like(run.torque), np.zeros_like(run.torque)
    weight = payload.weight * np.sin(run.position - payload.angle)
    return weight, weight + payload.inertia * run.acceleration
