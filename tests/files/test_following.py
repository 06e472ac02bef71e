"""The definition of following over all commands, by numbers worked out by hand."""

from __future__ import annotations

from typing import Any

import pytest

from stiction.files.following import COMMAND_SET, count_commands, judge_row, scaled_commands, worst_command
from stiction.files.results import ResultRow


def row(command: str, vx: float = 0.0, vy: float = 0.0, wz: float = 0.0, **more: Any) -> ResultRow:
    """Return a row of eight walks with a mean velocity."""
    named: dict[str, Any] = {"slowest_walk": 0.7, "mean_vx": vx, "mean_vy": vy, "mean_wz": wz, "fall_rate": 0.0} | more
    fixed: dict[str, Any] = dict.fromkeys(("steps_climbed", "cost_of_transport", "tripod_share", "flight_share"))
    named = fixed | {"policy": "policy", "friction_level": 0.2, "terrain": "flat"} | named
    return ResultRow(
        method="deception", seed=0, engine="mujoco", friction_law="coulomb", command=command,
        speed_ratio=None, tracking_error=0.0, distance=4.0, joint_jitter=1.0, episodes=8, **named,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("judged", "faults", "miss"),
    [
        (row("vx=0.5", 0.40), (), 0.0),
        (row("vx=0.5", 0.39), ("too slow",), 0.01),
        (row("vx=0.5", 0.61), ("too fast",), 0.01),
        (row("vx=-0.5", -0.5), (), 0.0),
        (row("vx=-0.5", 0.5), ("too slow",), 0.9),
        # 0.15 of 0.2 m/s is 75 %, and within 0.05 m/s.
        (row("vx=0.2", 0.15), (), 0.0),
        (row("vx=0.2", 0.14), ("too slow",), 0.01),
        (row("wz=0.5", wz=0.36), ("too slow",), 0.04),
        # Each axis alone: the turn is followed, the walk is not.
        (row("vx=0.4,wz=0.5", 0.3, 0.0, 0.5), ("too slow",), 0.02),
        (row("vx=0.5", 0.5, 0.11), ("drifts",), 0.01),
        (row("vx=0.5", 0.5, 0.0, -0.1), (), 0.0),
        (row("vx=0.5", 0.5, slowest_walk=0.49), ("stalls",), 0.0),
        (row("vx=0.5", 0.5, fall_rate=0.125), ("falls",), 0.0),
        (row("stand", 0.03, 0.03, slowest_walk=None), (), 0.0),
        (row("stand", 0.04, 0.04, slowest_walk=None), ("drifts",), 0.0566 - 0.05),
        (row("stand", wz=0.06, slowest_walk=None), ("drifts",), 0.01),
        # In the mean over virtual robots the command is reached, on the slowest and the fastest of them it is not.
        (row("vx=0.5", 0.5, slowest=0.6, fastest=1.4), ("too slow", "too fast"), 0.1),
        (row("vx=0.5", 0.5, slowest=0.8, fastest=1.2), (), 0.0),
    ],
)
def test_each_axis_is_judged_alone(judged: ResultRow, faults: tuple[str, ...], miss: float) -> None:
    """Bounds of ratio, distance, drift, worst walk and standing hold as defined."""
    verdict = judge_row(judged)
    assert verdict is not None and verdict.faults == faults and verdict.follows == (not faults)
    assert verdict.miss == pytest.approx(miss, abs=1e-4)


def test_the_worst_command_is_named() -> None:
    """A fall is worse than any miss, then the largest miss; rows that follow or know no velocity are left out."""
    rows = [row("vx=0.5", 0.5), row("vx=0.5", 0.39), row("wz=0.5", wz=0.2), row("vy=0.3", mean_vx=None)]
    assert worst_command(rows[:1]) is None and judge_row(rows[3]) is None
    worst = worst_command(rows)
    assert worst is not None and worst.row.command == "wz=0.5"
    fallen = worst_command([*rows, row("vx=0.2", 0.2, fall_rate=1.0)])
    assert fallen is not None and fallen.row.command == "vx=0.2"


def test_seeds_that_follow_every_command_are_counted() -> None:
    """Seed 0 follows both commands, seed 1 misses the turn by 0.04, seed 2 was told one: 4 of 5 cells, 1 of 3 seeds."""
    rows = [
        *(row("vx=0.5", 0.5, policy=f"p{seed}") for seed in range(3)),
        *(row("wz=0.5", wz=wz, policy=f"p{seed}") for seed, wz in enumerate((0.5, 0.36))),
        row("vx=0.5", mean_vx=None, policy="older"),
        row("vx=0.5", 0.5, policy="p0", terrain="stairs=0.1"),
        *(row("vx=0.5", 0.5, policy=f"p{seed}", friction_level=0.1) for seed in range(3)),
    ]
    count, other = count_commands(rows, lambda row: "method")
    assert (count.method, count.engine, count.friction_law, count.friction_level) == (
        "method",
        "mujoco",
        "coulomb",
        0.2,
    )
    assert (count.seeds, count.follow_all, count.cells, count.followed) == (3, 1, 5, 4)
    assert count.miss == pytest.approx(0.04 / 5) and count.largest_miss == pytest.approx(0.04)
    assert count.worst == "wz=0.5: too slow" and not count.every_seed and not count.covered
    assert (other.friction_level, other.worst) == (0.1, "") and other.covered
    # Two seeds say nothing of a training.
    assert count_commands(rows[:2])[0].every_seed and not count_commands(rows[:2])[0].covered


def test_commands_are_scaled_to_a_slower_robot() -> None:
    """Each axis by min(1, reach / largest): half of the forward speed, all of the sideways one, no turn."""
    assert scaled_commands((0.8, 0.3, 1.0)) == scaled_commands((2.0, 2.0, 2.0)) == COMMAND_SET
    slower = scaled_commands((0.4, 0.3, 0.0))
    assert slower == (
        *("vx=0.1", "vx=-0.1", "vx=0.25", "vx=-0.25", "vx=0.4", "vx=-0.4", "vy=0.3", "vy=-0.3"),
        *("stand", "vx=0.2", "vx=0.2,vy=0.2"),
    )
