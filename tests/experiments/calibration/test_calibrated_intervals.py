"""Calibration of the wear monitor's intervals, on errors that were made up."""

from __future__ import annotations

import numpy as np
import pytest

from bundles import make_contract, make_wear
from stiction_experiments.calibration.calibrate import Windows, calibrate, usual

CONTRACT = make_contract("go1")
MODEL = make_wear(CONTRACT)
TARGETS = CONTRACT.num_joints + 1


def robots(first: int, count: int, seed: int) -> list[Windows]:
    """Robots of three windows, whose errors are 0.05 for all, and normal with 0.01 from robot to robot."""
    generator = np.random.default_rng(seed)
    error = 0.05 + 0.01 * generator.standard_normal((count, 1, TARGETS)) * np.ones((1, 3, 1))
    return [Windows(first + at, one, np.zeros(TARGETS), np.zeros(3, bool)) for at, one in enumerate(error)]


def test_the_interval_holds_on_robots_that_it_was_not_made_on() -> None:
    """The map is off by 0.05 and says ± 0.02: it never held; moved by 0.05 and some ± 0.02 wide it does."""
    found, rows = calibrate(MODEL, robots(500, 79, 0), robots(1100, 200, 1), "physx")
    assert found.shift == pytest.approx([0.05] * TARGETS, abs=0.005)
    assert np.mean(found.held_before) < 0.01
    assert 0.93 < np.mean(found.held) < 0.99
    assert (found.robots[0], found.robots[-1], len(found.tested), found.engine) == (500, 578, 200, "physx+all")
    assert rows[-1].target == "level" and rows[-1].robots_low < rows[-1].held < rows[-1].robots_high


def test_a_bound_is_the_largest_error_where_robots_are_few() -> None:
    """Of three robots with errors of at most 0.01, 0.02, 0.03, and at least −0.01, 0, 0.01."""
    errors = [np.array([[-0.01], [0.01]]), np.array([[0.0], [0.02]]), np.array([[0.01], [0.03]])]
    made = [Windows(n, np.tile(one, TARGETS), np.zeros(TARGETS), np.zeros(2, bool)) for n, one in enumerate(errors)]
    found, _ = calibrate(MODEL, made, robots(1100, 2, 0), "physx")
    assert found.lower[0] == pytest.approx(-0.01) and found.upper[0] == pytest.approx(0.03)
    assert found.shift[0] == pytest.approx(0.01)


def test_unusual_windows_are_not_read_and_robots_without_any_other_are_left_out() -> None:
    """The monitor says of them that they are not to be trusted."""
    one = Windows(1, np.arange(2.0)[:, None], np.zeros(1), np.array([False, True]))
    strange = Windows(2, np.zeros((1, 1)), np.zeros(1), np.array([True]))
    (kept,) = usual({1: one, 2: strange, 3: None})
    assert kept.seed == 1 and kept.error.tolist() == [[0.0]]
