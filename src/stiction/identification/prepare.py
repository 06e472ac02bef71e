"""Signals of inverse dynamics from a checked log: filtered forward and backward, differentiated, decimated.

Torque, position and sign(θ') pass through the same zero-phase filter, and θ', θ'' are differences of the filtered θ.
For the terms that are linear in these (inertia, viscous and Coulomb friction, offset, the torque from outside) the
equation of `model` holds of filtered signals exactly, but for the differences. What is made of several of them is made
after the filter, where exact would be to filter the product: sin θ and cos θ, of a payload too, sign(θ') times an
angle, a load or a Stribeck curve, and the split by direction. It does because those vary slowly beside the corner, and
samples near a reversal, where sign(θ') does not, are left out. How little it moves a result is measured in
`tests/identification/test_prepare.py`, on logs of `example.LEG` with the noise of real ones, by filtering the products:
at most 0.06 standard deviations of each parameter, and 0.2 where friction is split by direction. A known payload, and a
known torque from outside, enter as the torque that they require, in the unit of the torque: N m over the motor
strength where that was declared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.identification.checks import Uniform
from stiction.identification.filters import acceleration_noise, choose_cutoff, derivatives, low_pass, position_noise
from stiction.identification.setup import Payload

LOW_SPEED = 0.005
"""Share of the top speed below which samples do not show the direction of friction, and are left out. Small,
because the samples near rest are those in which friction shows most."""


@dataclass(frozen=True)
class Prepared:
    """Filtered signals on the even grid, arrays of shape (num_samples,), and the samples that count."""

    step: float
    """Time between samples [s]."""
    cutoff: float
    """Corner of the filter [Hz]."""
    position: np.ndarray
    """θ [rad]."""
    velocity: np.ndarray
    """θ' [rad/s]."""
    acceleration: np.ndarray
    """θ'' [rad/s²]."""
    direction: np.ndarray
    """sign(θ'), filtered like the rest [1]."""
    torque: np.ndarray
    """τ + d: the motor's torque and what acts from outside [N m]."""
    outside: np.ndarray
    """d alone: the known torque from outside [N m]."""
    threshold: float
    """Speed below which the direction is not known [rad/s]."""
    used: np.ndarray
    """Indices of the samples that enter the regression, shape (num_used,)."""
    attenuation: float = 0.0
    """Share by which noise of the acceleration makes the inertia too small, in least squares [1]."""
    unusable: int = 0
    """Samples in long gaps, and at the torque limit where the torque is the PD law's."""
    noise: float = 0.0
    """Standard deviation of the position's white noise [rad]."""

    @property
    def mask(self) -> np.ndarray:
        """1 where a sample enters the regression, else 0; shape (num_samples,)."""
        mask = np.zeros(len(self.torque))
        mask[self.used] = 1.0
        return mask

    @property
    def left_over(self) -> str:
        """Clauses on the number of samples that are left, and on the causes that removed the rest."""
        slow = int(np.count_nonzero(np.abs(self.velocity) < self.threshold))
        turns = int(np.count_nonzero(np.diff(np.sign(self.velocity))))
        independent = len(range(0, len(self.velocity), _decimation(self.cutoff, self.step)))
        parts = [
            f"of {len(self.velocity)} in the log {independent} are independent below the filter's corner of "
            f"{self.cutoff:.3g} Hz"
        ]
        parts.append(f"{slow / len(self.velocity):.0%} are slower than {self.threshold:.3g}")
        parts.append(f"{turns} reversals take {2 / self.cutoff:.3g} s each, for the filter")
        parts += [f"{self.unusable} are in gaps or at the torque limit"] if self.unusable else []
        return ", ".join(parts)

    @property
    def remedy(self) -> str:
        """Advice where too few samples are left."""
        if self.unusable < 0.5 * len(self.velocity):
            return "move further, faster, or for longer"
        return (
            f"{self.unusable * self.step:.3g} of {len(self.velocity) * self.step:.3g} s cannot be used: log without "
            "gaps in the time stamps, or below the torque limit"
        )

    @property
    def time(self) -> np.ndarray:
        """Time from zero [s]."""
        return np.arange(len(self.torque)) * self.step


def prepare(
    signals: Uniform, torque: np.ndarray, cutoff: float | None = None, unusable: np.ndarray | None = None
) -> Prepared:
    """Filter, differentiate, and choose samples.

    torque: driving torque, as logged or from the PD law [N m], shape (num_samples,); cutoff: corner of the
    filter [Hz], None chooses it by `choose_cutoff`; unusable: samples to leave out, a motor at its limit say (bool).
    Raises `StictionError` for a cutoff that the sampling rate does not allow.
    """
    rate = 1 / signals.step
    if cutoff is not None and not 0 < cutoff < rate / 2:
        raise ConfigurationError(
            f"cutoff {cutoff} Hz: expected between 0 and half the sampling rate, {rate / 2:.4g} Hz"
        )
    noise = position_noise(signals.position)
    corner = choose_cutoff(signals.position, signals.step, noise) if cutoff is None else cutoff
    velocity, acceleration = derivatives(signals.position, signals.step, corner)
    # As of `acceleration_noise`: below f white noise has the velocity variance 2 σ² step (2π)² f³ / 3.
    velocity_noise = noise * np.sqrt(2 * signals.step * (2 * np.pi) ** 2 * corner**3 / 3)
    threshold = max(LOW_SPEED * float(np.abs(velocity).max()), 3 * float(velocity_noise))
    outside = np.zeros_like(torque) if signals.disturbance is None else signals.disturbance
    left_out = ~signals.valid if unusable is None else ~signals.valid | unusable
    return Prepared(
        step=signals.step,
        cutoff=corner,
        position=low_pass(signals.position, corner, signals.step),
        velocity=velocity,
        acceleration=acceleration,
        direction=low_pass(np.sign(velocity), corner, signals.step),
        torque=low_pass(torque + outside, corner, signals.step),
        outside=low_pass(outside, corner, signals.step),
        threshold=threshold,
        attenuation=(acceleration_noise(noise, signals.step, corner) / float(np.std(acceleration))) ** 2,
        unusable=int(left_out.sum()),
        noise=noise,
        used=_clear_samples(velocity, threshold, corner, signals.step, left_out),
    )


def _clear_samples(
    velocity: np.ndarray, threshold: float, cutoff: float, step: float, unusable: np.ndarray
) -> np.ndarray:
    """Return the samples, decimated to twice the corner, with nothing slow, turning or unusable in the filter's reach.

    The reach is one period of the corner on each side. Near a reversal friction may take any value between its limits,
    and the instant of turning is known only to within the filter's blur: such samples would bias B against b_c.
    """
    unclear = (np.abs(velocity) < threshold) | unusable
    unclear[1:] |= np.diff(np.sign(velocity)) != 0
    reach = max(1, round(1 / (cutoff * step)))
    excluded = np.convolve(unclear, np.ones(2 * reach + 1), "same") > 0.5
    # Near the ends the filter works on padding, and not on the log.
    excluded[: 2 * reach] = excluded[-2 * reach :] = True
    decimated = np.arange(0, len(velocity), _decimation(cutoff, step))
    return decimated[~excluded[decimated]]


def _decimation(cutoff: float, step: float) -> int:
    """Return the factor of decimation, to about twice the corner [Hz]; step [s]."""
    return max(1, int(1 / (2 * cutoff * step)))


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
    """Torque τ that the motor was asked for or gave, in its unit [N m where that is known]."""
    load: np.ndarray
    """Known part of the load on the gear: the payload's weight less d [N m over the declared strength]."""
    payload: np.ndarray
    """Known part of the torque: the payload's weight and inertia, less d [N m over the declared strength]."""
    time: np.ndarray
    """Time from the start of the first run [s]; later runs follow on."""
    run: np.ndarray
    """Index of the run."""
    slowest: float
    """Speed below which rows were left out [rad/s]."""
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
            rows = self.run == run
            # At least two a run: one can be left out then, and one of the run is still seen.
            pieces = max(2, round(count * span / total)) if len(spans) > 1 else count
            share = (self.time[rows] - self.time[rows].min()) / span
            index[rows] = start + np.minimum((share * pieces).astype(int), pieces - 1)
            start += pieces
        return index


def make_rows(runs: Sequence[Prepared], payloads: Sequence[Payload | None], strength: float = 1.0) -> Rows:
    """Collect the rows of each run's clear samples.

    payloads: one entry a run, None without; strength: k where it was declared, else 1.
    """
    parts: dict[str, list[np.ndarray]] = {}
    begin = 0.0
    for index, (run, payload) in enumerate(zip(runs, payloads, strict=True)):
        weight, total = _payload(run, payload)
        signals = {
            "position": run.position,
            "velocity": run.velocity,
            "acceleration": run.acceleration,
            "direction": run.direction,
            "torque": run.torque - run.outside,
            "load": (weight - run.outside) / strength,
            "payload": (total - run.outside) / strength,
            "time": run.time + begin,
            "run": np.full(len(run.torque), index),
        }
        for name, values in signals.items():
            parts.setdefault(name, []).append(values[run.used])
        begin += len(run.torque) * run.step
    joined = {name: np.concatenate(values) for name, values in parts.items()}
    return Rows(**joined, slowest=max(run.threshold for run in runs), attenuation=max(run.attenuation for run in runs))


def _payload(run: Prepared, payload: Payload | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the torque of the payload's weight, and all torque of the payload, at every sample [N m]."""
    if payload is None:
        return np.zeros_like(run.torque), np.zeros_like(run.torque)
    weight = payload.weight * np.sin(run.position - payload.angle)
    return weight, weight + payload.inertia * run.acceleration
