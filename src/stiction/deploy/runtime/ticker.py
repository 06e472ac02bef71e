"""Absolute deadlines on a monotonic clock, and their lateness."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

LEAD = 1e-3
"""Time before a deadline at which a rehearsal begins [s]: three times what one takes."""

QUIET = 0.5
"""p99 of an idle loop's lateness up to which lateness is judged [ms]; beyond, the machine is the reason."""

BUSY = ("stale state", "policy silent", "supervisor halted", "supervisor silent", "clock rate")
"""Rules that a machine under other load breaks."""

LATE = 2.0
"""p99 of a loop's lateness up to which it is well [ms]."""


class Ticker:
    """Timer that wakes at start + n · period for whole n. A deadline that passed a period ago, or more, is skipped."""

    def __init__(
        self, period: float, clock: Callable[[], float] = time.monotonic, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        """Start now; period: [s]; the first deadline is one period from now; clock, sleep: [s]."""
        self.period, self._clock, self._sleep = period, clock, sleep
        self._start, self._number = clock(), 0

    def wait(self, rehearse: Callable[[], None] | None = None) -> tuple[float, int]:
        """Wait for the next deadline.

        rehearse: called `LEAD` before it, where there is time for that; the rest is waited awake.

        Returns the lateness of the wake-up [s], at least 0, and the number of deadlines skipped before it.
        """
        self._number += 1
        passed = self._clock() - (self._start + self._number * self.period)
        # Whole periods alone: to be late by less than one costs no step.
        skipped = max(0, int(passed / self.period))
        self._number += skipped
        deadline = self._start + self._number * self.period
        if rehearse is not None and (left := deadline - LEAD - self._clock()) > 0:
            self._sleep(left)
            rehearse()
            # Awake: a process that sleeps again so shortly before is woken late where others want the core.
            while self._clock() < deadline:
                pass
        while (left := deadline - self._clock()) > 0:
            self._sleep(left)
        return max(-left, 0.0), skipped


class Histogram:
    """Times in bins of 10 µs up to 0.1 s, and the largest one exactly; its size does not grow."""

    WIDTH, BINS = 1e-5, 10_000

    def __init__(self) -> None:
        self._counts = np.zeros(self.BINS + 1, dtype=np.int64)
        self.largest = 0.0
        """Largest time [s]."""

    def add(self, seconds: float) -> None:
        """Count one time [s]."""
        self._counts[min(int(max(seconds, 0.0) / self.WIDTH), self.BINS)] += 1
        self.largest = max(self.largest, seconds)

    def quantile(self, share: float) -> float:
        """Return the time that this share of all times does not exceed [s], rounded up to a bin; 0 of none."""
        total = int(self._counts.sum())
        if total == 0:
            return 0.0
        place = int(np.searchsorted(np.cumsum(self._counts), max(1, int(np.ceil(share * total)))))
        return self.largest if place >= self.BINS else min((place + 1) * self.WIDTH, self.largest)

    def milliseconds(self) -> dict[str, float]:
        """Return p50, p99, p99_9 and max [ms]."""
        quantiles = {name: self.quantile(share) for name, share in (("p50", 0.5), ("p99", 0.99), ("p99_9", 0.999))}
        return {name: round(1e3 * value, 4) for name, value in (quantiles | {"max": self.largest}).items()}
