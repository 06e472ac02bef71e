"""From a checked log to the signals of inverse dynamics: filtered forward and backward, differentiated, decimated.

Every signal of I θ'' + B θ' + b_c sign(θ') + offset = τ passes through the same zero-phase filter, sign(θ')
included, so that the equation still holds for the filtered signals wherever it held over the reach of the filter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from stiction.formats.errors import StictionError
from stiction.identify.checks import Uniform

ORDER = 4
"""Order of the Butterworth filter; it is run forward and backward."""

LARGEST_NOISE = 0.03
"""Noise over signal, in the acceleration. Noisy regressors shrink the inertia by the square of this: 0.1 %."""

LOW_SPEED = 0.005
"""Samples slower than this share of the top speed do not say which way friction points, and are left out.
Small, because the samples near rest are those in which friction shows most. On the EMPS record 0.02 instead moves B by
-0.6 % and b_c by +0.6 %, well within the intervals (±9 % and ±6 %)."""


@dataclass(frozen=True)
class Prepared:
    """Filtered signals on the even grid, arrays of shape (num_samples,), and which samples count."""

    cutoff: float
    """Corner of the filter [Hz]."""
    velocity: np.ndarray
    """θ' [rad/s]."""
    acceleration: np.ndarray
    """θ'' [rad/s²]."""
    direction: np.ndarray
    """sign(θ'), filtered like the rest [1]."""
    torque: np.ndarray
    """τ [N m]."""
    threshold: float
    """Speed under which the direction is not known [rad/s]."""
    used: np.ndarray
    """Indices of the samples that enter the regression, shape (num_used,)."""

    @property
    def regressor(self) -> np.ndarray:
        """Columns θ'', θ', sign(θ'), 1 at the samples used, shape (num_used, 4)."""
        columns = (self.acceleration, self.velocity, self.direction, np.ones_like(self.velocity))
        return np.stack(columns, axis=1)[self.used]


def prepare(signals: Uniform, cutoff: float | None = None) -> Prepared:
    """Filter, differentiate, and choose samples.

    cutoff: corner of the filter [Hz]; None chooses it by `choose_cutoff`. Raises `StictionError` if no sample is left.
    """
    if signals.torque is None:
        raise StictionError("no torque in the log: inverse dynamics needs it; log torque.<joint>")
    rate = 1 / signals.step
    if cutoff is not None and not 0 < cutoff < rate / 2:
        raise StictionError(f"cutoff {cutoff} Hz: expected between 0 and half the sampling rate, {rate / 2:.4g} Hz")
    noise = position_noise(signals.position)
    corner = choose_cutoff(signals.position, signals.step, noise) if cutoff is None else cutoff
    velocity, acceleration = derivatives(signals.position, signals.step, corner)
    velocity_noise = noise * np.sqrt(2 * signals.step * (2 * np.pi) ** 2 * corner**3 / 3)
    threshold = max(LOW_SPEED * float(np.abs(velocity).max()), 3 * float(velocity_noise))
    return Prepared(
        cutoff=corner,
        velocity=velocity,
        acceleration=acceleration,
        direction=low_pass(np.sign(velocity), corner, signals.step),
        torque=low_pass(signals.torque, corner, signals.step),
        threshold=threshold,
        used=_clear_samples(velocity, threshold, corner, signals.step),
    )


def low_pass(values: np.ndarray, cutoff: float, step: float) -> np.ndarray:
    """Return `values`, shape (num_samples,), through the Butterworth filter forward and backward: no delay."""
    return sosfiltfilt(butter(ORDER, 2 * cutoff * step, output="sos"), values)


def derivatives(position: np.ndarray, step: float, cutoff: float) -> tuple[np.ndarray, np.ndarray]:
    """Return filtered velocity and acceleration by central differences, shape (num_samples,) each."""
    velocity = np.gradient(low_pass(position, cutoff, step), step)
    return velocity, np.gradient(velocity, step)


def position_noise(position: np.ndarray) -> float:
    """Return the standard deviation of the position's white noise [rad], from the upper half of its spectrum."""
    rest = position - sosfiltfilt(butter(ORDER, 0.5, output="sos"), position)
    return float(np.std(rest[20:-20]) * np.sqrt(2.0))


def choose_cutoff(position: np.ndarray, step: float, noise: float) -> float:
    """Return the highest corner [Hz] at which noise leaves the acceleration usable, at most a quarter of the rate.

    White noise of size σ in the position has, below f, the acceleration variance 2 σ² step (2π)⁴ f⁵ / 5.
    The higher the corner, the fewer samples around each reversal are lost.
    """
    corner = 0.25 / step
    while corner > 0.01 / step:
        size = float(np.std(derivatives(position, step, corner)[1]))
        disturbed = noise * np.sqrt(2 * step * (2 * np.pi) ** 4 * corner**5 / 5)
        if disturbed <= LARGEST_NOISE * size:
            break
        corner *= 0.8
    return corner


def _clear_samples(velocity: np.ndarray, threshold: float, cutoff: float, step: float) -> np.ndarray:
    """Return the samples, decimated to twice the corner, that have no slow or turning sample within the filter's reach.

    The reach is one period of the corner on each side. Near a reversal friction may take any value between its limits,
    and the instant of turning is known only to within the filter's blur: such samples would bias B against b_c.
    """
    unclear = np.abs(velocity) < threshold
    unclear[1:] |= np.diff(np.sign(velocity)) != 0
    reach = max(1, round(1 / (cutoff * step)))
    blurred = np.convolve(unclear, np.ones(2 * reach + 1), "same") > 0.5
    blurred[: 2 * reach] = blurred[-2 * reach :] = True
    every = max(1, int(1 / (2 * cutoff * step)))
    kept = np.arange(0, len(velocity), every)
    return kept[~blurred[kept]]
