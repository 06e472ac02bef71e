"""Walks the comparison, part by part, and puts together what it came to."""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from stiction.formats.bundle import Bundle
from stiction.formats.contract import Contract
from stiction.formats.errors import StictionError
from stiction.formats.following import following
from stiction.formats.replication import SUMMARY, PartRecord, Replication
from stiction.robots.spec import RobotSpec
from stiction.transfer.engines.catalog import what_is_missing
from stiction.transfer.grid.config import ALONE
from stiction.transfer.replication.budget import beside_forward, budget, onsets
from stiction.transfer.replication.claims import judge_all
from stiction.transfer.replication.evidence import Evidence
from stiction.transfer.replication.plan import Part
from stiction.transfer.replication.samples import samples
from stiction.transfer.replication.walked import (
    Progress,
    check_nothing_lost,
    kept_part,
    key_of,
    planned_rows,
    rows_in,
    walk_part,
)
from stiction.transfer.rollout import robot_of
from stiction.transfer.summary import check_names, describe
from stiction.transfer.ways import WAYS, way_of


def replicate(
    bundles: Sequence[Bundle],
    parts: Sequence[Part],
    out: Path,
    jobs: int = 1,
    progress: Progress = lambda name, share: None,
    summary: dict[str, Any] | None = None,
    asked: Collection[str] | None = None,
) -> Replication:
    """Walk every part that has policies, resumable, and judge the paper's sentences.

    Args:
        bundles: checked policies of one robot, each of another name.
        parts: the grids; the ledger of each is in a folder of its name in `out`.
        out: folder of the results; it exists.
        jobs: processes at once.
        progress: see `Progress`.
        summary: what the summary begins with: the command, and what `Origin` says.
        asked: names of the parts to walk, by default all; of the others what was walked before in `out` is judged too.

    Raises:
        StictionError: two bundles have one name, they are of several robots, none fits a part, as `walk_grid`, as
            `check_ways`, or as `check_nothing_lost`.

    """
    check_names([bundle.name for bundle in bundles])
    if len(robots := {bundle.contract.robot for bundle in bundles}) != 1:
        raise StictionError(f"policies of {len(robots)} robots ({', '.join(sorted(robots))}); expected those of one")
    check_ways(bundles)
    asked = [part.name for part in parts] if asked is None else asked
    check_engines([part for part in parts if part.name in asked], robot_of(bundles[0].contract))
    start = time.perf_counter()
    records = _once(_records(bundles, parts, out, jobs, progress, asked))
    by_name = {part.name: part for part in parts}
    spec = robot_of(bundles[0].contract)
    made = {
        **(summary or {}),
        "dead_band": spec.shank.torque_limit / spec.shank.stiffness,
        "grids": {record.name: _settings(by_name[record.name], record) for record in records},
        "seconds": time.perf_counter() - start,
        "policies": {bundle.name: describe(bundle) | {"way": way_of(bundle.contract)} for bundle in bundles},
    }
    return judged(records, spec, made)


def judged(records: Sequence[PartRecord], spec: RobotSpec, summary: dict[str, Any]) -> Replication:
    """Return what rows come to. records: no row twice; spec: the policies' robot; summary: how the rows were made."""
    evidence = Evidence.of(row for record in records for row in record.details)
    verdicts, behind = judge_all(evidence)
    return Replication(
        records,
        samples(evidence),
        budget(evidence),
        beside_forward(evidence),
        onsets(evidence, spec),
        following((row for record in records for row in record.rows), lambda row: row.method),
        verdicts,
        behind,
        {way: text for way, text in WAYS.items() if way in evidence.ways()},
        summary,
    )


def _records(
    bundles: Sequence[Bundle],
    parts: Sequence[Part],
    out: Path,
    jobs: int,
    progress: Progress,
    asked: Collection[str],
) -> list[PartRecord]:
    """Return the parts that have rows, those that are not asked for as they were; arguments as of `replicate`."""
    takes = {part.name: [bundle for bundle in bundles if part.takes(bundle.contract)] for part in parts}
    if not any(takes[part.name] for part in parts if part.name in asked):
        raise StictionError("no policy fits any part of the comparison; give policies for flat ground or for stairs")
    others = [part for part in parts if part.name not in asked]
    found = {part.name: kept_part(part, takes[part.name], out / part.name) for part in others}
    planned = {part.name: planned_rows(part, takes[part.name]) for part in parts if part.name in asked}
    kept = {name: rows_in(record.details) for name, record in found.items() if record is not None}
    check_nothing_lost([(planned | kept).get(part.name, {}) for part in parts], out / SUMMARY, asked)
    for part in parts:
        if part.name in asked and takes[part.name]:
            found[part.name] = walk_part(part, takes[part.name], out / part.name, jobs, progress)
    return [record for part in parts if (record := found.get(part.name)) is not None]


def _once(records: Sequence[PartRecord]) -> list[PartRecord]:
    """Return the parts without rows that a part before has: a cell that several parts walk is one row."""
    seen: set[tuple[object, ...]] = set()
    kept = []
    for record in records:
        pairs = []
        for row, detail in zip(record.rows, record.details, strict=True):
            cell = key_of(detail)
            if cell not in seen:
                pairs.append((row, detail))
            seen.add(cell)
        rows, details = [row for row, _ in pairs], [detail for _, detail in pairs]
        kept.append(replace(record, rows=rows, details=details))
    return kept


def check_ways(bundles: Sequence[Bundle]) -> None:
    """Raise `StictionError` where policies of one way are no seeds of one training: they would count as its samples.

    On flat ground and over stairs apart, they must be of one robot, ground and friction, and of a seed each.
    """
    groups: dict[tuple[str, bool], list[Bundle]] = {}
    for bundle in bundles:
        groups.setdefault((way_of(bundle.contract), bundle.contract.terrain == "flat"), []).append(bundle)
    for (way, _), own in groups.items():
        first, seeds = own[0], {own[0].contract.seed: own[0].name}
        for other in own[1:]:
            if (one := _trained(first.contract)) != (two := _trained(other.contract)):
                raise StictionError(
                    f"{first.name} and {other.name} are both of the way {way!r}, trained as {one} and as {two}; "
                    "expected seeds of one training: leave one of them out"
                )
            if (seed := other.contract.seed) in seeds:
                raise StictionError(
                    f"{seeds[seed]} and {other.name} are both of the way {way!r}, for {other.contract.terrain}, seed "
                    f"{seed}; expected one policy a way and seed"
                )
            seeds[seed] = other.name


def _trained(contract: Contract) -> str:
    """Return what the seeds of one training share: robot, ground, friction and the range of it."""
    low, high = contract.friction_range
    friction = f"{contract.friction_law} friction {contract.friction_level:.6g} from {low:.6g} to {high:.6g}"
    return f"{contract.robot} on {contract.terrain} with {friction}"


def check_engines(parts: Sequence[Part], spec: RobotSpec) -> None:
    """Raise `StictionError` where an engine of a part is not installed: before anything walks, or is trained."""
    for name in dict.fromkeys(place.engine for part in parts for place in part.grid.places if not place.is_batch):
        if why := what_is_missing(ALONE[name], spec):
            raise StictionError(why)


def _settings(part: Part, record: PartRecord) -> dict[str, Any]:
    """Return what a part asks, as plain data."""
    grid = part.grid
    return {
        "title": part.title,
        **({"kept": record.kept} if record.kept else {}),
        **({"warnings": list(record.warnings)} if record.warnings else {}),
        "engines": list(grid.engines),
        "terrains": list(grid.terrains),
        "robots": grid.used_robots,
        "robot_levels": list(grid.levels_of_robots) if grid.used_robots else [],
        "friction_levels": list(grid.base.friction_levels),
        "friction_law": grid.base.friction_law,
        "commands": list(grid.base.commands),
        "episodes": grid.base.episodes,
        "seconds": grid.base.seconds,
        "seed": grid.base.seed,
    }
