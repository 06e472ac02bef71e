"""From walks to rows: the episodes of a cell together, and the seeds of a way of training as one sample each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from stiction.formats.bundle import Bundle
from stiction.formats.climb import wilson
from stiction.formats.grid import MethodMean
from stiction.formats.results import ResultRow
from stiction.robots.spec import RobotSpec
from stiction.transfer.grid.plan import Walk
from stiction.transfer.metrics import Metrics, combine
from stiction.transfer.robot.factorial import parse_level
from stiction.transfer.rollout import robot_of
from stiction.transfer.statistics import t_interval
from stiction.transfer.ways import way_of


def rows_of(
    done: Mapping[Walk, Metrics], bundles: Sequence[Bundle], robot: str | None = None
) -> tuple[list[ResultRow], list[dict[str, Any]]]:
    """Return a row per cell, in the order of the walks, and the same rows as plain data with intervals of the rates.

    Intervals there are Wilson's, over episodes: of `fall_rate`, and of `crossed` over a course. A row of virtual robots
    also has each robot's speed ratio.
    """
    contracts = {bundle.name: bundle.contract for bundle in bundles}
    cells: dict[tuple[str, ...], list[Walk]] = {}
    for walk in done:
        cells.setdefault(walk.cell, []).append(walk)
    rows, details = [], []
    for walks in cells.values():
        first, metrics = walks[0], combine([done[walk] for walk in walks])
        contract = contracts[first.policy]
        row = ResultRow(
            policy=first.name,
            method=way_of(contract) + first.suffix,
            seed=contract.seed,
            engine=first.place.label,
            friction_law=first.law if first.robot is None else real_law(first),
            friction_level=number(first, contract.array("torque_limit"), robot_of(contract, robot)),
            terrain=first.terrain,
            command=first.command,
            episodes=len(walks),
            **metrics.columns,
        )
        rows.append(row)
        details.append(asdict(row) | metrics.beside | _beside(walks, done))
    return rows, details


def real_law(walk: Walk) -> str:
    """Return the friction law of a virtual robot as it stands in results.csv: `real`, `real-bench`, `real+load0.02`."""
    level = parse_level(walk.level)
    bench = "-bench" if level.share is None else ""
    return walk.law + bench + (f"+load{level.load:g}" if level.load else "")


def number(walk: Walk, torque_limit: np.ndarray, spec: RobotSpec) -> float:
    """Return the friction level of a walk as a number; of a virtual robot the mean over joints of f/τ_max [-]."""
    if walk.robot is None:
        return float(walk.level)
    return round(float((parse_level(walk.level).coulomb(spec) / torque_limit).mean()), 6)


def _beside(walks: Sequence[Walk], done: Mapping[Walk, Metrics]) -> dict[str, Any]:
    """Return what a row has in summary.json alone: Wilson's intervals, and the speed ratio of each virtual robot."""
    episodes = [done[walk] for walk in walks]
    beside: dict[str, Any] = {"fall_interval": wilson(round(sum(one.fall_rate for one in episodes)), len(episodes))}
    over = [one.crossed for one in episodes if one.crossed is not None]
    beside["crossed_interval"] = wilson(round(sum(over)), len(over)) if over else None
    robots = [walk.robot for walk in walks if walk.robot is not None]
    if robots:
        beside["robots"] = {
            str(robot): combine([done[walk] for walk in walks if walk.robot == robot]).speed_ratio
            for robot in dict.fromkeys(robots)
        }
    return beside


_MethodCell = tuple[str, str, str, str, str, str]
"""Method, engine, law, level, terrain, command."""


def method_means(rows: Sequence[ResultRow]) -> list[MethodMean]:
    """Return the mean speed ratio of every way of training over its training seeds, with each seed's and an interval.

    A seed is one sample, however many episodes it walked; two policies of one seed count as one, their mean.
    """
    cells: dict[_MethodCell, dict[int, list[float]]] = {}
    numbers: dict[_MethodCell, float] = {}
    for row in rows:
        if row.speed_ratio is not None:
            cell = row.method, row.engine, row.friction_law, f"{row.friction_level:g}", row.terrain, row.command
            numbers[cell] = row.friction_level
            cells.setdefault(cell, {}).setdefault(row.seed, []).append(row.speed_ratio)
    means = []
    for cell, seeds in cells.items():
        points = [float(np.mean(values)) for values in seeds.values()]
        low, high = t_interval(points) or (None, None)
        method, engine, law, _, terrain, command = cell
        mean, each = float(np.mean(points)), " ".join(f"{point:.4g}" for point in points)
        means.append(
            MethodMean(method, engine, law, numbers[cell], terrain, command, len(points), mean, low, high, each)
        )
    return means
