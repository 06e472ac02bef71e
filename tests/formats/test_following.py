"""Who follows, on rows whose verdict is plain to see."""

from __future__ import annotations

from dataclasses import replace

import pytest

from stiction.formats.following import BAND, DEFINITION, following, pace, row_pace
from stiction.formats.results import ResultRow

ROW = ResultRow(
    *("p", "none", 0, "mujoco", "coulomb", 0.1, "flat", "vx=0.5"), *(1.0, 0.1, 0.0, 4.0, None, 1.0, 20.0, 0.8, 0.0, 8)
)


def seed(number: int, forward: float, backward: float, fall_rate: float = 0.0) -> list[ResultRow]:
    """Both directions of one training seed."""
    speeds = (("vx=0.5", forward), ("vx=-0.5", backward))
    own = replace(ROW, policy=f"p-s{number}", seed=number, fall_rate=fall_rate)
    return [replace(own, command=command, speed_ratio=ratio) for command, ratio in speeds]


def test_a_ratio_is_too_slow_follows_or_is_too_fast() -> None:
    """The ends of the band belong to it; a robot that stands, or walks the other way, is too slow."""
    assert [pace(ratio) for ratio in (-0.5, 0.0, 0.799, 0.8, 1.0, 1.2, 1.201)] == [
        *("too slow", "too slow", "too slow", "follows", "follows", "follows", "too fast")
    ]
    assert BAND == "80 to 120 %" and BAND in DEFINITION


def test_who_fell_does_not_follow_at_whatever_speed() -> None:
    """One walk of twenty is enough; a command without a speed has no pace."""
    assert row_pace(ROW) == "follows" and row_pace(replace(ROW, fall_rate=0.05)) == "fell"
    assert row_pace(replace(ROW, speed_ratio=None)) is None


def test_one_seed_of_five_that_is_too_fast_is_one_too_many() -> None:
    """Four in the band, one at 1.25 forward: |1 - r| is 0.1, 0.1, 0, 0, 0, 0, 0.2, 0.2, 0.25, 0.05, of ten 0.09."""
    rows = [*seed(0, 1.1, 0.9), *seed(1, 1, 1), *seed(2, 1, 1), *seed(3, 1.2, 0.8), *seed(4, 1.25, 1.05)]
    (found,) = following(rows, lambda row: row.method)
    assert (found.seeds, found.follow, found.too_slow, found.too_fast, found.fell) == (5, 4, 0, 1, 0)
    assert not found.every_seed and found.text == "4 of 5, 1 too fast"
    assert found.deviation == pytest.approx(0.09)
    assert found.each == "1.10/0.90 1.00/1.00 1.00/1.00 1.20/0.80 1.25/1.05"
    assert following(rows[:8], lambda row: row.method)[0].every_seed


def test_one_direction_only_is_not_following() -> None:
    """Forward at the command and backward at half of it; at 1.3 and at 0.7: that seed is both too fast and too slow."""
    (found,) = following([*seed(0, 1.0, 0.5), *seed(1, 1.3, 0.7)], lambda row: row.method)
    assert (found.follow, found.too_slow, found.too_fast) == (0, 2, 1)
    assert found.text == "0 of 2, 2 too slow, 1 too fast"


def test_a_seed_that_walked_one_way_is_not_counted() -> None:
    """Half a walk says nothing of the other half."""
    (found,) = following([*seed(0, 1.0, 1.0), seed(1, 1.0, 1.0)[0]], lambda row: row.method)
    assert (found.seeds, found.text) == (1, "1 of 1")
    assert following(seed(1, 1.0, 1.0)[:1], lambda row: row.method) == []


def test_a_fall_is_told_apart_from_speed() -> None:
    """A seed within the band in whose walks somebody fell."""
    (found,) = following([*seed(0, 1.0, 1.0), *seed(1, 1.0, 1.0, fall_rate=0.1)], lambda row: row.method)
    assert (found.follow, found.fell, found.text) == (1, 1, "1 of 2, 1 fell")


def test_cells_are_apart_and_stairs_are_none() -> None:
    """Another level, another engine and another way are other cells; what is walked over stairs is another question."""
    other = [
        *(replace(row, friction_level=0.2) for row in seed(0, 1, 1)),
        *(replace(row, engine="physx") for row in seed(0, 1, 1)),
        *(replace(row, method="direct") for row in seed(0, 1, 1)),
        *(replace(row, terrain="stairs=0.1") for row in seed(0, 1, 1)),
    ]
    found = following([*seed(0, 1, 1), *other], lambda row: row.method)
    cells = [(one.method, one.engine, one.friction_level) for one in found]
    assert cells == [
        ("none", "mujoco", 0.1),
        ("none", "mujoco", 0.2),
        ("none", "physx", 0.1),
        ("direct", "mujoco", 0.1),
    ]
