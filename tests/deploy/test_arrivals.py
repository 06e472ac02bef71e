"""Recognition of new states, and a clock that is never set, with times made by hand."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from stiction.deploy.transports.arrivals import REMEMBERED, RESUMED, STEP, STEPS_APART, Arrivals

PERIOD = 0.002


def numbered(*numbers: int) -> tuple[list[int], dict[str, float]]:
    """Return the numbers that are taken, as they come, in time or later, and the counts."""
    arrivals = Arrivals()
    taken = [
        n
        for place, n in enumerate(numbers)
        if arrivals.take(PERIOD * n, 5.0 + PERIOD * max(numbers[: place + 1]), n) == pytest.approx(PERIOD * n)
    ]
    return taken, {name: count for name, count in arrivals.counts.reported().items() if count}


@pytest.mark.parametrize(
    ("numbers", "taken", "counted"),
    [
        ((1, 2, 3), [1, 2, 3], {}),
        ((7, 8), [7, 8], {}),
        ((1, 2, 2, 3), [1, 2, 3], {"twice": 1}),
        ((1, 2, 1, 3, 2), [1, 2, 3], {"twice": 2}),
        ((1, 3, 2, 4), [1, 3, 4], {"reordered": 1}),
        ((1, 3, 2, 2, 4), [1, 3, 4], {"reordered": 1, "twice": 1}),
        ((1, 4, 5), [1, 4, 5], {"dropped": 2}),
        ((1, 4, 3, 5), [1, 4, 5], {"dropped": 1, "reordered": 1}),
        ((1, 1 + 3 * REMEMBERED, 2), [1, 1 + 3 * REMEMBERED], {"dropped": 3 * REMEMBERED - 1, "reordered": 1}),
        ((100, 1, 2, 3), [100], {"reordered": 3}),
        ((2**64 - 1, 0), [2**64 - 1], {"reordered": 1}),
    ],
)
def test_by_numbers_what_is_not_new_is_counted_and_never_taken(
    numbers: tuple[int, ...], taken: list[int], counted: dict[str, float]
) -> None:
    """A late message is not counted as lost; a robot whose numbers begin again is the same robot."""
    assert numbered(*numbers) == (taken, counted)


@pytest.mark.parametrize("set_by", [-3600.0, -0.011, 0.3, 3600.0])
def test_a_clock_that_is_set_once_does_not_move_the_time(set_by: float) -> None:
    """By numbers, at once: time goes on by as much as passed here, also where several are read together then."""
    arrivals, together = Arrivals(), Arrivals()
    for n in range(1, 101):
        stamp = PERIOD * n + (set_by if n >= 50 else 0.0)
        assert arrivals.take(stamp, PERIOD * n, n) == pytest.approx(PERIOD * n, abs=1e-9)
        # Five at a time, when the last of them has come.
        at = together.take(stamp, PERIOD * 5 * math.ceil(n / 5), n)
        assert at is not None and abs(at - PERIOD * n) <= PERIOD
    assert arrivals.counts.clock_steps == together.counts.clock_steps == 1


def test_a_clock_that_is_slow_and_set_back_goes_on_from_where_it_was() -> None:
    """A simulated robot that is slower than time for half a minute does not jump by what it is behind."""
    arrivals = Arrivals()
    times = [arrivals.take(PERIOD * n - (5.0 if n > 300 else 0.0), 0.1 * n, n) for n in range(1, 400)]
    jumps = [now - before for before, now in pairwise(times)]  # type: ignore[operator]
    # In the step as much as passed here.
    assert jumps.pop(299) == pytest.approx(0.1) and jumps == pytest.approx([PERIOD] * len(jumps))
    assert arrivals.counts.clock_steps == 1


def test_a_clock_that_is_set_again_and_again_is_left_as_it_is() -> None:
    """A second step within ten seconds stays in the time, for the rules; one after that does not."""
    arrivals, times = Arrivals(), []
    steps = {100: 5.0, 200: 7.0, 200 + round(STEPS_APART / PERIOD): -3.0}
    for n in range(1, 201 + max(steps)):
        set_by = sum(by for at, by in steps.items() if n >= at)
        times.append(arrivals.take(PERIOD * n + set_by, PERIOD * n, n))
    jumps = [now - before for before, now in pairwise(times)]  # type: ignore[operator]
    assert arrivals.counts.clock_steps == 2 and jumps.pop(198) == pytest.approx(7.0 + PERIOD)
    assert jumps == pytest.approx([PERIOD] * len(jumps))


def test_milliseconds_for_seconds_and_a_clock_that_stands_still_stay_what_they_are() -> None:
    """One jump may be a clock that is set; from the second on it is what it looks like."""
    arrivals, still = Arrivals(), Arrivals()
    times = [arrivals.take(1e3 * PERIOD * n, PERIOD * n, n) for n in range(1, 5)]
    assert all(then - before == pytest.approx(2.0) for before, then in pairwise(times[1:]))  # type: ignore[operator]
    assert [still.take(3.0, PERIOD * n, n) for n in range(1, 4)] == [3.0, 3.0, 3.0]


def test_a_pause_of_the_network_is_no_set_clock() -> None:
    """A second without states, and states that waited together, keep their stamps; a step below the limit does too."""
    arrivals = Arrivals()
    for stamp, arrival in ((0.0, 0.0), (1.0, 1.0), (1.002, 1.3), (1.004, 1.3), (1.3 + 0.9 * STEP, 1.3)):
        arrivals.take(stamp, arrival)
    assert arrivals.counts.clock_steps == 0
    for wrong in (math.nan, math.inf):
        assert not math.isfinite(arrivals.take(wrong, 1.4))  # type: ignore[arg-type]
    assert arrivals.take(1.4, 1.402) == 1.4


def test_without_numbers_stamps_and_contents_decide() -> None:
    """The same again is twice; other numbers at one time are the rules' matter; an older one is never taken."""
    arrivals = Arrivals(math.nan)
    assert arrivals.take(1.0, 0.0, content=b"a") == 1.0
    assert arrivals.take(1.0, 0.001, content=b"a") is None
    assert arrivals.take(1.0, 0.001, content=b"b") == 1.0
    assert arrivals.take(0.9, 0.002, content=b"c") is None
    assert arrivals.take(1.002, 0.002, content=b"d") == 1.002
    counts = arrivals.counts
    assert (counts.twice, counts.reordered, counts.new) == (1, 1, 3) and math.isnan(counts.dropped)
    assert counts.share == (2, 5)


def test_a_clock_that_is_set_back_is_told_from_states_that_come_late() -> None:
    """Late ones come at once, or end with a newer one; those of a set clock follow each other as time does."""
    arrivals = Arrivals()
    assert arrivals.take(10.0, 0.0) == 10.0
    # Ten that were held up come together, each newer than the one before it.
    assert not any(arrivals.take(9.9 + PERIOD * n, 0.001) for n in range(10))
    assert arrivals.take(10.002, 0.002) == 10.002
    # Set back by an hour: those of the first 5 ms are ignored, then the time goes on.
    came = [arrivals.take(10.002 - 3600 + PERIOD * n, 0.002 + PERIOD * n) for n in range(1, 20)]
    ignored = next(n for n, at in enumerate(came) if at is not None)
    assert ignored == math.ceil(RESUMED / PERIOD)
    for n, at in enumerate(came[ignored:], start=ignored + 1):
        assert at == pytest.approx(10.002 + PERIOD * n)
    assert arrivals.counts.clock_steps == 1


def test_a_robot_s_own_ticks_decide_where_it_has_them() -> None:
    """With ticks of a millisecond a set clock costs no state, an older tick is never taken, and stamps stay as fine."""
    arrivals = Arrivals()

    def take(n: int, set_by: float, arrival: float) -> float | None:
        return arrivals.take(PERIOD * n + 1e-4 * (n % 3) + set_by, arrival, monotonic=1e-3 * round(2 * n), content=n)

    # None has come for a second, and the clock was set back by as much meanwhile.
    assert take(1, 0.0, 0.0) == pytest.approx(0.0021)
    assert take(501, -1.0, 1.0) == pytest.approx(0.0021 + 1.0)
    assert take(502, -1.0, 1.0) == pytest.approx(0.0021 + 1.0 + PERIOD + 1e-4)
    assert take(500, 50.0, 1.001) is None and take(502, -1.0, 1.001) is None
    counts = arrivals.counts
    assert (counts.clock_steps, counts.reordered, counts.twice) == (1, 1, 1)
