"""What a bus and a computer do to a signal: it arrives later."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

Signal = TypeVar("Signal")
"""What travels."""


class DelayLine(Generic[Signal]):
    """A line of `steps` places: what goes in comes out that many pushes later, at once where there are none."""

    def __init__(self, steps: int) -> None:
        """Make an empty line; it must be filled before use."""
        self._line: deque[Signal] = deque(maxlen=steps + 1)

    def fill(self, signal: Signal) -> None:
        """Begin as if `signal` had been pushed forever."""
        self._line.extend([signal] * (self._line.maxlen or 1))

    def push(self, signal: Signal) -> Signal:
        """Take in what is sent now and return what arrives now."""
        self._line.append(signal)
        return self._line[0]

    @property
    def arrived(self) -> Signal:
        """What arrived last."""
        return self._line[0]


def whole_steps(delay: float, timestep: float) -> int:
    """Return a delay [s] in steps of `timestep` [s], the nearest whole number: there are no instants between steps."""
    return round(delay / timestep)
