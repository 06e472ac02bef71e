"""Seeds that follow, on rows whose verdict is plain to see."""

from __future__ import annotations

from dataclasses import replace

import pytest

from stiction.files.results import ResultRow, ends_of
from stiction_experiments.lab.straight import BAND, DEFINITION, following, pace

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


def test_one_seed_of_five_that_is_too_fast_is_one_too_many() -> None:
    """Four in the band, one at 1.25 forward: |1 - r| is 0.1, 0.1, 0, 0, 0, 0, 0.2, 0.2, 0.25, 0.05, of ten 0.09."""
    rows = [*seed(0, 1.1, 0.9), *seed(1, 1, 1), *seed(2, 1, 1), *seed(3, 1.2, 0.8), *seed(4, 1.25, 1.05)]
    (cell,) = following(rows, lambda row: row.method)
    assert (cell.seeds, cell.follow, cell.too_slow, cell.too_fast, cell.fell) == (5, 4, 0, 1, 0)
    assert not cell.every_seed and cell.text == "4 of 5, 1 too fast"
    assert cell.deviation == pytest.approx(0.09)
    assert cell.each == "1.10/0.90 1.00/1.00 1.00/1.00 1.20/0.80 1.25/1.05"
    assert following(rows[:8], lambda row: row.method)[0].every_seed


def test_one_direction_only_is_not_following() -> None:
    """Forward at the command and backward at half of it; at 1.3 and at 0.7: that seed is both too fast and too slow."""
    (cell,) = following([*seed(0, 1.0, 0.5), *seed(1, 1.3, 0.7)], lambda row: row.method)
    assert (cell.follow, cell.too_slow, cell.too_fast) == (0, 2, 1)
    assert cell.text == "0 of 2, 2 too slow, 1 too fast"


def test_each_virtual_robot_is_judged() -> None:
    """A policy at 0.6 on one robot and at 1.4 on the other is at 1.0 in the mean, and follows on neither.

    Forward 0.6 and 1.4 are 0.4 off, backward 0.9 and 1.1 are 0.1 off: 0.25 of the worst robots.
    """
    forward, backward = seed(0, 1.0, 1.0)
    rows = [replace(forward, **ends_of((0.6, 1.4))), replace(backward, **ends_of((1.1, None, 0.9)))]
    (cell,) = following(rows, lambda row: row.method)
    assert (cell.follow, cell.too_slow, cell.too_fast) == (0, 1, 1)
    assert cell.each == "0.60..1.40/0.90..1.10" and cell.deviation == pytest.approx(0.25)
    within = [replace(forward, **ends_of((0.8, 1.1))), replace(backward, **ends_of((1.2, 0.9)))]
    assert following(within, lambda row: row.method)[0].every_seed


def test_cells_are_apart_and_stairs_are_none() -> None:
    """Another level, another engine and another way are other cells; what is walked over stairs is another question."""
    other = [
        *(replace(row, friction_level=0.2) for row in seed(0, 1, 1)),
        *(replace(row, engine="physx") for row in seed(0, 1, 1)),
        *(replace(row, method="direct") for row in seed(0, 1, 1)),
        *(replace(row, terrain="stairs=0.1") for row in seed(0, 1, 1)),
    ]
    apart = following([*seed(0, 1, 1), *other], lambda row: row.method)
    cells = [(one.method, one.engine, one.friction_level) for one in apart]
    assert cells == [
        ("none", "mujoco", 0.1),
        ("none", "mujoco", 0.2),
        ("none", "physx", 0.1),
        ("direct", "mujoco", 0.1),
    ]
