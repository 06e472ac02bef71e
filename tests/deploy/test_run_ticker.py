"""Deadlines that neither drift nor burst, and quantiles of lateness."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.deploy.runtime.ticker import Histogram, Ticker


class Clock:
    """A clock that stands until somebody sleeps, or works."""

    def __init__(self) -> None:
        """Begin somewhere, as monotonic clocks do."""
        self.now = 1234.5

    def time(self) -> float:
        """Return the time [s]."""
        return self.now

    def sleep(self, seconds: float) -> None:
        """Oversleep a little, as operating systems do."""
        assert seconds > 0
        self.now += seconds + 1e-4


def test_work_and_oversleeping_do_not_add_up() -> None:
    """A loop that sleeps a period after its work runs slower than it says."""
    clock = Clock()
    ticker = Ticker(0.02, clock.time, clock.sleep)
    wakes = []
    for _ in range(500):
        late, skipped = ticker.wait()
        assert (late, skipped) == (pytest.approx(1e-4, abs=1e-9), 0)
        wakes.append(clock.now)
        clock.now += 0.012
    np.testing.assert_allclose(np.diff(wakes), 0.02, atol=1e-9)


def test_missed_deadlines_are_skipped_for_good() -> None:
    """After a pause the loop bursts, with targets for a robot of the past."""
    clock = Clock()
    ticker = Ticker(0.02, clock.time, clock.sleep)
    ticker.wait()
    begin = clock.now
    clock.now += 0.095
    late, skipped = ticker.wait()
    # Of the deadlines at 20, 40, 60 and 80 ms, only the last is less than a period ago.
    assert skipped == 3 and late == pytest.approx(0.0151, abs=1e-6)
    late, skipped = ticker.wait()
    assert skipped == 0 and clock.now - begin == pytest.approx(0.1, abs=1e-3)


def test_a_rehearsal_moves_no_deadline() -> None:
    """A rehearsal leaves the deadlines of the control steps unchanged."""
    clock, begun = Clock(), []

    def look() -> float:
        clock.now += 1e-6  # Who waits awake sees time pass.
        return clock.now

    ticker = Ticker(0.02, look, clock.sleep)

    def rehearse() -> None:
        begun.append(clock.now)
        clock.now += 3e-4

    start = clock.now
    late, skipped = ticker.wait(rehearse)
    assert begun == [pytest.approx(start + 0.0191, abs=1e-5)]
    assert 0 <= late < 5e-6 and skipped == 0 and clock.now == pytest.approx(start + 0.02, abs=1e-5)
    clock.now = start + 0.0395  # Half a millisecond is left.
    assert ticker.wait(rehearse) == (pytest.approx(1e-4, abs=1e-5), 0)
    assert len(begun) == 1


def test_quantiles_are_those_of_the_times_to_a_bin() -> None:
    """A report says a lateness that was not."""
    histogram, times = Histogram(), np.random.default_rng(0).exponential(1e-3, 20_000)
    for time in times:
        histogram.add(time)
    for share in (0.5, 0.99, 0.999):
        # The smallest of the times that at least this share does not exceed.
        exact = np.sort(times)[int(np.ceil(share * len(times))) - 1]
        assert exact <= histogram.quantile(share) + 1e-12 <= exact + Histogram.WIDTH + 1e-12
    assert histogram.largest == times.max()
    assert histogram.milliseconds()["max"] == pytest.approx(1e3 * times.max(), abs=1e-3)
    assert Histogram().quantile(0.99) == 0.0
    far = Histogram()
    far.add(3.0)
    assert far.quantile(0.5) == 3.0
