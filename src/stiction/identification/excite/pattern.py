"""Motions of the search: a slow and a fast part, as offsets from the start pose.

Slow and fast in one log is what separates Coulomb from viscous friction: at one speed only their sum shows. The
triangle moves at an even speed; the sines bring speed and acceleration. The pattern is repeated, so that the halves of
the log can be compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ROUNDING = 0.97
"""Sharpness of the triangle, asin(ROUNDING sin φ): at 1 its corners would ask for infinite acceleration."""

LONGEST_RAMP = 0.3
"""Time over which each part swells and fades [s]."""


@dataclass(frozen=True)
class Pattern:
    """Motion with a slow and a fast part."""

    share: float
    """Share of the time that the slow part takes, from 0 (no slow part) to 1 [1]."""
    slow_frequency: float
    """Approximate frequency of the slow part, which holds whole periods, at least one [Hz]."""
    slow_amplitude: float
    """Peak of the slow part [rad]."""
    frequencies: tuple[float, ...]
    """Frequencies of the sines [Hz]."""
    amplitudes: tuple[float, ...]
    """Amplitudes of the sines, before `fast_peak` scales them to their sum [1]."""
    phases: tuple[float, ...]
    """Phases of the sines [rad]."""
    fast_peak: float
    """Peak of the fast part [rad]."""

    def slow_count(self, count: int) -> int:
        """Return the number of samples of the slow part in a pattern of `count`."""
        return round(self.share * count)

    def offsets(self, count: int, rate: float) -> np.ndarray:
        """Return the pattern [rad], shape (count,), at `rate` samples per second [Hz]."""
        slow_count = self.slow_count(count)
        return np.concatenate([self._slow(slow_count, rate), self._fast(count - slow_count, rate)])

    def _slow(self, count: int, rate: float) -> np.ndarray:
        """Return whole periods of the rounded triangle."""
        if count < 2:
            return np.zeros(count)
        periods = max(1, round(self.slow_frequency * count / rate))
        phase = 2 * np.pi * periods * np.arange(count) / count
        triangle = np.arcsin(ROUNDING * np.sin(phase)) / np.arcsin(ROUNDING)
        return self.slow_amplitude * triangle * _window(count, rate)

    def _fast(self, count: int, rate: float) -> np.ndarray:
        """Return the sum of sines, its peak being `fast_peak`."""
        time = np.arange(count) / rate
        waves = zip(self.amplitudes, self.frequencies, self.phases, strict=True)
        total = sum((a * np.sin(2 * np.pi * f * time + p) for a, f, p in waves), np.zeros(count)) * _window(count, rate)
        peak = float(np.abs(total).max(initial=0.0))
        return self.fast_peak * total / peak if peak > 0 else total


def sine(frequency: float, amplitude: float) -> Pattern:
    """Return A sin(ωt), the paper's excitation, as a pattern."""
    return Pattern(0.0, 1.0, 0.0, (frequency,), (1.0,), (0.0,), amplitude)


def _window(count: int, rate: float) -> np.ndarray:
    """Return a window that swells from 0 to 1 and fades to 0, with slope zero at both ends, shape (count,)."""
    edge = min(int(LONGEST_RAMP * rate), count // 4)
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.arange(edge) / max(edge, 1))
    return np.concatenate([ramp, np.ones(count - 2 * edge), ramp[::-1]])
