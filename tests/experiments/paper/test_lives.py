"""Shares of a life, by hand: friction grows in 18 s, and 17 windows of 10 s have their middles at 7 to 23 s."""

import numpy as np
import pytest

from stiction_experiments.paper.lives import life_cfg, lives_of
from stiction_experiments.wear.lifetimes import Window, ratios

CFG = life_cfg((3000, 3001), ("vx=0.5",), 18.0)
"""Friction is 5 % · 6^(t/18 s), at most 30 %: 24 % is passed at 15.8 s, so that 8 middles, 16 to 23 s, are beyond."""


def windows(robot: int, speeds: list[float]) -> list[Window]:
    """Return the first windows of a walk with these ratios."""
    return [
        Window("p", "0.1", robot, None, 12.0 + k, CFG.wear.factor(7.0 + k), ratio, command="vx=0.5")
        for k, ratio in enumerate(speeds)
    ]


def test_a_life_is_the_share_of_windows_that_follow():
    """Followed up to the middle at 17 s, 11 of 17 windows, 2 of 8 beyond; too fast is not followed."""
    walks = windows(3000, [1.0] * 11 + [0.79] * 6) + windows(3001, [1.21] * 16 + [1.2])
    first, second = lives_of("none", {"p": 10}, walks, CFG)
    assert (first.seed, first.robot, first.followed, first.beyond) == (10, 3000, pytest.approx(11 / 17), 0.25)
    assert (second.robot, second.followed, second.beyond) == (3001, pytest.approx(1 / 17), 0.125)


def test_windows_after_a_fall_count_as_not_followed():
    """A walk with three windows has the share 3 / 17; one that fell before its first has none."""
    first, second = lives_of("none", {"p": 10}, windows(3000, [1.0] * 3), CFG)
    assert (first.followed, first.beyond) == (pytest.approx(3 / 17), 0.0)
    assert (second.followed, second.beyond) == (0.0, 0.0)


def test_a_whole_walk_has_as_many_windows_as_a_life():
    """The study of wear walks on for a window after friction has grown: 28 s have 17 windows."""
    speeds = ratios(np.ones(round(28.0 / 0.02)), 0.02, CFG.settle, CFG.window, CFG.every)
    (life, _) = lives_of("none", {"p": 10}, windows(3000, [ratio for _, ratio in speeds]), CFG)
    assert len(speeds) == 17 and life.followed == life.beyond == 1.0
