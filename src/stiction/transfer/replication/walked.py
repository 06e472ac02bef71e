"""The rows of one part of the comparison: walked now, or as far as they were walked before."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from stiction.formats.bundle import Bundle
from stiction.formats.errors import StictionError
from stiction.formats.folder import make_folder
from stiction.formats.replication import PartRecord, read_part
from stiction.transfer.grid.config import GridCfg
from stiction.transfer.grid.forward import bench_of, forwarded, not_told
from stiction.transfer.grid.ledger import Ledger
from stiction.transfer.grid.plan import Walk, plan, plan_forward
from stiction.transfer.grid.run import BENCHES, LEDGER, walk_grid
from stiction.transfer.grid.table import rows_of
from stiction.transfer.metrics import Metrics
from stiction.transfer.replication.plan import Part, conventional
from stiction.transfer.robot.identification import is_made
from stiction.transfer.rollout import robot_of

Progress = Callable[[str, float], None]
"""Called with part and engine, and the share of its walks that is done."""

KEY = ("policy", "engine", "friction_law", "friction_level", "terrain", "command")
"""Columns by which a row is known."""


def walk_part(part: Part, bundles: Sequence[Bundle], out: Path, jobs: int, progress: Progress) -> PartRecord:
    """Walk one grid, resumable; in its rows the method is the way of training.

    bundles: those that the part takes. out: folder of its ledger.
    """
    make_folder(out)
    grid = _grid(part, bundles)
    done = walk_grid(bundles, grid, out, jobs, None, lambda name, share: progress(f"{part.name}, {name}", share))
    left_out = not_told(bundles, grid, out / BENCHES)
    return PartRecord(part.name, part.title, *rows_of(done, bundles), warnings=left_out)


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
    left_out = not_told(bundles, grid, out / BENCHES)
    return PartRecord(part.name, part.title, rows, details, kept, left_out) if rows else None


def check_nothing_lost(part: Part, kept: PartRecord | None, report: Path) -> None:
    """Raise `StictionError` where a report has rows, or more walks in a row, of a part that is not walked anew.

    They are of another preset, of other policies or robots, or were measured by other code. kept: what would take their
    place. report: the report's summary.json.
    """
    before = read_part(report, part.name)
    now = {} if kept is None else {key_of(row): row["episodes"] for row in kept.details}
    lost = sum(row["episodes"] > now.get(key_of(row), 0) for row in before)
    if lost:
        raise StictionError(
            f"{report.parent}: the report there has {lost} rows of the part {part.name!r} that this preset, these "
            f"policies and this code do not have, and would be replaced; add {part.name} to --parts, or give another "
            "--out"
        )


def key_of(row: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return by what a row of summary.json is known: one of every policy in every cell."""
    return tuple(row[name] for name in KEY)


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
    if all(is_made(bench, out / BENCHES / bench.label) for bench in benches):
        walks += forwarded(bundles, grid, out / BENCHES)
    return walks


def _whole(walks: Sequence[Walk], done: Mapping[Walk, Metrics]) -> dict[Walk, Metrics]:
    """Return the walks of cells that are done to the last one, in the order of `walks`."""
    missing = Counter(walk.cell for walk in walks if walk not in done)
    return {walk: done[walk] for walk in walks if not missing[walk.cell]}
