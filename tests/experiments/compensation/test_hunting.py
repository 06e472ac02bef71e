"""Hunting at standstill, and following with friction fed forward."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stiction.files.results import ResultRow
from stiction.joints.compensation import parse_compensation
from stiction.robots.catalog import find_robot
from stiction_experiments.compensation.page import answer
from stiction_experiments.compensation.standing import hunting, rms, stand_by
from stiction_experiments.compensation.walking import Followed, followed


def row(policy: str, level: float, command: str, ratio: float | None, **columns: Any) -> ResultRow:
    """Return a row of results.csv; the seed is read from the policy's name."""
    defaults: dict[str, Any] = {
        "method": "direct",
        "seed": int(policy.partition("/")[0].rpartition("-s")[2]),
        "engine": "mujoco",
        "friction_law": "coulomb",
        "terrain": "flat",
        "tracking_error": 0.05,
        "fall_rate": 0.0,
        "distance": 4.0,
        "steps_climbed": None,
        "cost_of_transport": 0.5,
        "joint_jitter": 80.0,
        "tripod_share": 0.9,
        "flight_share": 0.0,
        "episodes": 16,
    }
    return ResultRow(policy=policy, friction_level=level, command=command, speed_ratio=ratio, **{**defaults, **columns})


def test_a_joint_that_moves_to_and_fro_once_a_second_hunts() -> None:
    """At 2 Hz and 0.1 rad/s it does; at 0.5 Hz, below 0.02 rad/s, or creeping one way it does not."""
    time = np.arange(0.0, 4.0, 0.002)
    waves = [0.1 * np.sin(2 * np.pi * 2 * time), 0.1 * np.sin(np.pi * time), 0.019 * np.sin(20 * time)]
    creeping = np.full_like(time, 0.1)
    assert hunting(np.stack([*waves, creeping], axis=1), 0.002).tolist() == [True, False, False, False]


def test_torque_at_rest_holds_the_robot_and_does_not_swing() -> None:
    """Fed by the error alone a robot that leans on its joints still rests; every way gives up its columns."""
    assert rms(np.array([[3.0, -4.0]])) == pytest.approx(np.sqrt(12.5))
    spec = find_robot("saturn_lite")
    still, fed = (stand_by("mujoco", 3, "0.2", spec, how) for how in (None, parse_compensation("error")))
    for stood in (still, fed):
        assert 0.1 < stood.rms_torque < spec.joint_values("torque_limit").max()
        assert stood.torque_ripple < 0.2 * stood.rms_torque and stood.rms_speed < 0.02 and stood.hunting == 0.0
    assert (still.fed, fed.fed) == ("none", "error")


def test_the_first_sentence_says_whether_it_is_enough() -> None:
    """Answers the title in the first sentence."""
    rows = [
        Followed("p", 0.0, 1.0, 1.0, "follows", 0.0, None),
        Followed("p", 0.2, 0.5, 0.5, "too slow", 0.0, None),
        Followed("p+forward", 0.2, 0.9, 0.9, "follows", 0.0, None),
        Followed("p+measured", 0.2, 0.7, 0.9, "too slow, follows", 0.0, None),
        Followed("q", 0.2, 0.9, 0.9, "follows", 0.0, None),
    ]
    assert answer(rows) == [
        "In the simulator of the training it is enough in 1 of 2 ways: p follows at 0 % as it is, and with friction "
        "fed forward at best at 20 % (by the position error, share 1).",
        "q follows at 20 % as it is.",
    ]
    assert (
        "is not enough in any of 1 ways: p follows at 0 % as it is, and no way helps" in answer(rows[:2] + rows[3:])[0]
    )


def test_both_directions_decide_who_follows() -> None:
    """0.9 forward and 0.7 backward is too slow; a policy that was walked one way is no row."""
    rows = [
        row("a-s0", 0.2, "vx=0.5", 0.9),
        row("a-s0", 0.2, "vx=-0.5", 0.7, fall_rate=0.5),
        row("a-s0", 0.2, "stand", None, joint_jitter=7.0),
        row("b-s0", 0.2, "vx=0.5", 0.9),
    ]
    (walk,) = followed(rows)
    assert (walk.policy, walk.forward, walk.backward, walk.jitter) == ("a-s0", 0.9, 0.7, 7.0)
    assert walk.follows == "follows, too slow" and walk.fall_rate == pytest.approx(0.25)
