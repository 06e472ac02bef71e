"""Detection of new states among repeated and late ones, with the time of measurement on a monotonic clock.

A network delivers a state twice, behind a newer one, or not at all, and a robot's clock is set while it walks. None of
that stops a run by itself: a state that is not new is counted and ignored, and where the clock was set the time goes
on as if it had not been. Lasting faults are for the supervisor: `stale state`, `lossy link`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

STEP = 0.05
"""Lead of a stamp over the fastest message above which the clock counts as set [s]. A smaller step forward
breaks no rule."""

DRIFT = 0.01
"""Rate at which the lead of the fastest message is forgotten [s/s]: clocks drift apart, by far less than that."""

LEAST = 1e-3
"""Shortest time between two states, where the clock was set between them [s]."""

STEPS_APART = 10.0
"""Shortest time between two settings of a clock [s]. A clock that jumps more often is broken, and its jumps are left
in: `time jump`, or `time stands still`."""

RESUMED = 0.005
"""Time for which older stamps follow each other before they count as those of a clock that was set back [s]. Late
messages of a network come at once."""

REMEMBERED = 64
"""Number of messages that are remembered, to tell one that comes twice from one that comes late."""


@dataclass
class Counts:
    """Counts of one robot's states that did not arrive as they were sent."""

    new: int = 0
    """States that were taken."""
    dropped: float = 0
    """States that never came; NaN where a transport cannot tell."""
    late: int = 0
    """States that were older than `--stale` when they were read, a newer one behind them."""
    twice: int = 0
    """States that came again; ignored."""
    reordered: int = 0
    """States that came behind a newer one; ignored."""
    clock_steps: int = 0
    """Number of times that the robot's clock was set."""

    @property
    def share(self) -> tuple[float, float]:
        """Number of states that were lost, came twice, or behind a newer one, and of all that should have come."""
        bad = (0 if math.isnan(self.dropped) else self.dropped) + self.twice + self.reordered
        return bad, self.new + bad

    def reported(self) -> dict[str, float]:
        """Return the counts of report and log, by `COUNTED`."""
        return {name: getattr(self, name) for name in COUNTED}


COUNTED = ("dropped", "late", "twice", "reordered", "clock_steps")
"""Counts that are reported and logged."""


class Arrivals:
    """Filter of one robot's messages, in the order of their arrival; its size does not grow."""

    def __init__(self, dropped: float = 0) -> None:
        """Start without messages; dropped: NaN where messages have no numbers, by which lost ones could be counted."""
        self._dropped = dropped
        self._number = self._seen = 0
        self._stamp = self._arrival = self._monotonic = math.nan
        self._real = self._lead = 0.0
        self._content: object = None
        self._offset, self._set = 0.0, -math.inf
        self._older: list[tuple[float, float]] = []
        self.begin()

    def begin(self) -> None:
        """Count from here on: a loss before a run is no fault of it."""
        self.counts = Counts(dropped=self._dropped)

    def take(
        self,
        stamp: float,
        arrival: float,
        number: int | None = None,
        monotonic: float = math.nan,
        content: object = None,
    ) -> float | None:
        """Return the time at which a state was measured [s], on a monotonic clock; None if it is not a new state.

        stamp: by the robot's clock [s], which may be set; arrival: on our own monotonic clock [s]; number: of the
        robot's messages, where they are numbered; monotonic: by a monotonic clock of the robot [s], where it says
        one; content: value that messages of one stamp are compared by. A time that is not finite is returned as it is.
        """
        if not math.isfinite(stamp):
            return stamp
        if not (self._is_new(stamp, arrival, monotonic, content) if number is None else self._is_next(number)):
            return None
        self.counts.new += 1
        return self._time(stamp, arrival, monotonic, content)

    def _is_next(self, number: int) -> bool:
        """Return True if a number is higher than all before it; count missing, late and repeated ones."""
        ahead, counts = number - self._number, self.counts
        if not self._seen or ahead > 0:
            counts.dropped += ahead - 1 if self._seen else 0
            history = self._seen << ahead if self._seen and ahead < REMEMBERED else 0
            self._number, self._seen = number, (history | 1) % 2**REMEMBERED
            return True
        bit = 1 << -ahead if -ahead < REMEMBERED else 0
        if self._seen & bit:
            counts.twice += 1
            return False
        # It was counted as lost when the newer one came.
        counts.dropped -= 1 if bit and counts.dropped > 0 else 0
        counts.reordered, self._seen = counts.reordered + 1, self._seen | bit
        return False

    def _is_new(self, stamp: float, arrival: float, monotonic: float, content: object) -> bool:
        """Return True if a message without a number is newer than those before it."""
        if math.isnan(self._stamp):
            return True
        # The robot's monotonic clock decides, if it has one that runs.
        ahead = monotonic - self._monotonic
        if math.isnan(ahead) or ahead == 0:
            ahead = stamp - self._stamp
            if ahead < 0 and self._was_set_back(stamp, arrival):
                return True
        if ahead > 0 or (ahead == 0 and content != self._content):
            # Other numbers at one time: the clock stands still, which is for the rules.
            self._older = []
            return True
        if ahead == 0:
            self.counts.twice += 1
        else:
            self.counts.reordered += 1
        return False

    def _was_set_back(self, stamp: float, arrival: float) -> bool:
        """Return True if older stamps have followed each other for so long that the clock was set back."""
        if self._older and stamp <= self._older[-1][0]:
            self._older = []
        self._older = [*self._older[:1], (stamp, arrival)]
        first = self._older[0]
        if min(stamp - first[0], arrival - first[1]) < RESUMED:
            return False
        self._older = []
        return True

    def _time(self, stamp: float, arrival: float, monotonic: float, content: object) -> float:
        """Return a new state's time, and remember it; where the clock was set, its time goes on."""
        elapsed, passed, by_robot = stamp - self._stamp, arrival - self._arrival, monotonic - self._monotonic
        if math.isnan(elapsed):
            self._lead = stamp
        else:
            real = by_robot if by_robot > 0 else passed
            self._real += real
            lead, before = stamp - self._real, self._lead - DRIFT * real
            if (elapsed < 0 or lead - before > STEP) and arrival - self._set >= STEPS_APART:
                self.counts.clock_steps, self._set = self.counts.clock_steps + 1, arrival
                # From the state before, and not by the fastest message: a robot's clock may be slow for long.
                expected = self._stamp + max(real, LEAST)
                self._offset += expected - stamp
                lead = before = before + stamp - expected
            self._lead = max(lead, before)
        self._stamp, self._arrival, self._monotonic, self._content = stamp, arrival, monotonic, content
        return stamp + self._offset
