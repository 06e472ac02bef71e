"""How high a policy climbs: stairs up, a landing, stairs down, step height by step height, blind.

A trial succeeds when the robot has been on the landing and then left the last step behind without a fall, within
`PATIENCE` times what the commanded speed takes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from stiction.core.provenance import seed_streams
from stiction.core.records import column
from stiction.deploy.policy import load_policy
from stiction.evaluation.course import PATIENCE, course_commands, crossed, line_up, starts, steps_passed
from stiction.evaluation.rollout import Rollout, friction_at
from stiction.files.bundle import Bundle
from stiction.files.contract import robot_of
from stiction.files.walk import Recording
from stiction.robots.terrain import KINDS, SLABS, STEEPEST, Terrain
from stiction.task.terrain import LENGTH
from stiction.virtual.drive import record
from stiction_experiments.stairs.config import ClimbCfg

ENOUGH = 0.8
"""Share of trials that must succeed for a height to count as climbed."""


@dataclass(frozen=True)
class Climb:
    """Result of a policy at one height and level."""

    policy: str = field(metadata=column("policy"))
    friction_level: float = field(metadata=column("friction", "of τ_max", lambda level: f"{100 * level:g} %"))
    """Dry friction as a fraction of each joint's torque limit [-]."""
    step_height: float = field(metadata=column("step height", "cm", lambda height: f"{100 * height:g}"))
    """[m]."""
    trials: int = field(metadata=column("trials"))
    successes: int = field(metadata=column("succeed", "trials"))
    """... that went over the landing and left the last step behind."""
    falls: int = field(metadata=column("fell", "trials"))
    """... that fell before, or whose simulation became unstable."""
    steps_climbed: float = field(metadata=column("passed", "steps", form=".1f"))
    """Mean number of steps passed, up and down."""
    seconds: float | None = field(metadata=column("time", "s", ".1f"))
    """Median time of those that succeeded [s]; None where none did."""


def highest_climbed(rows: Iterable[Climb]) -> Climb | None:
    """Return the row of the greatest height up to which every tested one was climbed by `ENOUGH`, or None.

    rows: of one policy and level.
    """
    best = None
    for row in sorted(rows, key=lambda row: row.step_height):
        if row.successes < ENOUGH * row.trials:
            break
        best = row
    return best


def climb(
    bundle: Bundle, cfg: ClimbCfg, threads: int = 1, progress: Callable[[float], None] = lambda share: None
) -> list[Climb]:
    """Drive a bundle over stairs of every height at every level of friction.

    Raises:
        StictionError: the bundle does not fit the robot.

    """
    contract = bundle.contract
    cells = [(level, height) for level in cfg.friction_levels for height in cfg.step_heights]
    num = len(cells) * cfg.trials
    level, height = np.repeat(np.array(cells), cfg.trials, axis=0).T
    streams = seed_streams(cfg.seed, [f"trial {number}" for number in range(cfg.trials)])
    terrain = Terrain(np.full(num, KINDS.index("stairs")))
    rollout = Rollout(
        contract,
        load_policy(contract, bundle.policy, (num,)),
        robot_of(contract),
        friction_at(contract, level),
        list(streams.values()),
        threads,
        cfg.noise,
        terrain=terrain,
    )
    fleet = rollout.fleet
    fleet.place_terrain(np.arange(num), height / STEEPEST["stairs"], np.zeros((num, SLABS, 4)))
    line_up(fleet, starts(cfg.seed, cfg.trials))
    seconds = PATIENCE * LENGTH / cfg.speed
    steer, period = course_commands(fleet, np.full(num, cfg.speed)), fleet.control_period
    recording = record(rollout, steer, period, round(seconds / contract.control_period), progress)
    return [
        _judge(bundle.name, *cell, recording.of(slice(number * cfg.trials, (number + 1) * cfg.trials)))
        for number, cell in enumerate(cells)
    ]


def _judge(policy: str, level: float, height: float, recording: Recording) -> Climb:
    up, down = steps_passed(recording.position, recording.upright)
    over = crossed(recording.position, recording.upright, stairs=True)
    success = over.any(axis=0)
    first = over.argmax(axis=0)[success] + 1
    return Climb(
        policy=policy,
        friction_level=level,
        step_height=height,
        trials=over.shape[1],
        successes=int(success.sum()),
        falls=int((~recording.upright[-1] & ~success).sum()),
        steps_climbed=float((up[-1] + down[-1]).mean()),
        seconds=float(np.median(first) * recording.period) if success.any() else None,
    )
