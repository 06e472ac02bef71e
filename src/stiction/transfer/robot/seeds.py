"""Which virtual robots are evidence: those that nobody looked at while robots and methods were made.

A method that was tuned on a robot fits that robot. So seeds are parted once, by a number: below it they are for making
and tuning, from it on for results. Of those below, 0 to 7 and 101 were looked at while virtual robots were made.
"""

from __future__ import annotations

from collections.abc import Iterable

FIRST_REPORTED = 1000
"""Seed of the first virtual robot that is kept for results."""


def reported(count: int) -> tuple[int, ...]:
    """Return the seeds of the first `count` virtual robots that are kept for results."""
    return tuple(range(FIRST_REPORTED, FIRST_REPORTED + count))


def warnings_on(seeds: Iterable[int]) -> list[str]:
    """Return what a page and a terminal say of results on robots that are there for tuning: a sentence, or none.

    They are not refused: who makes a method has to walk on such robots.
    """
    tuned = [str(seed) for seed in seeds if seed < FIRST_REPORTED]
    if not tuned:
        return []
    return [
        f"Exploratory: virtual robots with seeds below {FIRST_REPORTED} ({', '.join(tuned)}) are there for making and "
        "tuning methods; results on them are no evidence."
    ]
