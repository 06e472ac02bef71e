"""Gaits in made-up contact records of 10 s, steps of 20 ms, a period of ten steps; and of one walk."""

from pathlib import Path

import numpy as np
import pytest

from stiction.deploy.check import check_for_simulation
from stiction.files.bundle import find_bundle
from stiction_experiments.paper.gaits import Gait, gait_of, imbalance, sway, together_share, touch_downs, walk_gaits

STEPS, PERIOD = 500, 0.02
SIX, FOUR = np.array([0, 1, 1, 0, 0, 1]), np.array([0, 1, 1, 0])
PHASE = np.arange(STEPS) % 10


def measured(groups: np.ndarray, first: np.ndarray, second: np.ndarray, late: int = 0) -> Gait:
    """Return the gait of two robots whose groups are down at these steps, (T,); late: steps by which foot 0 lags."""
    contact = np.stack([(first, second)[group] for group in groups], axis=-1)
    contact[:, 0] = np.roll(contact[:, 0], late)
    both = np.repeat(contact[:, None], 2, axis=1)
    moving = np.ones((STEPS, 2), bool)
    return gait_of("none", 10, both, moving, groups, np.zeros((STEPS, 2, 2)), PERIOD)


def test_a_pronk_has_all_feet_together():
    """Six feet down for five steps and up for five: every touch-down is of all, no group stands alone."""
    gait = measured(SIX, PHASE < 5, PHASE < 5)
    assert (gait.pronk, gait.diagonal, gait.in_phase, gait.imbalance) == (1.0, 0.0, 1.0, 0.0)


def test_feet_two_steps_apart_do_not_touch_down_together():
    """A tenth of a period is one step: one step of lateness is a pronk still, two are none."""
    assert measured(SIX, PHASE < 5, PHASE < 5, late=1).pronk == 1.0
    assert measured(SIX, PHASE < 5, PHASE < 5, late=2).pronk == 0.0


def test_a_tripod_has_one_group_at_a_time():
    """Three feet stand while three swing: no pronk, exactly one group in every step, both used alike."""
    gait = measured(SIX, PHASE < 5, PHASE >= 5)
    assert (gait.pronk, gait.diagonal, gait.in_phase, gait.imbalance) == (0.0, 1.0, 1.0, 0.0)


def test_a_trot_may_have_both_diagonals_down():
    """Each diagonal is down for six steps of ten: in phase always, exactly one diagonal in eight of ten."""
    gait = measured(FOUR, PHASE < 6, (PHASE >= 5) | (PHASE == 0))
    assert (gait.pronk, gait.diagonal, gait.in_phase) == (0.0, pytest.approx(0.8), 1.0)


def test_hopping_on_three_legs_is_uneven():
    """One group does all: a difference of one, and no touch-down of all feet."""
    gait = measured(SIX, PHASE < 5, np.zeros(STEPS, bool))
    assert (gait.pronk, gait.imbalance) == (0.0, 1.0)


def test_a_robot_that_stands_has_no_gait():
    """Every number of it is unknown, so that its seed is left out."""
    contact, still = np.ones((STEPS, 1, 6), bool), np.zeros((STEPS, 1), bool)
    gait = gait_of("none", 10, contact, still, SIX, np.zeros((STEPS, 1, 2)), PERIOD)
    assert gait == Gait("none", 10, None, None, None, None, None)


def test_a_bounce_is_no_step() -> None:
    """Two steps off the ground are under 0.06 s, three are not."""
    contact = np.array([1, 1, 0, 0, 1, 1, 0, 0, 0, 1], bool).reshape(10, 1, 1)
    assert np.flatnonzero(touch_downs(contact, 3)).tolist() == [9]
    assert np.flatnonzero(touch_downs(contact, 2)).tolist() == [4, 9]


def test_together_means_all_feet_within_the_window() -> None:
    """Feet that land at steps 5, 6 and 7: within two steps of each other all share, within one only the middle one."""
    touches = np.zeros((12, 1, 3), bool)
    touches[[5, 6, 7], 0, [0, 1, 2]] = True
    moving = np.ones((12, 1), bool)
    assert together_share(touches, moving, 2) == 1.0
    assert together_share(touches, moving, 1) == pytest.approx(1 / 3)
    assert together_share(touches, ~moving, 2) == 0.0


def test_imbalance_by_hand() -> None:
    """Three quarters against one quarter is 0.5; windows in which sides change do not cancel either."""
    feet, moving = SIX[None] == 0, np.ones((16, 1), bool)
    three = np.array([1, 1, 1, 0] * 4, bool)[:, None]
    assert imbalance(np.where(feet, three, ~three)[:, None], moving, SIX, 16) == pytest.approx(0.5)
    half = np.repeat([True, False], 8)[:, None]
    turns = np.where(feet, half, ~half)[:, None]
    assert (imbalance(turns, moving, SIX, 8), imbalance(turns, moving, SIX, 16)) == (1.0, 0.0)
    assert imbalance(np.zeros_like(turns), moving, SIX, 8) is None


def test_only_moving_steps_count() -> None:
    """A robot that stands on all feet in between has the gait of its walk."""
    contact = np.stack([(PHASE < 5, PHASE >= 5)[group] for group in SIX], axis=-1)[:, None]
    contact[300:] = True
    moving = (np.arange(STEPS) < 300)[:, None]
    assert gait_of("none", 10, contact, moving, SIX, np.zeros((STEPS, 1, 2)), PERIOD).diagonal == 1.0


def test_sway_is_of_roll_and_pitch_together():
    """Roll of ± 0.03 and pitch of ± 0.04 about any mean are 0.05; a robot that never moves does not count."""
    sign = np.where(np.arange(100) % 2, 1.0, -1.0)
    tilt = np.stack([1.0 + 0.03 * sign, 0.04 * sign], axis=-1)[:, None].repeat(2, axis=1)
    moving = np.stack([np.ones(100, bool), np.zeros(100, bool)], axis=-1)
    assert sway(tilt, moving) == pytest.approx(0.05)


def test_a_shipped_policy_has_a_gait():
    """One walk of 4 s: it moves by tripods, and sways by less than a tenth of a radian."""
    bundle = check_for_simulation(find_bundle(Path("saturn_lite-flat-none-0.2")))
    (gait,) = walk_gaits("none", [bundle], 4.0, 1)
    assert gait.diagonal is not None and gait.diagonal > 0.5 and gait.pronk == 0.0
    assert gait.sway is not None and 0.0 < gait.sway < 0.1
