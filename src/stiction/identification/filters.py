"""Filters without delay, derivatives by differences, and the highest corner that the noise of a position allows."""

from __future__ import annotations

import numpy as np

ORDER = 4
"""Order of the Butterworth filter; it is run forward and backward."""

PADDING = 10.0
"""Padding of a signal at either end for the filter, in periods of the corner."""

LARGEST_NOISE = 0.03
"""Noise over signal, in the acceleration. Noisy regressors shrink the inertia by the square of this: 0.1 %."""


def low_pass(values: np.ndarray, cutoff: float, step: float) -> np.ndarray:
    """Return `values`, shape (num_samples,), through the Butterworth filter forward and backward: no delay.

    Its gain is 1/(1 + (tan πf step / tan πf_c step)^(2 order)) at a frequency f. Beyond its ends a signal is continued,
    turned about the end.
    """
    more = min(len(values) - 1, int(PADDING / (cutoff * step)))
    before, after = 2 * values[0] - values[more:0:-1], 2 * values[-1] - values[-2 : -more - 2 : -1]
    padded = np.concatenate([before, values, after])
    ratio = np.tan(np.pi * np.fft.rfftfreq(len(padded)).clip(0, 0.4999)) / np.tan(np.pi * cutoff * step)
    spectrum = np.fft.rfft(padded) / (1 + ratio ** (2 * ORDER))
    return np.fft.irfft(spectrum, len(padded))[more : more + len(values)]


def derivatives(position: np.ndarray, step: float, cutoff: float) -> tuple[np.ndarray, np.ndarray]:
    """Return filtered velocity and acceleration by differences over five samples, shape (num_samples,) each."""
    velocity = slope(low_pass(position, cutoff, step), step)
    return velocity, slope(velocity, step)


def slope(values: np.ndarray, step: float) -> np.ndarray:
    """Return the derivative, shape (num_samples,), off by (2π f step)⁴/30 of itself at the frequency f."""
    rate = np.gradient(values, step)
    rate[2:-2] = (8 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])) / (12 * step)
    return rate


def position_noise(position: np.ndarray) -> float:
    """Return the standard deviation of the position's white noise [rad], from the upper half of its spectrum."""
    rest = position - low_pass(position, 0.25, 1.0)
    # Half of the spectrum holds half of the variance; near the ends the filter works on padding.
    return float(np.std(rest[20:-20]) * np.sqrt(2.0))


def choose_cutoff(position: np.ndarray, step: float, noise: float) -> float:
    """Return the highest corner [Hz] at which noise leaves the acceleration usable, at most a quarter of the rate."""
    corner = 0.25 / step
    while corner > 0.01 / step:
        size = float(np.std(derivatives(position, step, corner)[1]))
        if acceleration_noise(noise, step, corner) <= LARGEST_NOISE * size:
            break
        corner *= 0.8
    return corner


def acceleration_noise(noise: float, step: float, corner: float) -> float:
    """Return the standard deviation of the acceleration under white noise of the position [rad/s²].

    White noise of size σ has, below f, the acceleration variance 2 σ² step (2π)⁴ f⁵ / 5.
    """
    return noise * float(np.sqrt(2 * step * (2 * np.pi) ** 4 * corner**5 / 5))
