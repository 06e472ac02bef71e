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


SIZES = (0.011, 0.015, 0.02, 0.03, 0.045, 0.06, 0.3, 3600.0)


@pytest.mark.parametrize("set_by", [sign * size for size in SIZES for sign in (1, -1)])
@pytest.mark.parametrize("source", ["ticks", "numbers", "numbers and period", "arrival"])
def test_a_clock_that_is_set_once_does_not_move_the_time(source: str, set_by: float) -> None:
    """Time goes on by as much as passed, by ticks or numbers also where several states are read together then."""
    arrivals, together = (Arrivals(period=PERIOD if source == "numbers and period" else math.nan) for _ in range(2))
    for n in range(1, 101):
        stamp, number = PERIOD * n + (set_by if n >= 50 else 0.0), n if source.startswith("numbers") else None
        ticks = 1e-3 * round(2 * n) if source == "ticks" else math.nan
        at = arrivals.take(stamp, PERIOD * n, number, ticks, n)
        # Without ticks and numbers the first states of a clock that was set back may be late ones.
        if at is not None or source != "arrival" or set_by > 0 or not 50 <= n < 54:
            assert at == pytest.approx(PERIOD * n, abs=1e-9)
        # Five at a time, when the last of them has come.
        at = together.take(stamp, PERIOD * 5 * math.ceil(n / 5), number, ticks, n)
        near = PERIOD if source == "numbers" else 1e-9
        assert source == "arrival" or at == pytest.approx(PERIOD * n, abs=near)
    assert arrivals.counts.clock_steps == together.counts.clock_steps == 1


def test_a_clock_that_is_set_is_known_beside_one_that_is_slow() -> None:
    """Behind by 20 ms after 100 s, a clock is set by 15 ms: the time goes on."""
    arrivals = Arrivals()
    times = [arrivals.take(0.01 * n * (1 - 2e-4) + 0.015 * (n > 10_000), 0.01 * n) for n in range(10_003)]
    assert times[-1] - times[-4] == pytest.approx(0.03, abs=1e-4)  # type: ignore[operator]


def test_by_ticks_a_clock_may_be_set_as_often_as_it_likes() -> None:
    """Ticks carry the time through two steps within two seconds, and through stamps that come late for a while."""
    arrivals = Arrivals()
    steps = {500: 0.3, 1500: -0.5, 1510: 0.02, 1520: -0.015, 1530: 0.004}
    for n in range(1, 2001):
        stamp = PERIOD * n + sum(by for at, by in steps.items() if n >= at)
        at = arrivals.take(stamp, PERIOD * n, monotonic=1e-3 * round(2 * n), content=n)
        assert at == pytest.approx(PERIOD * n, abs=1.001e-3)
    assert arrivals.counts.clock_steps == 4


def test_stamps_that_leave_the_ticks_never_stand_still() -> None:
    """Written 4 or 20 ms late, or by a clock that is slow or fast: two states stay 1 ms apart, and near the ticks."""
    for rate, late in ((0.9, 0.0), (1.0, 0.004), (1.0, 0.02), (1.1, 0.004)):
        arrivals, before = Arrivals(), 0.0
        for n in range(1, 1001):
            stamp = rate * PERIOD * n + late * (n % 3 == 0)
            at = arrivals.take(stamp, PERIOD * n, monotonic=1e-3 * round(2 * n), content=n)
            assert at == pytest.approx(PERIOD * n, abs=2e-3) and at - before > 0.99e-3
            before = at


def test_ticks_that_advance_in_steps_of_a_simulator_are_no_clock() -> None:
    """A count that stands still for five states of six, or begins late, leaves the time to the stamps."""
    arrivals = Arrivals()
    for n in range(1, 1001):
        ticks = 0.0 if n < 500 else 0.012 * (n // 6)
        assert arrivals.take(PERIOD * n, PERIOD * n, monotonic=ticks, content=n) == pytest.approx(PERIOD * n)
    assert arrivals.counts.clock_steps == 0


def test_a_robot_that_pauses_and_a_network_that_is_late_set_no_clock() -> None:
    """By numbers: stamp and arrival agree on a pause of 30 ms; stamp and number on messages that come fast again."""
    arrivals = Arrivals(period=PERIOD)
    for n in range(1, 2001):
        stamp = PERIOD * n + 0.03 * (n >= 100)
        at = arrivals.take(stamp, stamp + (0.03 if 300 <= n < 1900 or n < 3 else 0.0), n)
        assert at == pytest.approx(stamp)
    assert arrivals.counts.clock_steps == 0


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


def test_a_clock_that_is_set_back_to_the_same_stamp_does_not_stand_still() -> None:
    """By five periods, and the next six states come together: the one with the last stamp is not taken."""
    arrivals = Arrivals()
    arrivals.take(10.0, 0.0, content=0)
    assert [arrivals.take(10.0 + PERIOD * (n - 5), 0.012, content=n) for n in range(1, 7)] == 5 * [None] + [10.002]
    assert arrivals.counts.reordered == 5


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
