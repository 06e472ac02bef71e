"""Detection of new states among repeated and late ones, with the time of measurement on a monotonic clock.

A network delivers a state twice, behind a newer one, or not at all, and a robot's clock is set while it walks. None of
that stops a run by itself: a state that is not new is counted and ignored, and where the clock was set the time goes
on as if it had not been: by the robot's ticks, else by the numbers of its messages, else as our own clock does. Lasting
faults are for the supervisor: `stale state`, `lossy link`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

STEP = 0.005
"""Lead of a stamp, over what other clocks say, above which the clock counts as set [s]. A joint at 20 rad/s moves by
0.1 rad in it, as much as `velocity and angle` allows."""

DRIFT = 0.001
"""Rate at which the lead of the fastest message is forgotten [s/s]: clocks drift apart, by less than that."""

LEAST = 1e-3
"""Shortest time between two states, where stamps do not say it [s]."""

FINE = 1e-3
"""Largest distance between stamps and the robot's ticks [s]: the resolution of ticks."""

STEPS_APART = 10.0
"""Shortest time between two settings of a clock [s], where a robot has no ticks. A clock that jumps more often is
broken, and its jumps are left in: `time jump`, or `time stands still`."""

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
    """Number of times that the robot's clock was set, or left its ticks."""

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

    def __init__(self, dropped: float = 0, period: float = math.nan) -> None:
        """Start without messages.

        dropped: NaN where messages have no numbers, by which lost ones could be counted; period: time between two
        numbers [s]; NaN: unknown.
        """
        self._dropped, self._period = dropped, period
        self._number = self._seen = 0
        self._stamp = self._arrival = self._monotonic = self._time = self._ticked = math.nan
        self._content: object = None
        self._offset, self._fastest = 0.0, -math.inf
        self._older: list[tuple[float, float]] = []
        self.begin()

    def begin(self) -> None:
        """Count from here on: a loss, or a clock that is set, before a run is no fault of it."""
        self.counts, self._set = Counts(dropped=self._dropped), -math.inf

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
        counted = math.nan if number is None else (number - self._number) * self._period
        if not (self._is_new(stamp, arrival, monotonic, content) if number is None else self._is_next(number)):
            return None
        self.counts.new += 1
        self._time = self._measured(stamp, arrival, counted, monotonic)
        self._stamp, self._arrival, self._monotonic, self._content = stamp, arrival, monotonic, content
        return self._time

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
        again = ahead == 0 and content == self._content
        if ahead > 0 or (ahead == 0 and not again and not self._older):
            # Other numbers at one time: the clock stands still, which is for the rules; not where it was just set back.
            self._older = []
            return True
        if again:
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

    def _measured(self, stamp: float, arrival: float, counted: float, monotonic: float) -> float:
        """Return a new state's time; where the clock was set, the time goes on.

        counted: time since the state before, by their numbers [s].
        """
        at, passed, ticks = stamp + self._offset, arrival - self._arrival, monotonic - self._monotonic
        fastest, ticked = self._fastest - DRIFT * passed, self._ticked + ticks
        if math.isnan(self._time):
            fastest = at - arrival
        elif ticked > self._ticked:
            if abs(at - ticked) > STEP:
                at, self.counts.clock_steps = ticked, self.counts.clock_steps + 1
            at = min(max(at, ticked - FINE, self._time + LEAST), ticked + FINE)
        elif arrival - self._set >= STEPS_APART:
            elapsed, ahead = at - self._time, at - arrival - fastest
            # A robot that pauses is late by its numbers alone, a message that came fast by our clock alone.
            ahead = ahead if math.isnan(counted) else min(ahead, elapsed - counted)
            if elapsed < 0 or ahead > STEP:
                self.counts.clock_steps, self._set = self.counts.clock_steps + 1, arrival
                # From the state before, and not by the fastest message: a robot's clock may be slow for long.
                at = self._time + max(passed if math.isnan(counted) else counted, LEAST)
        # Ticks that stand still, as a simulator's may between its steps, are no clock.
        self._ticked = ticked if ticked > self._ticked else math.nan if ticks == 0 else at
        self._offset, self._fastest = at - stamp, max(at - arrival, fastest)
        return at
