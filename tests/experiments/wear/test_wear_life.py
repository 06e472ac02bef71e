"""When a lifetime ends and when its monitor noticed; the walks are made by hand."""

from __future__ import annotations

from dataclasses import asdict, replace
from math import exp, log, sqrt

import numpy as np
import pytest

from stiction_experiments.wear.lifetimes import (
    Ending,
    Lifetime,
    Reading,
    Seen,
    Window,
    control,
    ending,
    first_grown,
    first_notice,
    groups,
    judge_again,
    judge_robot,
    over_seeds,
    ratios,
)

WALK = {"policy": "p", "friction_level": "0.1", "robot": 1000, "steady": None, "command": "vx=0.5"}
WHAT = WALK | {"method": "none", "engine": "physx"}
BOTH = WHAT | {"command": "vx=0.5 vx=-0.5"}


def windows(*ratio: float, command: str = "vx=0.5") -> list[Window]:
    """Windows of 10 s, the wear doubling from one to the next, from 1 on."""
    walk = WALK | {"command": command}
    return [Window(**walk, time=10.0 * (at + 1), factor=2.0**at, ratio=one) for at, one in enumerate(ratio)]


def reading(time: float, low: float | None, unusual: bool = False, true: float = 0.1) -> Reading:
    """A reading whose interval is 0.02 wide; `low` None: no estimate."""
    ends = (None, None, None) if low is None else (low + 0.01, low, low + 0.02)
    return Reading(
        **WALK, target="level", time=time, factor=2.0 ** (time / 10 - 1), true=true, unusual=unusual, **zipped(ends)
    )


def zipped(ends: tuple[float | None, ...]) -> dict[str, float | None]:
    """An estimate with its interval."""
    return dict(zip(("estimate", "low", "high"), ends, strict=True))


def test_windows_by_hand() -> None:
    """Ten steps of 0.1 s, the first two left out, windows of 0.4 s every 0.2 s: 2..5, 4..7, 6..9."""
    starts = ratios(np.arange(10.0), 0.1, 0.2, 0.4, 0.2)
    np.testing.assert_allclose(starts, [(0.6, 3.5), (0.8, 5.5), (1.0, 7.5)])
    assert ratios(np.arange(5.0), 0.1, 0.2, 0.4, 0.2) == []


def test_a_lifetime_ends_where_the_speed_is_too_low_for_good() -> None:
    """A dip that the robot recovers from is no end, and a walk that stays above has none."""
    assert ending(windows(1.0, 0.7, 0.9, 0.79, 0.5), None) == Ending("too slow", 8.0, 40.0)
    assert ending(windows(1.0, 0.7, 0.8), None) == Ending("alive")
    assert ending(windows(0.7, 0.6), None) == Ending("too slow from the start")


def test_too_fast_is_not_following_and_is_no_too_slow() -> None:
    """Never under 120 %: it never followed. Too fast at first: it begins to at x4, and ends as others do."""
    assert ending(windows(1.5, 1.3, 1.21), None) == Ending("too fast from the start")
    assert ending(windows(1.5, 1.3, 1.2), None) == Ending("alive")
    assert ending(windows(1.5, 1.3, 1.1, 0.7), None) == Ending("too slow", 8.0, 40.0)
    assert ending(windows(1.0, 1.3, 1.4), None) == Ending("too fast", 2.0, 20.0)
    rows = [
        judge_robot(WHAT, [Seen(windows(*ratio), [], None)], False)
        for ratio in ((1.5, 1.3, 1.1), (1.0, 0.9), (1.5, 1.3), (0.5,))
    ]
    assert [row.begin for row in rows] == [4.0, None, None, None]
    (group,) = groups(rows)
    assert group["first"] == {"too fast": 2, "follows": 1, "too slow": 1} and group["begin"] == pytest.approx(4.0)
    assert group["ends"] == {"alive": 2, "too fast from the start": 1, "too slow from the start": 1}


def test_a_robot_follows_where_it_follows_both_ways() -> None:
    """Forward to x8, backward at x2 alone, too fast before and too slow after: the worse way counts."""
    both = [Seen(windows(1.0, 0.9, 1.1, 0.8), []), Seen(windows(1.3, 1.15, 0.7, 0.6), [])]
    row = judge_robot(WHAT, both, False)
    assert (row.begin, row.end, row.factor, row.time) == (2.0, "too slow", 4.0, 30.0)
    assert (row.first_ratio, row.last_ratio) == (1.3, 0.6)
    apart = [Seen(windows(1.0, 0.7), []), Seen(windows(1.3, 1.0), [])]
    assert judge_robot(WHAT, apart, False).end == "too fast from the start"
    fallen = [Seen(windows(1.0, 1.0, 1.0), []), Seen(windows(1.0), [], (15.0, 1.4))]
    assert (judge_robot(WHAT, fallen, False).end, judge_robot(WHAT, fallen, False).factor) == ("fell", 1.4)


def test_what_was_noticed_first_of_both_ways_counts() -> None:
    """Unusual at 30 s forward and at 20 s backward; at once is what a walk's own first reading says."""
    forward = Seen(windows(1.0, 1.0, 1.0), [reading(10, 0.05), reading(20, 0.06), reading(30, 0.08, unusual=True)])
    backward = Seen(windows(1.0, 1.0, 0.5), [reading(10, 0.05), reading(20, 0.08, unusual=True)])
    row = judge_robot(WHAT, [forward, backward], True)
    assert (row.unusual, row.unusual_factor, row.grown, row.grown_factor) == ("before", 2.0, "before", 2.0)
    at_once = replace(backward, readings=[reading(10, 0.05, unusual=True)])
    assert judge_robot(WHAT, [forward, at_once], True).unusual == "at once"


def test_walks_are_judged_again_by_what_was_seen_of_them() -> None:
    """Rows of before, under an older name of the same end, and a fall: the windows decide, and the fall is kept."""
    before = asdict(judge_robot(WHAT, [Seen(windows(1.5, 1.1, 0.5), [], None)], True)) | {"end": "slow"}
    fallen = asdict(judge_robot(WHAT | {"robot": 1001}, [Seen(windows(1.0), [], (15.0, 1.4))], False))
    seen = [*windows(1.5, 1.1, 0.5), *(replace(one, robot=1001) for one in windows(1.0))]
    first, second = judge_again([before, fallen], seen, [reading(10, 0.05), reading(20, 0.08)])
    assert (first.end, first.begin, first.factor, first.grown, first.monitored) == (
        "too slow",
        2.0,
        4.0,
        "before",
        True,
    )
    assert (second.end, second.factor, second.time, second.monitored) == ("fell", 1.4, 15.0, False)
    # Backward it was too slow from the second window on: a robot of both ways is judged by both.
    before |= {"command": BOTH["command"]}
    (both,) = judge_again([before], [*windows(1.5, 1.1, 0.9), *windows(1.0, 0.7, 0.5, command="vx=-0.5")], [])
    assert (both.end, both.factor, both.begin) == ("too fast from the start", None, None)


def test_a_fall_ends_a_lifetime_that_was_not_over() -> None:
    """A fall after a window that is too slow does not count; a fall before the first window does."""
    assert ending(windows(1.0, 0.9), (23.0, 2.9)) == Ending("fell", 2.9, 23.0)
    assert ending(windows(1.0, 0.9, 0.5), (33.0, 5.9)) == Ending("too slow", 4.0, 30.0)
    assert ending([], (3.0, 0.4)) == Ending("fell", 0.4, 3.0)


def test_growth_is_detected_by_intervals_that_do_not_meet() -> None:
    """0.05 to 0.07 at first: 0.06 to 0.08 may be the same friction, 0.08 to 0.10 is not."""
    readings = [reading(10, 0.05), reading(20, 0.06), reading(30, 0.08), reading(40, 0.09)]
    assert first_grown(readings) is readings[2]
    assert first_grown(readings[:2]) is None and first_grown([]) is None and first_grown([reading(10, None)]) is None


def noticed(seen: Reading | None, readings: list[Reading], ended: Ending) -> str:
    """When the only walk's reading came."""
    return first_notice([Seen([], readings)], [seen], ended)[1]


def test_a_notice_counts_when_it_came_in_time_and_not_at_once() -> None:
    """A monitor that finds the unworn robot unusual has noticed no wear."""
    readings = [reading(10, 0.05), reading(20, 0.06, unusual=True), reading(30, 0.08)]
    over = Ending("too slow", 2.0, 20.0)
    assert [noticed(one, readings, over) for one in (*readings, None)] == ["at once", "before", "after", "never"]
    assert noticed(readings[2], readings, Ending("alive")) == "before"


def test_whatever_is_noticed_where_nothing_grew_is_a_false_alarm() -> None:
    """Unusual are three of four robots, at once, later, and after a fall; growth is detected in one: 3 and 1 of 4.

    Wilson, z² = 3.8415, of 3 in 4: (0.75 + 0.48018 ± 1.96 √(0.046875 + 0.060023)) / 1.96036.
    """
    quiet = [reading(10, 0.05), reading(20, 0.06)]
    heard = [
        (windows(1.0, 1.0), quiet, None),
        (windows(1.0, 1.0), [replace(quiet[0], unusual=True), quiet[1]], None),
        (windows(1.0, 1.0), [quiet[0], reading(20, 0.08, unusual=True)], None),
        (windows(1.0), [quiet[0], reading(20, 0.06, unusual=True)], (15.0, 0.3)),
    ]
    rows = [judge_robot(WHAT | {"steady": 0.3}, [Seen(*one)], True) for one in heard]
    summary = control(rows)
    assert (summary["steady"], summary["robots"], summary["read"]) == (0.3, 4, 4)
    assert summary["ends"] == {"alive": 3, "fell": 1}
    assert summary["alarms"] == {"unusual": 3, "grown": 1} and summary["at_once"] == {"unusual": 1, "grown": 0}
    half = 1.95996 * sqrt(0.046875 + 0.060023)
    ends = [(0.75 + 0.48018 - half) / 1.96036, (0.75 + 0.48018 + half) / 1.96036]
    assert summary["interval95"]["unusual"] == pytest.approx(ends, abs=1e-4)
    assert summary["interval95"]["grown"] == pytest.approx([1 - ends[1], 1 - ends[0]], abs=1e-4)


def test_walks_in_which_nothing_grew_are_controls() -> None:
    """They stand beside those, by the wear at which they stayed, and neither lengthen nor shorten a mean."""
    stayed = [replace(row, steady=at) for at in (0.3, 1.0) for row in lifetimes(9.0, None)]
    (group,) = groups(lifetimes(1.0, 4.0) + stayed)
    assert (group["robots"], group["mean"]) == (2, pytest.approx(2.0)) and group["ends"] == {"too slow": 2}
    assert [(one["steady"], one["ends"]) for one in group["controls"]] == [
        (0.3, {"too slow": 1, "alive": 1}),
        (1.0, {"too slow": 1, "alive": 1}),
    ]
    assert groups(lifetimes(1.0))[0]["controls"] == []


def test_the_row_of_a_walk() -> None:
    """Ends at x4; unusual at x8 is late, growth at x2 in time; two of three intervals hold 0.06."""
    readings = [reading(10, 0.05, true=0.06), reading(20, 0.08, true=0.09), reading(40, 0.09, unusual=True, true=0.2)]
    row = judge_robot(WHAT, [Seen(windows(1.0, 0.9, 0.7, 0.2), readings, None)], True)
    assert (row.end, row.factor, row.time, row.first_ratio, row.last_ratio) == ("too slow", 4.0, 30.0, 1.0, 0.2)
    assert (row.unusual, row.unusual_factor, row.grown, row.grown_factor) == ("after", 8.0, "before", 2.0)
    assert row.held == pytest.approx(2 / 3)
    deaf = judge_robot(WHAT, [Seen(windows(1.0), [], None)], False)
    assert (deaf.end, deaf.unusual, deaf.held, deaf.factor) == ("alive", "never", None, None)


def lifetimes(*factors: float | None, start: bool = False) -> list[Lifetime]:
    """Robots of one policy whose lifetimes ended there; None: alive, or slow from the start."""
    row = judge_robot(WHAT, [Seen(windows(1.0), [], None)], False)
    missing = "too slow from the start" if start else "alive"
    return [replace(row, robot=at, factor=one, end="too slow" if one else missing) for at, one in enumerate(factors)]


def test_the_mean_over_robots_is_of_the_logarithm() -> None:
    """x1 and x4: mean x2; with two robots t = 12.706 and the standard error of the logarithm is ln 2."""
    (group,) = groups(lifetimes(1.0, 4.0))
    assert (group["mean"], group["median"], group["robots"]) == (pytest.approx(2.0), pytest.approx(2.5), 2)
    half = 12.7062 * log(4) / sqrt(2) / sqrt(2)
    assert group["interval95"] == pytest.approx([2 * exp(-half), 2 * exp(half)], rel=1e-3)
    assert groups(lifetimes(1.0))[0]["interval95"] is None and group["held"] is None
    (heard,) = groups([replace(row, held=share) for row, share in zip(lifetimes(1.0, 4.0), (0.25, 0.75), strict=True)])
    assert heard["held"] == 0.5


def test_lifetimes_that_did_not_end_have_no_mean() -> None:
    """The mean of those that did would be too short; the median stands while the middle one is known."""
    (group,) = groups(lifetimes(1.0, 3.0, None))
    assert group["mean"] is None and group["interval95"] is None and group["median"] == 3.0
    assert group["ends"] == {"too slow": 2, "alive": 1}
    assert groups(lifetimes(1.0, None, None))[0]["median"] is None
    assert groups(lifetimes(1.0, 3.0, None, start=True))[0]["median"] == 1.0


def policy(name: str, *factors: float | None, start: bool = False) -> list[Lifetime]:
    """Return the lifetimes of one policy of two."""
    return [replace(row, policy=name) for row in lifetimes(*factors, start=start)]


def test_seeds_of_a_method_are_one_sample_each() -> None:
    """Robots of x1 and x4, mean x2, and of x8 and x8: x4 over two seeds, the logarithms ln 2 and ln 8 apart by 2 ln 2.

    Their standard error is ln 2, t = 12.706: the robots within a policy do not make it smaller.
    """
    rows, methods = policy("a", 1.0, 4.0) + policy("b", 8.0, 8.0), {"a": "none", "b": "none"}
    (method,) = over_seeds(rows, methods, (0.3, 9.0))
    assert (method["way"], method["mean"]) == ("none", pytest.approx(4.0))
    assert [one["mean"] for one in method["policies"].values()] == pytest.approx([2.0, 8.0])
    half = 12.7062 * log(2)
    assert method["interval95"] == pytest.approx([4 * exp(-half), 4 * exp(half)], rel=1e-3)
    assert method["at_least"] is None and method["at_most"] is None
    stayed = [replace(row, steady=0.3) for row in rows]
    assert over_seeds(rows + stayed, methods, (0.3, 9.0)) == [method]


def test_lifetimes_beyond_what_was_tried_bound_the_mean() -> None:
    """Alive at x9: x1 and x9 make at least x3; slow from the start at x0.25: x1 and x0.25 make at most x0.5."""
    methods = {"a": "none", "b": "none"}
    (method,) = over_seeds(policy("a", 1.0) + policy("b", None), methods, (0.25, 9.0))
    assert (method["mean"], method["interval95"], method["at_most"]) == (None, None, None)
    assert method["at_least"] == pytest.approx(3.0) and method["policies"]["b"]["alive"] == 1
    slow = policy("b", None, start=True)
    (method,) = over_seeds(policy("a", 1.0) + slow, methods, (0.25, 9.0))
    assert (method["mean"], method["interval95"], method["at_least"]) == (None, None, None)
    assert method["at_most"] == pytest.approx(0.5) and method["policies"]["b"]["never"] == 1
    (method,) = over_seeds(policy("a", None) + slow, methods, (0.25, 9.0))
    assert [method[name] for name in ("mean", "at_least", "at_most")] == [None] * 3
