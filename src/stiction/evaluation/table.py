"""Rows of results from walks, and the grouping of policies into samples of one training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from stiction.core.statistics import wilson
from stiction.evaluation.grid import Walk
from stiction.evaluation.metrics import Metrics, combine
from stiction.evaluation.policies import MethodCell, method_of
from stiction.files.bundle import Bundle
from stiction.files.contract import PHASES, Contract, robot_of
from stiction.files.results import ResultRow, ends_of, slowest_of
from stiction.files.velocity import parse_command
from stiction.joints.friction import Law
from stiction.learning.identity import MISSING, SHOWN, differing, key_of_settings, setting_text, settings_in
from stiction.robots.model import Robot
from stiction.virtual.cases import parse_level


@dataclass(frozen=True)
class Sample(MethodCell):
    """One column in one cell, over training seeds; a row of methods.csv. The command may be `BOTH`."""

    column: str
    """Column of results.csv; `crossed`, the share of walks that crossed their course; `speed_error`, |speed ratio - 1|,
    1|, of virtual robots the mean over robots."""
    seeds: str
    """Training seeds, separated by blanks."""
    each: str
    """Values of the seeds, in the same order."""
    mean: float
    """Mean of the values."""
    low: float | None
    """Lower end of the mean's 95 % t-interval; None for one seed."""
    high: float | None
    """Upper end of that interval."""
    trials: int | None
    """Number of trials of a rate: walks, or pairs of policy and virtual robot (dependent: policies share robots)."""
    trials_low: float | None
    """Lower end of Wilson's 95 % interval over the trials."""
    trials_high: float | None
    """Upper end of that interval."""


BOTH = "both"
"""Command in methods.csv of a sample over forward and backward, with equal weight."""


def rows_of(
    done: Mapping[Walk, Metrics], bundles: Sequence[Bundle], robot: str | None = None
) -> tuple[list[ResultRow], list[dict[str, Any]]]:
    """Return one row per cell, in the order of the walks, and the same rows as plain data with more fields.

    These are Wilson's intervals of `fall_rate` and `crossed`; per virtual robot its speed ratio, `robot_fall_rates`,
    `robot_tracking_errors` and `robot_crossed`; `known_friction`, f/τ_max of each kind of joint by robot.
    """
    contracts = {bundle.name: bundle.contract for bundle in bundles}
    cells: dict[tuple[str, ...], list[Walk]] = {}
    for walk in done:
        cells.setdefault(walk.cell, []).append(walk)
    robots = {name: robot_of(contracts[name], robot) for name in {walk.policy for walk in done}}
    rows, details = [], []
    for walks in cells.values():
        first, metrics = walks[0], combine([done[walk] for walk in walks])
        contract = contracts[first.policy]
        row = ResultRow(
            policy=first.name,
            method=method_of(contract) + first.suffix,
            seed=contract.seed,
            engine=first.simulator.label,
            friction_law=first.law if first.robot is None else law_label(first),
            friction_level=number(first, contract.array("torque_limit"), robots[first.policy]),
            terrain=first.terrain,
            command=first.command,
            episodes=len(walks),
            slowest_walk=slowest_of(parse_command(first.command), (done[walk].mean_velocity for walk in walks)),
            **metrics.columns,
            **ends_of((summary_fields := _summary_fields(walks, done)).get("robots", {}).values()),
        )
        rows.append(row)
        details.append(asdict(row) | metrics.summary_only | summary_fields)
    return rows, details


def law_label(walk: Walk) -> str:
    """Return the friction law of a virtual robot in results.csv: `real`, `real-bench`, `real+load0.02`."""
    level = parse_level(walk.level)
    bench = "-bench" if level.share is None else ""
    return walk.law + bench + (f"+load{level.load:g}" if level.load else "")


def number(walk: Walk, torque_limit: np.ndarray, spec: Robot) -> float:
    """Return the friction level of a walk as a number; for a virtual robot the mean over joints of f/τ_max [-]."""
    if walk.robot is None:
        return float(walk.level)
    return round(float((parse_level(walk.level).coulomb(spec) / torque_limit).mean()), 6)


def _summary_fields(walks: Sequence[Walk], done: Mapping[Walk, Metrics]) -> dict[str, Any]:
    """Return the fields of a row stored only in summary.json, see `rows_of`."""
    robots = dict.fromkeys(walk.robot for walk in walks if walk.robot is not None)
    each = {robot: combine([done[walk] for walk in walks if walk.robot == robot]) for robot in robots}
    samples = list(each.values()) or [done[walk] for walk in walks]
    crossed = [metrics.crossed for metrics in samples if metrics.crossed is not None]
    fields: dict[str, Any] = {
        "fall_interval": wilson(sum(metrics.fall_rate for metrics in samples), len(samples)),
        "crossed_interval": wilson(sum(crossed), len(crossed)) if crossed else None,
    }
    if each:
        fields["robots"] = {str(robot): metrics.speed_ratio for robot, metrics in each.items()}
        fields["robot_fall_rates"] = [metrics.fall_rate for metrics in samples]
        fields["robot_tracking_errors"] = [metrics.tracking_error for metrics in samples]
        fields["robot_crossed"] = crossed or None
    if known := {walk.robot: walk.known for walk in walks if walk.known is not None}:
        fields["known_friction"] = {
            "data sheet" if robot is None else str(robot): share for robot, share in known.items()
        }
    return fields


def sample_names(contracts: Mapping[str, Contract]) -> dict[str, str]:
    """Return policy -> suffix of its method; policies share a method name only if they differ in nothing but the seed.

    The suffix lists the differences between the groups of a method, `deception (teacher.quiet 30)`; where a seed occurs
    twice in a group, the policy.
    """
    groups: dict[tuple[tuple[str, ...], str | None], list[str]] = {}
    for name, contract in contracts.items():
        groups.setdefault((_sample_of(contract), key_of_settings(contract.settings)), []).append(name)
    suffixes = {}
    for (group, key), names in groups.items():
        alternatives = [other for other in groups if other[0][0] == group[0]]
        seeds = {contracts[name].seed for name in names}
        words = _words(group, key, alternatives)
        # Shortened texts of two groups may be equal.
        if any(other != (group, key) and _words(*other, alternatives) == words for other in alternatives):
            words.append(f"as {names[0]}")
        for name in names:
            label = words if len(seeds) == len(names) else [name]
            suffixes[name] = f" ({', '.join(label)})" if label else ""
    return suffixes


def _words(group: tuple[str, ...], key: str | None, groups: Sequence[tuple[tuple[str, ...], str | None]]) -> list[str]:
    """Return the words that distinguish a group within its method: from the contracts, then from the settings."""
    values = zip(*(other for other, _ in groups), strict=True)
    words = [value for value, values_of_method in zip(group, values, strict=True) if len(set(values_of_method)) > 1]
    recorded = {other for _, other in groups if other is not None}
    if key is None:
        return [*words, f"settings {MISSING}"] if recorded else words
    settings, names = settings_in(key), set()
    for other in recorded:
        names |= {*differing(settings, settings_in(other))}
    unnamed = [name for name in sorted(names) if not (words and name in TOLD)] if len(recorded) > 1 else []
    # Defaults are listed only where all differences are defaults.
    listed = [name for name in unnamed if name in settings] or ([] if words else unnamed)
    more = [f"{len(listed) - SHOWN} more"] if len(listed) > SHOWN else []
    return [*words, *(setting_text(settings, name) for name in listed[:SHOWN]), *more]


TOLD = (
    *("task.terrain.kind", "student.iterations", "teacher.latent"),
    *(f"task.friction.{name}" for name in ("level", "law", "range", "spread", "load")),
    *("task.timestep", "task.decimation", "task.history"),
)
"""Settings that the words of a contract already cover."""


USUAL_SHAPE = (Law().static_ratio, Law().stribeck_velocity)
"""Default parameters of the law `stribeck`, which labels omit."""


def _sample_of(contract: Contract) -> tuple[str, ...]:
    """Return the properties shared by samples of one training, in words; the method comes first."""
    low, high = contract.friction_range
    phases = PHASES.get(contract.phases or 0, f"phases {MISSING}")
    law = contract.friction_law
    if contract.stribeck not in (None, USUAL_SHAPE):
        law += " {:g} {:g}".format(*contract.stribeck)
    trained = contract.robot, contract.terrain, phases, law, f"{contract.friction_level:g}"
    joints = (
        "the data sheet's joints" if contract.joints_file is None else f"joints {contract.joints_file['sha256'][:8]}"
    )
    more = {"spread": contract.friction_spread, "load": contract.friction_load}
    return (
        *(method_of(contract), *trained, f"range {low:g} to {high:g}"),
        *(f"no {name}" if pair is None else f"{name} {pair[0]:g} to {pair[1]:g}" for name, pair in more.items()),
        *(joints, f"{contract.observation.history_length} frames"),
        f"{contract.decimation} steps of {1000 * contract.physics_timestep:g} ms",
    )


def methods_of(rows: Sequence[Any], bundles: Sequence[Bundle]) -> dict[str, str]:
    """Return policy, as in rows -> its method with the suffix of `sample_names`; bundles: of those policies."""
    names = sample_names({bundle.name: bundle.contract for bundle in bundles})
    # A bundle's own name may have a + in it.
    base = {row.policy: row.policy if row.policy in names else row.policy.rpartition("+")[0] for row in rows}
    return {row.policy: row.method + names[base[row.policy]] for row in rows}
