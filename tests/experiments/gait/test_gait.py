"""Gaits made by hand: a pronk, a tripod, a hop, and what lies between."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_experiments.gait.measure import correlations, events, measure_gait, one_sidedness, together_share

GROUPS = np.array([0, 1, 1, 0, 0, 1])
"""FL, FR, ML, MR, RL, RR."""

PERIOD = 0.02


def walk(first: np.ndarray, second: np.ndarray, robots: int = 1) -> np.ndarray:
    """Return contacts in which all feet of a group do the same; first, second: of the groups, bool, shape (T,)."""
    feet = np.where(GROUPS == 0, first[:, None], second[:, None])
    return np.repeat(feet[:, None], robots, axis=1)


def wave(half: int, cycles: int = 10) -> np.ndarray:
    """Return `half` steps on the ground and `half` off it, in turn."""
    return np.tile(np.repeat([True, False], half), cycles)


def measure(contact: np.ndarray):
    """Measure contacts of robots that move all the time."""
    return measure_gait(contact, np.ones(contact.shape[:2], bool), GROUPS, PERIOD)


def test_a_tripod() -> None:
    """Half strides of 0.2 s: each group half of the time, 2.5 strides a second, no two groups together."""
    gait = measure(walk(wave(10), ~wave(10)))
    assert gait.name == "tripod"
    assert (gait.first_group_share, gait.second_group_share) == (0.5, 0.5)
    assert (gait.tripod_share, gait.flight_share, gait.all_feet_share) == (1.0, 0.0, 0.0)
    assert (gait.within_groups, gait.across_groups) == pytest.approx((1.0, -1.0))
    assert (gait.together_share, gait.one_sidedness) == (0.0, 0.0)
    assert gait.duty_factor == (0.5,) * 6
    # 10 cycles in 4 s; those that begin on the ground are not seen to touch down the first time.
    np.testing.assert_allclose(gait.stride_frequency, np.where(GROUPS == 0, 9, 10) / 4.0)


def test_a_pronk() -> None:
    """All six together: half of the time in flight, half on all feet, every event with all feet."""
    gait = measure(walk(wave(10), wave(10)))
    assert gait.name == "pronk"
    assert (gait.tripod_share, gait.flight_share, gait.all_feet_share) == (0.0, 0.5, 0.5)
    assert (gait.within_groups, gait.across_groups) == pytest.approx((1.0, 1.0))
    assert gait.together_share == 1.0


def test_standing_on_all_feet_is_no_pronk() -> None:
    """A robot that slides on six feet never leaves the ground; it has no events, and is not called a pronk."""
    gait = measure(walk(np.ones(100, bool), np.ones(100, bool)))
    assert (gait.all_feet_share, gait.together_share, gait.name) == (1.0, None, "none of these")
    assert (gait.within_groups, gait.across_groups) == (None, None)


def test_a_hop_on_one_group() -> None:
    """Three legs hop and three are held up: tripod share alone would praise it."""
    gait = measure(walk(wave(10), np.zeros(200, bool)))
    assert gait.name == "hop on one group"
    assert (gait.first_group_share, gait.second_group_share) == (0.5, 0.0)
    assert gait.one_sidedness == 1.0


def test_one_sidedness_by_hand() -> None:
    """Three quarters against one quarter is 0.5; windows in which sides change do not cancel either."""
    contact = walk(np.array([1, 1, 1, 0] * 4, bool), np.array([0, 0, 0, 1] * 4, bool))
    moving = np.ones((16, 1), bool)
    assert one_sidedness(contact, moving, GROUPS, 16) == pytest.approx(0.5)
    turns = walk(np.repeat([True, False], 8), np.repeat([False, True], 8))
    assert one_sidedness(turns, moving, GROUPS, 8) == 1.0
    assert one_sidedness(turns, moving, GROUPS, 16) == 0.0
    assert one_sidedness(np.zeros_like(turns), moving, GROUPS, 8) is None


def test_a_bounce_is_no_step() -> None:
    """Two steps off the ground are under 0.06 s, three are not."""
    contact = np.array([1, 1, 0, 0, 1, 1, 0, 0, 0, 1], bool).reshape(10, 1, 1)
    assert np.flatnonzero(events(contact, 3)).tolist() == [9]
    assert np.flatnonzero(events(contact, 2)).tolist() == [4, 9]
    assert np.flatnonzero(events(~contact, 2)).tolist() == [2, 6]


def test_together_means_all_feet_within_the_window() -> None:
    """Feet that land at steps 5, 6 and 7: within two steps of each other all share, within one only the middle one."""
    events = np.zeros((12, 1, 3), bool)
    events[[5, 6, 7], 0, [0, 1, 2]] = True
    moving = np.ones((12, 1), bool)
    assert together_share([events], moving, 2) == 1.0
    assert together_share([events], moving, 1) == pytest.approx(1 / 3)
    assert together_share([events, np.zeros_like(events)], ~moving, 2) is None


def test_correlations_by_hand() -> None:
    """(1 1 0 0) and (1 0 1 0) have none; a foot that never changes has no correlation and does not count."""
    contact = np.array([[1, 1, 0, 0], [1, 0, 1, 0], [1, 1, 1, 1]], bool).T[:, None]
    groups = np.array([0, 0, 1])
    assert correlations(contact, np.ones((4, 1), bool), groups) == (0.0, None)


def test_only_moving_steps_count() -> None:
    """A robot that stands still in between has the gait of its walk, and one that never moves has none."""
    contact = np.concatenate([walk(wave(10), ~wave(10)), walk(np.ones(100, bool), np.ones(100, bool))])
    moving = (np.arange(300) < 200)[:, None]
    gait = measure_gait(contact, moving, GROUPS, PERIOD)
    assert gait.tripod_share == 1.0
    assert gait.moving_share == pytest.approx(2 / 3)
    still = measure_gait(contact, np.zeros((300, 1), bool), GROUPS, PERIOD)
    assert (still.name, still.tripod_share, still.duty_factor) == ("stands", None, None)
