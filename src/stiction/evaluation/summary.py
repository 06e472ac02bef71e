"""Evaluation of several bundles under the same conditions, and its summary."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from stiction.core.errors import UNSAFE, ConfigurationError
from stiction.core.provenance import Origin
from stiction.deploy.check import check_for_simulation, record_notes
from stiction.evaluation.benches import forward_notes, unidentified_notes
from stiction.evaluation.course import untrained
from stiction.evaluation.grid import GridCfg
from stiction.evaluation.onset import onset_of
from stiction.evaluation.policies import OwnPolicy, method_of, own_policy
from stiction.evaluation.run import BENCHES, Progress, walk_grid
from stiction.evaluation.table import methods_of, rows_of, sample_names
from stiction.files.bundle import Bundle, find_bundle
from stiction.files.contract import limits_text, robot_of
from stiction.files.contract_rules import TARGET_LIMITS
from stiction.files.following import EVERY, scaled_commands
from stiction.files.results import ResultRow
from stiction.files.velocity import COMMANDS, FASTEST
from stiction.learning.identity import unrecorded_note
from stiction.robots.catalog import find_derived, find_robot, is_shipped
from stiction.robots.named import IMPORTED_ROBOT
from stiction.virtual.cases import warnings_on


def bundle_of(
    policy: Bundle | Path | str | Callable[..., Any],
    cfg: GridCfg,
    robot: str | None,
    callable_period: float,
    key: Path | None = None,
) -> Bundle:
    """Return a policy as a bundle for `evaluate_all`: a bundle, the path of one, or a function (`own_policy`).

    key: public key of the maker, a PEM file, required as the signer of a bundle at a path; None: any. A path's bundle
    is checked. Raises `StictionError` for damaged bundles, and functions without a robot or outside the engine mujoco.
    """
    if isinstance(policy, Bundle):
        return policy
    if isinstance(policy, Path):
        return check_for_simulation(find_bundle(policy), key)
    if robot is None:
        raise ConfigurationError("a function as policy needs a robot; give --robot")
    if not all(simulator.is_batch for simulator in cfg.simulators):
        raise ConfigurationError("a function as policy walks only in the engine mujoco; remove --engines")
    return own_policy(policy, robot, callable_period)


def other_limits(bundles: Sequence[Bundle]) -> dict[str, str]:
    """Return bundle -> its torque limits in words, where they differ from the shipped robot's.

    A friction level is a share of the contract's torque limits: policies of one robot may have different torques.
    """
    limits = {}
    for bundle in bundles:
        name = bundle.contract.robot.removesuffix(IMPORTED_ROBOT)
        if is_shipped(name) and (text := limits_text(bundle.contract, find_robot(name))):
            limits[bundle.name] = text
    return limits


def commands_for(bundles: Sequence[Bundle]) -> tuple[str, ...]:
    """Return the labels of the command set, scaled to the training range of all these policies."""
    ranges = [bundle.contract.command_range or {} for bundle in bundles]
    return scaled_commands(
        [min(max(map(abs, command_range.get(axis, (FASTEST,)))) for command_range in ranges) for axis in COMMANDS]
    )


def evaluate_all(
    bundles: Sequence[Bundle],
    cfg: GridCfg,
    out: Path,
    robot: str | None = None,
    jobs: int = 1,
    progress: Progress = lambda name, share: None,
) -> tuple[list[ResultRow], dict[str, Any]]:
    """Walk a grid; return its rows and the summary. Arguments and errors as of `walk_grid` and `check_names`.

    The commands `all` are scaled to the policies' training ranges; on each axis the smallest range counts.
    """
    if cfg.base.commands == (EVERY,):
        cfg = replace(cfg, base=replace(cfg.base, commands=commands_for(bundles)))
    check_names([bundle.name for bundle in bundles])
    origin, start = Origin.now(), time.perf_counter()
    done = walk_grid(bundles, cfg, out, jobs, robot, progress)
    rows, details = rows_of(done, bundles, robot)
    limits = other_limits(bundles)
    summary = {
        "evaluation": asdict(cfg.base),
        "engines": list(cfg.engines),
        "terrains": list(cfg.terrains),
        "robots": cfg.used_robots,
        "warnings": [
            *origin.warnings(),
            *(f"{robot}: {note}" for note in (find_derived(robot).notes if robot else ())),
            *(f"friction levels of {name} are shares of {of}" for name, of in limits.items()),
            *_untrained_notes(bundles, cfg),
            *record_notes(bundle for bundle in bundles if not isinstance(bundle, OwnPolicy)),
            *unlimited_note(bundles),
            *unrecorded_note(taken_together(bundles)),
            *warnings_on(cfg.used_robots),
            *forward_notes(bundles, cfg, out / BENCHES, robot),
            *unidentified_notes(done, bundles, cfg, out / BENCHES, robot),
        ],
        "torque_limits": limits,
        "forward": list(cfg.forward),
        "forward_by": list(cfg.forward_by),
        "conditions": cfg.base.conditions,
        "robot": robot,
        "seconds": time.perf_counter() - start,
        **origin.provenance,
        "policies": {bundle.name: describe(bundle) for bundle in bundles},
        "ways": methods_of(rows, bundles),
        "onset": {
            bundle.name: onset_of(
                bundle,
                [row for row in rows if row.policy == bundle.name],
                replace(cfg.base, commands=commands_for([bundle])),
            )
            for bundle in bundles
            # A policy that met friction follows up to its training's friction.
            if not isinstance(bundle, OwnPolicy) and not bundle.contract.met_friction
            if robot is None and cfg.base.terrain == "flat"
        },
        "rows": details,
    }
    return rows, summary


def unlimited_note(bundles: Sequence[Bundle]) -> list[str]:
    """Return a note on bundles whose targets are limited on a robot and not in an evaluation; empty without any."""
    # A function never runs on a robot.
    names = [b.name for b in bundles if b.contract.target_limits is None and not isinstance(b, OwnPolicy)]
    limits = f"{TARGET_LIMITS['slew']:g} rad/s and {TARGET_LIMITS['margin']:g} rad within the joints' limits"
    return [f"targets are limited only on a robot, to {limits}: {', '.join(names)}"] if names else []


def _untrained_notes(bundles: Sequence[Bundle], cfg: GridCfg) -> list[str]:
    """Return a note for each policy with commands outside its training range."""
    return [
        f"{bundle.name}: {note}; its rows beyond that range are untrained"
        for bundle in bundles
        # A function has no training range.
        if not isinstance(bundle, OwnPolicy) and (note := untrained(cfg.base.parsed_commands, bundle.contract))
    ]


def taken_together(bundles: Sequence[Bundle]) -> list[str]:
    """Return the names of bundles without recorded settings that share a sample with other bundles."""
    contracts = {bundle.name: bundle.contract for bundle in bundles if bundle.contract.settings is None}
    suffixes = sample_names({bundle.name: bundle.contract for bundle in bundles})
    groups = {name: method_of(contract) + suffixes[name] for name, contract in contracts.items()}
    shared = Counter(groups.values())
    return [name for name, group in groups.items() if shared[group] > 1]


LONGEST_NAME = 120
"""Maximum length of a policy's name."""


def check_names(names: Sequence[str], kind: str = "bundles") -> None:
    """Raise `StictionError` where two of a kind share a name, or a name cannot be shown in figures."""
    for name in names:
        if "$" in name or UNSAFE.search(name) or len(name) > LONGEST_NAME:
            raise ConfigurationError(
                f"{kind} called {name[:LONGEST_NAME]!r}: expected at most {LONGEST_NAME} characters, without $ and "
                "control characters; rename the directory"
            )
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ConfigurationError(
            f"two {kind} are called {twice[0]!r}; rename one directory, since results identify them by name"
        )


DESCRIBED = (
    *("robot", "method", "friction_law", "friction_level", "friction_range", "joints_file", "actuator"),
    *("known_friction", "seed", "phases", "settings", "revision", "command"),
)
"""Fields of the contract in the summary."""


def describe(bundle: Bundle) -> dict[str, Any]:
    """Return the identity of a policy: its digest, number of feet, and the fields `DESCRIBED` of its contract."""
    feet = len(robot_of(bundle.contract).feet)
    return {"digest": bundle.digest, "feet": feet} | {name: getattr(bundle.contract, name) for name in DESCRIBED}
