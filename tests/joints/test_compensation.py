"""Friction fed forward: where it pushes, and how much of the friction."""

from __future__ import annotations

from dataclasses import replace
from math import exp, inf

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.joints.compensation import (
    Compensation,
    Hunting,
    PushCfg,
    compensated,
    parse_compensation,
    push_direction,
)

CFG = PushCfg(slow=0.2, smoothing=0.04, width=0.05, fade=0.3)


def test_the_direction_by_hand() -> None:
    """Half of v_s alone 0.5; stuck 0.02 rad beside the target 0.4; both 0.9; never over 1; both signs."""
    speed, error = np.array([0.1, 0.0, 0.1, 1.0, -1.0, 0.1]), np.array([0.0, 0.02, 0.02, 0.5, -0.5, -0.02])
    np.testing.assert_allclose(push_direction(speed, error, 0.0, CFG), [0.5, 0.4, 0.9, 1.0, -1.0, 0.1], atol=1e-12)


def test_the_push_of_a_stuck_joint_fades_when_it_moves() -> None:
    """At v_f to 37 %, at three times that to 0.01 %: a moving joint has no sign of the error pressed upon it."""
    pushes = push_direction(np.zeros(4), np.ones(4), np.array([0.0, 0.3, -0.3, 0.9]), CFG)
    np.testing.assert_allclose(pushes, [1.0, exp(-1), exp(-1), exp(-9)])


def test_a_target_is_moved_on_by_hand() -> None:
    """0.1 rad at most: stuck 0.02 rad beside its target 40 % of it; at 0.1 rad/s half, and e^-1/9 of 40 % against it;
    at 3 rad/s all of it in the direction of motion, wherever the target is. In NumPy and in torch.
    """
    torch = pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed")
    target, position = np.array([0.52, 0.48, 0.7, 0.3]), np.full(4, 0.5)
    velocity = np.array([0.0, 0.1, 3.0, 3.0])
    moved = 0.1 * np.array([0.4, 0.5 - 0.4 * exp(-1 / 9), 1.0, 1.0])
    np.testing.assert_allclose(compensated(target, position, velocity, 0.1, CFG), target + moved, atol=1e-15)
    tensors = map(torch.from_numpy, (target, position, velocity))
    np.testing.assert_allclose(compensated(*tensors, 0.1, CFG), target + moved, atol=1e-15)


def test_without_speeds_a_target_is_moved_on_by_the_error_alone() -> None:
    """Policies from before the speed was asked would walk otherwise: a + f/kp sat((a - θ)/width), to the last bit."""
    target, position, velocity = np.random.default_rng(0).normal(0.0, 0.1, (3, 500))
    old = target + 0.1 * np.clip((target - position) / 0.03, -1.0, 1.0)
    alone = PushCfg(slow=inf, width=0.03, fade=inf)
    np.testing.assert_array_equal(compensated(target, position, 100.0 * velocity, 0.1, alone), old)


def test_the_speed_of_a_target_that_jumps_is_its_low_pass() -> None:
    """0.01 rad at once, read every 4 ms, T = 40 ms: the first speed is 0.01 (1 − e^−0.1)/0.004, then e^−0.1 of it."""
    push = replace(CFG, slow=10.0)
    controller = Compensation("reference", 0.5, push).controller(np.array([8.0]), 0.004)
    assert controller.torque(np.zeros(1), np.zeros(1), np.full(1, 9.0)) == pytest.approx(0.0)
    first = 0.01 * (1 - exp(-0.1)) / 0.004
    for decay in (1.0, exp(-0.1), exp(-0.2)):
        torque = controller.torque(np.full(1, 0.01), np.full(1, 0.01), np.full(1, 9.0))
        assert torque == pytest.approx(0.5 * 8.0 * first * decay / 10.0)


def test_by_the_measured_speed_the_target_plays_no_part_once_the_joint_moves() -> None:
    """A joint that swings past its target at 3 rad/s is pushed on: 0.75 · 8 N m; the way `error` would brake it."""
    for by, expected in (("measured", 6.0), ("error", -8.0)):
        controller = parse_compensation(by).controller(np.array([8.0]), 0.002)
        assert controller.torque(np.zeros(1), np.full(1, 0.2), np.full(1, 3.0)) == pytest.approx(expected)


def test_friction_grows_with_the_motors_torque() -> None:
    """0.75 (8 + 0.1 · 20) = 7.5 N m, whichever way the motor pulls."""
    controller = Compensation("measured", 0.75).controller(np.array([8.0]), 0.002, load=0.1)
    for requested in (20.0, -20.0):
        assert controller.torque(np.zeros(1), np.zeros(1), np.full(1, 3.0), requested) == pytest.approx(7.5)


def test_a_robot_of_a_batch_that_is_reset_begins_with_its_target_at_rest() -> None:
    """The jump to the standing pose of the next episode is no motion that was wanted."""
    controller = Compensation("reference", 0.75).controller(np.full((2, 1), 8.0), 0.002)
    fast = np.full((2, 1), 9.0)
    controller.torque(np.zeros((2, 1)), np.zeros((2, 1)), fast)
    controller.reset(np.array([1]))
    torque = controller.torque(np.ones((2, 1)), np.ones((2, 1)), fast)
    assert torque[0] == pytest.approx(6.0) and torque[1] == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("motor", "unknown way"),
        ("measurd", "did you mean 'measured'"),
        ("reference=much", "expected a share"),
        ("reference=-1", "expected 0 to 2"),
        ("reference=nan", "expected 0 to 2"),
    ],
)
def test_a_way_that_is_none_is_refused(text: str, message: str) -> None:
    """The message says what there is."""
    with pytest.raises(StictionError, match=message):
        parse_compensation(text)


def test_a_joint_hunts_while_it_goes_to_and_fro_five_times_in_the_last_second() -> None:
    """At 10 Hz one hunts after half a second, and no more a second after it stopped; a step, or noise, is none."""
    period = 0.002
    hunting = Hunting(3, period)
    first, last = None, None
    for n in range(2000):
        at = n * period
        swing = 0.5 * np.sin(2 * np.pi * 10 * at) if at < 2.0 else 0.0
        flags = hunting.step(np.array([swing, 0.09 * (-1) ** n, 1.0 if at < 1.0 else -1.0]))
        assert not flags[1:].any()
        if flags[0]:
            first, last = at if first is None else first, at
    # Ten turns, the first at 0.05 s; the last ones leave the second until half of twenty are left.
    assert first == pytest.approx(0.5, abs=0.02) and last == pytest.approx(2.5, abs=0.06)
