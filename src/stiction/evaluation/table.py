"""Rows of results from walks, and which policies are samples of one training."""

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
    """A column of results.csv; `crossed`, the share of walks that crossed their course; `speed_error`, |speed ratio -
    1|, of virtual robots the mean over robots."""
    seeds: str
    """Training seeds, separated by blanks."""
    each: str
    """What each of them reached, in the same order."""
    mean: float
    """Their mean."""
    low: float | None
    """Lower end of its 95 % t-interval; None for one seed."""
    high: float | None
    """Upper end."""
    trials: int | None
    """Of a rate, its trials: walks, or pairs of policy and virtual robot (not independent: policies share robots)."""
    trials_low: float | None
    """Lower end of Wilson's 95 % interval over them."""
    trials_high: float | None
    """Upper end."""


BOTH = "both"
"""In methods.csv the command of a sample over forward and backward, each alike."""


def rows_of(
    done: Mapping[Walk, Metrics], bundles: Sequence[Bundle], robot: str | None = None
) -> tuple[list[ResultRow], list[dict[str, Any]]]:
    """Return a row per cell, in the order of the walks, and the same rows as plain data with more fields.

    Those are Wilson's intervals of `fall_rate` and `crossed`; by virtual robot its speed ratio, and `robot_fall_rates`,
    `robot_tracking_errors`, `robot_crossed`; `known_friction`, f/τ_max of each kind of joint by robot.
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
            **ends_of((beside := _beside(walks, done)).get("robots", {}).values()),
        )
        rows.append(row)
        details.append(asdict(row) | metrics.beside | beside)
    return rows, details


def law_label(walk: Walk) -> str:
    """Return the friction law of a virtual robot as it stands in results.csv: `real`, `real-bench`, `real+load0.02`."""
    level = parse_level(walk.level)
    bench = "-bench" if level.share is None else ""
    return walk.law + bench + (f"+load{level.load:g}" if level.load else "")


def number(walk: Walk, torque_limit: np.ndarray, spec: Robot) -> float:
    """Return the friction level of a walk as a number; of a virtual robot the mean over joints of f/τ_max [-]."""
    if walk.robot is None:
        return float(walk.level)
    return round(float((parse_level(walk.level).coulomb(spec) / torque_limit).mean()), 6)


def _beside(walks: Sequence[Walk], done: Mapping[Walk, Metrics]) -> dict[str, Any]:
    """Return the fields that a row has in summary.json alone, see `rows_of`."""
    robots = dict.fromkeys(walk.robot for walk in walks if walk.robot is not None)
    each = {robot: combine([done[walk] for walk in walks if walk.robot == robot]) for robot in robots}
    samples = list(each.values()) or [done[walk] for walk in walks]
    crossed = [one.crossed for one in samples if one.crossed is not None]
    beside: dict[str, Any] = {
        "fall_interval": wilson(sum(one.fall_rate for one in samples), len(samples)),
        "crossed_interval": wilson(sum(crossed), len(crossed)) if crossed else None,
    }
    if each:
        beside["robots"] = {str(robot): one.speed_ratio for robot, one in each.items()}
        beside["robot_fall_rates"] = [one.fall_rate for one in samples]
        beside["robot_tracking_errors"] = [one.tracking_error for one in samples]
        beside["robot_crossed"] = crossed or None
    if known := {walk.robot: walk.known for walk in walks if walk.known is not None}:
        beside["known_friction"] = {
            "data sheet" if robot is None else str(robot): share for robot, share in known.items()
        }
    return beside


def sample_names(contracts: Mapping[str, Contract]) -> dict[str, str]:
    """Return policy -> suffix of its method, so that only policies that differ in their seed share a name.

    It names what groups of a method differ in, `deception (teacher.quiet 30)`; where a seed is twice in one, the
    policy.
    """
    groups: dict[tuple[tuple[str, ...], str | None], list[str]] = {}
    for name, contract in contracts.items():
        groups.setdefault((_sample_of(contract), key_of_settings(contract.settings)), []).append(name)
    suffixes = {}
    for (group, key), names in groups.items():
        others = [other for other in groups if other[0][0] == group[0]]
        seeds = {contracts[name].seed for name in names}
        words = _words(group, key, others)
        # Shortened, two may be the same words.
        if any(other != (group, key) and _words(*other, others) == words for other in others):
            words.append(f"as {names[0]}")
        for name in names:
            told = words if len(seeds) == len(names) else [name]
            suffixes[name] = f" ({', '.join(told)})" if told else ""
    return suffixes


def _words(group: tuple[str, ...], key: str | None, groups: Sequence[tuple[tuple[str, ...], str | None]]) -> list[str]:
    """Return what tells a group from the others of its method: what contracts say of all, then settings."""
    values = zip(*(other for other, _ in groups), strict=True)
    words = [own for own, of_method in zip(group, values, strict=True) if len(set(of_method)) > 1]
    recorded = {other for _, other in groups if other is not None}
    if key is None:
        return [*words, f"settings {MISSING}"] if recorded else words
    own, names = settings_in(key), set()
    for other in recorded:
        names |= {*differing(own, settings_in(other))}
    untold = [name for name in sorted(names) if not (words and name in TOLD)] if len(recorded) > 1 else []
    # What is the default goes without saying, where something is not.
    given = [name for name in untold if name in own] or ([] if words else untold)
    more = [f"{len(given) - SHOWN} more"] if len(given) > SHOWN else []
    return [*words, *(setting_text(own, name) for name in given[:SHOWN]), *more]


TOLD = (
    *("task.terrain.kind", "student.iterations", "teacher.latent"),
    *(f"task.friction.{name}" for name in ("level", "law", "range", "spread", "load")),
    *("task.timestep", "task.decimation", "task.history"),
)
"""Settings that the words of a contract tell where they differ."""


USUAL_SHAPE = (Law().static_ratio, Law().stribeck_velocity)
"""Numbers of the law `stribeck` that go without saying."""


def _sample_of(contract: Contract) -> tuple[str, ...]:
    """Return what two policies share that are samples of one training, in words; the method comes first."""
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
    """Return policy, as rows call it -> its method with the suffix of `sample_names`; bundles: those that walked."""
    names = sample_names({bundle.name: bundle.contract for bundle in bundles})
    # A bundle's own name may have a + in it.
    base = {row.policy: row.policy if row.policy in names else row.policy.rpartition("+")[0] for row in rows}
    return {row.policy: row.method + names[base[row.policy]] for row in rows}
