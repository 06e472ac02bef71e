"""The rows of one part of the comparison: walked now, or as far as they were walked before."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from stiction.formats.bundle import Bundle
from stiction.formats.contract import Contract
from stiction.formats.errors import StictionError
from stiction.formats.folder import make_folder
from stiction.formats.replication import PartRecord, read_parts
from stiction.transfer.grid.benches import all_made, bench_of
from stiction.transfer.grid.config import GridCfg
from stiction.transfer.grid.forward import forwarded, not_told
from stiction.transfer.grid.known import benches_of, informed, not_identified
from stiction.transfer.grid.ledger import Ledger
from stiction.transfer.grid.plan import Walk, plan, plan_forward
from stiction.transfer.grid.run import BENCHES, LEDGER, walk_grid
from stiction.transfer.grid.table import number, real_law, rows_of
from stiction.transfer.metrics import Metrics
from stiction.transfer.replication.plan import Part, conventional
from stiction.transfer.rollout import robot_of

Progress = Callable[[str, float], None]
"""Called with part and engine, and the share of its walks that is done."""

Key = tuple[Any, ...]
"""The values of `KEY`."""

KEY = ("policy", "engine", "friction_law", "friction_level", "terrain", "command")
"""Columns by which a row is known."""


def walk_part(part: Part, bundles: Sequence[Bundle], out: Path, jobs: int, progress: Progress) -> PartRecord:
    """Walk one grid, resumable; in its rows the method is the way of training.

    bundles: those that the part takes. out: folder of its ledger.
    """
    make_folder(out)
    grid = _grid(part, bundles)
    done = walk_grid(bundles, grid, out, jobs, None, lambda name, share: progress(f"{part.name}, {name}", share))
    return PartRecord(part.name, part.title, *rows_of(done, bundles), warnings=_not_known(done, bundles, grid, out))


def kept_part(part: Part, bundles: Sequence[Bundle], out: Path) -> PartRecord | None:
    """Return the rows of a grid that were walked before, those all of whose walks are in its ledger; walk nothing.

    None where there are none. Arguments as of `walk_part`; raises as `Ledger`.
    """
    if not bundles or not (out / LEDGER).exists():
        return None
    grid = _grid(part, bundles)
    ledger = Ledger(out / LEDGER, grid, {bundle.name: bundle.digest for bundle in bundles})
    walks = _planned(grid, bundles, out)
    done = {walk: found for walk in walks if (found := ledger.find(walk)) is not None}
    rows, details = rows_of(_whole(walks, done), bundles)
    kept = f"not asked for: {len(rows)} of {len({walk.cell for walk in walks})} rows, from walks that were there"
    not_known = _not_known(walks, bundles, grid, out)
    return PartRecord(part.name, part.title, rows, details, kept, not_known) if rows else None


def check_nothing_lost(now: Iterable[Mapping[Key, int]], report: Path, asked: Collection[str]) -> None:
    """Raise `StictionError` where a report has rows, or more walks in a row, that would not be written in their place.

    They are of another preset, of other policies or robots, or of a part that is not walked anew and was measured by
    other code.

    Args:
        now: row -> walks that will be in it, of every part in their order; the first part that has a row counts.
        report: the report's summary.json.
        asked: names of the parts that are walked anew.

    """
    walks: dict[Key, int] = {}
    for rows in now:
        walks = {**rows, **walks}
    for name, before in read_parts(report).items():
        if lost := sum(row["episodes"] > walks.get(key_of(row), 0) for row in before):
            add = "" if name in asked else f"add {name} to --parts, or "
            raise StictionError(
                f"{report.parent}: the report there has {lost} rows of the part {name!r} that this preset, these "
                f"policies and this code do not have, and would be replaced; {add}give another --out"
            )


def planned_rows(part: Part, bundles: Sequence[Bundle]) -> dict[Key, int]:
    """Return the rows that walking a part comes to, and how many walks are in each. Arguments as of `walk_part`."""
    if not bundles:
        return {}
    grid = _grid(part, bundles)
    fed = [replace(walk, forward=()) for walk in plan_forward(grid)]
    walks = [*plan([bundle.name for bundle in bundles], grid), *fed]
    counts = Counter(walk.cell for walk in walks)
    cells = {walk.cell: walk for walk in walks}
    contracts = {bundle.name: bundle.contract for bundle in bundles}
    return {row_key(walk, contracts[walk.policy]): counts[cell] for cell, walk in cells.items()}


def rows_in(details: Iterable[Mapping[str, Any]]) -> dict[Key, int]:
    """Return rows of summary.json, and how many walks are in each."""
    return {key_of(row): row["episodes"] for row in details}


def key_of(row: Mapping[str, Any]) -> Key:
    """Return by what a row of summary.json is known: one of every policy in every cell."""
    return tuple(row[name] for name in KEY)


def row_key(walk: Walk, contract: Contract) -> Key:
    """Return the same of the row that a walk will be in. contract: its policy's."""
    law = walk.law if walk.robot is None else real_law(walk)
    level = number(walk, contract.array("torque_limit"), robot_of(contract))
    return walk.name, walk.place.label, law, level, walk.terrain, walk.command


def _grid(part: Part, bundles: Sequence[Bundle]) -> GridCfg:
    """Return a part's grid, with the policies that walk with friction fed forward too."""
    if not part.forward:
        return part.grid
    return replace(part.grid, forward=tuple(b.name for b in bundles if conventional(b.contract)))


def _planned(grid: GridCfg, bundles: Sequence[Bundle], out: Path) -> list[Walk]:
    """Return every walk of a grid; those with friction fed forward only where every robot was on its bench."""
    specs = {bundle.name: robot_of(bundle.contract) for bundle in bundles}
    walks = plan(list(specs), grid)
    benches = [bench for walk in plan_forward(grid) if (bench := bench_of(walk, specs[walk.policy])) is not None]
    if all_made(benches, out / BENCHES):
        walks += forwarded(bundles, grid, out / BENCHES)
    told = all_made(benches_of(walks, bundles, grid), out / BENCHES)
    return informed(walks, bundles, grid, out / BENCHES) if told else walks


def _not_known(walks: Collection[Walk], bundles: Sequence[Bundle], grid: GridCfg, out: Path) -> list[str]:
    """Return sentences for what the benches did not tell: friction that is not fed forward, or told otherwise."""
    benches = out / BENCHES
    return [*not_told(bundles, grid, benches), *not_identified(walks, bundles, grid, benches)]


def _whole(walks: Sequence[Walk], done: Mapping[Walk, Metrics]) -> dict[Walk, Metrics]:
    """Return the walks of cells that are done to the last one, in the order of `walks`."""
    missing = Counter(walk.cell for walk in walks if walk not in done)
    return {walk: done[walk] for walk in walks if not missing[walk.cell]}
