"""Walks the comparison, part by part, and puts together what it came to."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from stiction.core.errors import ConfigurationError, EngineError, FileError
from stiction.core.records import make_folder
from stiction.engines.catalog import missing_engine
from stiction.evaluation.benches import forward_notes, unidentified_notes
from stiction.evaluation.grid import GridCfg
from stiction.evaluation.policies import FED_BY, method_of, method_texts
from stiction.evaluation.run import BENCHES, walk_grid
from stiction.evaluation.samples import samples
from stiction.evaluation.summary import check_names, describe
from stiction.evaluation.table import rows_of
from stiction.files.bundle import Bundle
from stiction.files.contract import Contract, robot_of
from stiction.files.results import read_summary
from stiction.learning.identity import difference
from stiction.robots.catalog import find_robot, robot_in_file
from stiction.robots.model import Robot
from stiction_experiments.lab.claims import Verdict, rejudged_summary
from stiction_experiments.lab.evidence import Evidence
from stiction_experiments.lab.straight import following
from stiction_experiments.replication.budget import beside_forward, budget, onsets
from stiction_experiments.replication.claims import judge_all
from stiction_experiments.replication.plan import Part, conventional
from stiction_experiments.replication.records import SUMMARY, PartRecord, Replication

Progress = Callable[[str, float], None]
"""Called with part and engine, and the share of its walks that is done."""

Key = tuple[Any, ...]
"""By what a row is known: policy, engine, friction law and level, terrain, command."""


def walk_part(part: Part, bundles: Sequence[Bundle], out: Path, jobs: int, progress: Progress) -> PartRecord:
    """Walk one grid, resumable. bundles: those that the part takes. out: folder of its ledger."""
    make_folder(out)
    grid = _grid(part, bundles)
    done = walk_grid(bundles, grid, out, jobs, None, lambda name, share: progress(f"{part.name}, {name}", share))
    _, details = rows_of(done, bundles)
    benches = out / BENCHES
    notes = [*forward_notes(bundles, grid, benches), *unidentified_notes(done, bundles, grid, benches)]
    return PartRecord(part.name, part.title, details, notes)


def key_of(row: Mapping[str, Any]) -> Key:
    """Return by what a row of summary.json is known: one of every policy in every cell."""
    columns = ("policy", "engine", "friction_law", "friction_level", "terrain", "command")
    return tuple(row[name] for name in columns)


TOLD = (
    "Policies of the method `told` are given, on each virtual robot, the friction that identification found in the log "
    "of that robot's own bench, as by `stiction evaluate --known-friction bench`; on the robot of the data sheet, that "
    "of the walk. What a bench does not tell is the nominal one of training, and stands among the warnings."
)
"""Friction told to policies that observe their joints' friction; for the page."""


def _grid(part: Part, bundles: Sequence[Bundle]) -> GridCfg:
    """Return a part's grid, with the policies that walk with friction fed forward too, in every way.

    Policies that observe their joints' friction are told what each robot's bench found: see `TOLD`.
    """
    grid = replace(part.grid, base=replace(part.grid.base, known_friction="bench"))
    if not part.forward:
        return grid
    fed = tuple(bundle.name for bundle in bundles if conventional(bundle.contract))
    return replace(grid, forward=fed, forward_by=tuple(FED_BY))


def replicate(
    bundles: Sequence[Bundle],
    parts: Sequence[Part],
    out: Path,
    jobs: int = 1,
    progress: Progress = lambda name, share: None,
    summary: dict[str, Any] | None = None,
) -> Replication:
    """Walk every part that has policies, resumable, and judge the paper's sentences.

    Args:
        bundles: checked policies of one robot, each of another name.
        parts: the grids; the ledger of each is in a folder of its name in `out`.
        out: folder of the results; it exists.
        jobs: processes at once.
        progress: see `Progress`.
        summary: what the summary begins with: the command, and what `Origin` says.

    Raises:
        StictionError: two bundles have one name, they are of several robots, none fits a part, `out` has a report of
            other parts too, as `walk_grid`, or as `check_methods`.

    """
    check_names([bundle.name for bundle in bundles])
    if len(robots := {bundle.contract.robot for bundle in bundles}) != 1:
        raise ConfigurationError(
            f"policies of {len(robots)} robots ({', '.join(sorted(robots))}); expected those of one"
        )
    check_methods(bundles)
    spec = robot_of(bundles[0].contract)
    check_engines(parts, spec)
    by_name = {part.name: part for part in parts}
    if (out / SUMMARY).exists():
        before = read_summary(out / SUMMARY).get("parts", {})
        if lost := ", ".join(name for name in before if name not in by_name):
            raise ConfigurationError(
                f"{out}: the report there also has the parts {lost}, and would be replaced; add them to --parts, walks "
                "that are there are not walked again, or give another --out"
            )
    takes = {part.name: [bundle for bundle in bundles if part.takes(bundle.contract)] for part in parts}
    if not any(takes.values()):
        raise ConfigurationError(
            "no policy fits any part of the comparison; give policies for flat ground or for stairs"
        )
    start = time.perf_counter()
    records = _once(
        [walk_part(part, takes[part.name], out / part.name, jobs, progress) for part in parts if takes[part.name]]
    )
    facts = {
        **(summary or {}),
        "dead_band": spec.dead_band,
        "grids": {record.name: _settings(by_name[record.name], record) for record in records},
        **({"told": TOLD} if any("known_friction" in row for one in records for row in one.details) else {}),
        "seconds": time.perf_counter() - start,
        "policies": {bundle.name: describe(bundle) | {"way": method_of(bundle.contract)} for bundle in bundles},
    }
    return judged(records, spec, facts)


def judged(records: Sequence[PartRecord], spec: Robot, summary: dict[str, Any]) -> Replication:
    """Return what rows come to. records: no row twice; spec: the policies' robot; summary: how the rows were made."""
    evidence = Evidence.of(row for record in records for row in record.details)
    verdicts, read = judge_all(evidence)
    return Replication(
        records,
        samples(evidence),
        budget(evidence),
        beside_forward(evidence),
        onsets(evidence, spec),
        following((row for record in records for row in record.rows), lambda row: row.method),
        verdicts,
        read,
        {method: text for method, text in method_texts().items() if method in evidence.methods()},
        summary,
    )


def _once(records: Sequence[PartRecord]) -> list[PartRecord]:
    """Return the parts without rows that a part before has: a cell that several parts walk is one row."""
    seen: set[Key] = set()
    once = []
    for record in records:
        new = [row for row in record.details if key_of(row) not in seen]
        seen.update(map(key_of, new))
        once.append(replace(record, details=new))
    return once


def check_methods(bundles: Sequence[Bundle]) -> None:
    """Raise `StictionError` where policies of one method are no seeds of one training: they would count as its samples.

    On flat ground and over stairs apart, they must be of one robot, ground and friction, of the same settings as far as
    those are recorded, and of a seed each.
    """
    groups: dict[tuple[str, bool], list[Bundle]] = {}
    for bundle in bundles:
        groups.setdefault((method_of(bundle.contract), bundle.contract.terrain == "flat"), []).append(bundle)
    for (method, _), members in groups.items():
        _check_settings(method, [bundle for bundle in members if bundle.contract.settings is not None])
        first, *others = members
        seeds = {first.contract.seed: first.name}
        for other in others:
            if (one := _trained(first.contract)) != (two := _trained(other.contract)):
                raise ConfigurationError(
                    f"{first.name} and {other.name} are both of the method {method!r}, trained as {one} and as {two}; "
                    "expected seeds of one training: leave one of them out"
                )
            if (seed := other.contract.seed) in seeds:
                raise ConfigurationError(
                    f"{seeds[seed]} and {other.name} are both of the method {method!r}, for {other.contract.terrain}, "
                    f"seed {seed}; expected one policy a method and seed"
                )
            seeds[seed] = other.name


def _check_settings(method: str, bundles: Sequence[Bundle]) -> None:
    """Raise `StictionError` where the settings of two trainings of a method differ. bundles: those that have them."""
    for other in bundles[1:]:
        if pair := difference(bundles[0].contract.settings, other.contract.settings):
            raise ConfigurationError(
                f"{bundles[0].name} and {other.name} are both of the method {method!r}, trained with {pair[0]} and "
                f"with {pair[1]}; expected seeds of one training: leave one of them out"
            )


def unrecorded(bundles: Sequence[Bundle]) -> list[str]:
    """Return the names of the policies that count as seeds of a method although their settings are not recorded."""
    groups = Counter((method_of(bundle.contract), bundle.contract.terrain) for bundle in bundles)
    return [
        bundle.name
        for bundle in bundles
        if bundle.contract.settings is None and groups[method_of(bundle.contract), bundle.contract.terrain] > 1
    ]


def _trained(contract: Contract) -> str:
    """Return what the seeds of one training share: robot, ground, friction and the range of it."""
    low, high = contract.friction_range
    friction = f"{contract.friction_law} friction {contract.friction_level:.6g} from {low:.6g} to {high:.6g}"
    more = {"spread": contract.friction_spread, "load": contract.friction_load}
    friction += "".join(f", {name} {span[0]:g} to {span[1]:g}" for name, span in more.items() if span is not None)
    return f"{contract.robot} on {contract.terrain} with {friction}"


def check_engines(parts: Sequence[Part], spec: Robot) -> None:
    """Raise `StictionError` where an engine of a part is not installed: before anything walks, or is trained."""
    for name in dict.fromkeys(one.spec.name for part in parts for one in part.grid.simulators if not one.is_batch):
        if why := missing_engine(name, spec):
            raise EngineError(why)


def _settings(part: Part, record: PartRecord) -> dict[str, Any]:
    """Return what a part asks, as plain data."""
    grid, base = part.grid, asdict(part.grid.base)
    asked = ("friction_levels", "friction_law", "commands", "episodes", "seconds", "seed")
    return {
        "title": part.title,
        **({"warnings": list(record.warnings)} if record.warnings else {}),
        "engines": list(grid.engines),
        "terrains": list(grid.terrains),
        "robots": grid.used_robots,
        "robot_levels": list(grid.levels_of_robots) if grid.used_robots else [],
        **{name: base[name] for name in asked},
    }


def judge_again(out: Path, provenance: dict[str, Any]) -> Replication:
    """Return the comparison that a folder has, judged anew; its summary says so, and which verdicts changed.

    provenance: by what it is judged now: the command, and what `Origin` says.

    Raises:
        StictionError: the folder has no summary of a comparison.

    """
    before = read_summary(out / SUMMARY)
    try:
        records = [_record(name, part, before["grids"][name]) for name, part in before["parts"].items()]
        verdicts = [Verdict(**one) for one in before["verdicts"]]
        (robot,) = {policy["robot"] for policy in before["policies"].values()}
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(
            f"{out / SUMMARY} is no summary of `stiction replicate` ({error!r}); expected one that it wrote"
        ) from error
    result = judged(records, find_robot(robot_in_file(robot, str(out / SUMMARY), "walk it again")), {})
    summary = rejudged_summary(before, verdicts, result.verdicts, provenance, own=("ways", "warnings"))
    return replace(result, summary=summary)


def _record(name: str, part: dict[str, Any], grid: dict[str, Any]) -> PartRecord:
    record = PartRecord(name, part["title"], part["rows"], grid.get("warnings", ()))
    _ = record.rows  # Raises `KeyError` here, where the file is named, if a row lacks a column.
    return record
