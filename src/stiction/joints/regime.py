"""A sliding joint on one straight piece of its friction: the linear system q'' = u(t) − stiffness q − damping q'.

Its input is a straight line between samples, so its motion is known in closed form: whole stretches are computed at
once, and states between samples by a power series.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

LONGEST_SERIES = 4.0
"""Time constants that one Taylor series spans; longer spans are cut, or large terms would cancel."""

LARGEST_GROWTH = 200.0
"""Growth of an unstable motion, as the logarithm, after which a stretch is cut: floating point ends at 700."""

MOST_SAMPLES = 1_000_000
"""Samples of one stretch."""

State = tuple[float, float]
"""q [rad] and q' [rad/s]."""


class Regime:
    """One linear system."""

    def __init__(self, stiffness: float, damping: float, step: float) -> None:
        """Discretise exactly for inputs that are straight lines between samples.

        stiffness [1/s²]; damping [1/s]; step: time between samples [s].
        """
        self.stiffness, self.damping = stiffness, damping
        growth = (max(-damping, 0.0) + max(-stiffness, 0.0) ** 0.5) * step
        self.longest = int(LARGEST_GROWTH / growth) if growth * MOST_SAMPLES > LARGEST_GROWTH else MOST_SAMPLES
        # Columns of the transition, and the answers to a constant and to a ramp of input.
        first, second = self.inside((1.0, 0.0), 0.0, 0.0, step), self.inside((0.0, 1.0), 0.0, 0.0, step)
        self.transition = np.array([first, second]).T
        self.from_next = np.array(self.inside((0.0, 0.0), 0.0, 1.0, step)) / step
        self.from_this = np.array(self.inside((0.0, 0.0), 1.0, 0.0, step)) - self.from_next
        # By Cayley and Hamilton each component of x' = Φ x + g obeys a second-order recursion.
        trace, determinant = np.trace(self.transition), np.linalg.det(self.transition)
        self._recursion = np.array([1.0, -trace, determinant])
        self._crossed = self.transition - trace * np.eye(2)

    def stretch(self, state: State, drive: np.ndarray) -> np.ndarray:
        """Return q and q' at every sample of `drive`, from `state` at the first; shape (2, num_samples).

        drive: u at the samples [rad/s²], shape (num_samples,), at least two.
        """
        change = np.outer(self.from_this, drive[:-1]) + np.outer(self.from_next, drive[1:])
        excitation = np.empty((2, len(drive)))
        excitation[:, 0] = state
        excitation[:, 1] = self._crossed @ state + change[:, 0]
        excitation[:, 2:] = change[:, 1:] + self._crossed @ change[:, :-1]
        return lfilter([1.0], self._recursion, excitation, axis=1)

    def acceleration(self, state: State, drive: float) -> float:
        """Return q'' [rad/s²] in `state` under the input `drive` [rad/s²]."""
        return drive - self.stiffness * state[0] - self.damping * state[1]

    def inside(self, state: State, drive: float, drive_slope: float, elapsed: float) -> State:
        """Return q and q' after `elapsed` seconds of the input u = drive + drive_slope t, by Taylor series."""
        pieces = 1 + int((abs(self.damping) + abs(self.stiffness) ** 0.5) * elapsed / LONGEST_SERIES)
        elapsed /= pieces
        for piece in range(pieces):
            state = self._series(state, drive + drive_slope * elapsed * piece, drive_slope, elapsed)
        return state

    def _series(self, state: State, drive: float, slope: float, elapsed: float) -> State:
        """Sum the series; q⁽ⁿ⁺²⁾ = u⁽ⁿ⁾ − stiffness q⁽ⁿ⁾ − damping q⁽ⁿ⁺¹⁾ gives each derivative from the two before."""
        stiffness, damping = self.stiffness, self.damping
        older, newer = state
        position, velocity = older + newer * elapsed, newer
        factor, forcing = elapsed, drive
        for order in range(2, 80):
            older, newer = newer, forcing - stiffness * older - damping * newer
            velocity += newer * factor
            factor *= elapsed / order
            position += newer * factor
            forcing = slope if order == 2 else 0.0
            if order > 3 and abs(newer * factor) <= 1e-17 * abs(position) and abs(older * factor) <= 1e-17:
                break
        return position, velocity

    def reach(self, state: State, drive: float, drive_slope: float, span: float, speed: float, final: State) -> float:
        """Return the instant at which q' passes `speed` for good within `span` [s], 0 if it starts beyond it.

        final: the state at the end of the span, where q' is beyond `speed`, seen from where it starts. Newton's method
        between two brackets, from where q' would pass if q'' were a straight line.
        """
        side = 1.0 if final[1] > speed else -1.0
        begin = side * self.acceleration(state, drive)
        growth = (side * self.acceleration(final, drive + drive_slope * span) - begin) / span
        low, high, gap = 0.0, span, side * (state[1] - speed)
        if gap >= 0:
            # It starts on the edge: it may turn inwards first, and leave later.
            if begin >= 0 or growth <= 0:
                return 0.0
            low, gap = -begin / growth, 0.0
            if low >= span or side * (self.inside(state, drive, drive_slope, low)[1] - speed) >= 0:
                return 0.0
        root = begin * begin - 2.0 * growth * gap
        moment = -2.0 * gap / (begin + root**0.5) if gap < 0 <= root and begin + root**0.5 > 0 else 2.0 * low
        if not low < moment < high:
            moment = 0.5 * (low + high)
        for _ in range(60):
            now = self.inside(state, drive, drive_slope, moment)
            gap = side * (now[1] - speed)
            if gap >= 0:
                high = moment
            else:
                low = moment
            rate = side * self.acceleration(now, drive + drive_slope * moment)
            guess = moment - gap / rate if rate > 0 else 0.5 * (low + high)
            if not low <= guess <= high:
                guess = 0.5 * (low + high)
            # Newton's error is squared by the step that is taken here without looking again.
            if abs(guess - moment) <= 1e-7 * span:
                return guess
            moment = guess
        return moment
