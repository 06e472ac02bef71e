"""The page of the paper's comparison: verdicts, the friction budget, every method in every place, and clips."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stiction.formats.errors import StictionError
from stiction.formats.friction import has_coefficient
from stiction.formats.replication import Replication
from stiction.report.page import Section, figure_uri, file_uri, fold, paragraph, picture, render_page, row
from stiction.report.page import table as page_table
from stiction.report.replication_figures import draw_budget, draw_needs
from stiction.report.replication_tables import (
    counterpart_sheet,
    methods_sheet,
    needs_sheet,
    onset_sheet,
    stairs_sheet,
    verdict_sheet,
)
from stiction.report.sheet import Sheet

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.figure import Figure

TITLE = "Does it transfer? The paper's comparison"

SPOTS = (
    ("physx", 0.0, "coulomb", "Sim2Sim: PhysX, no friction"),
    ("ode", 0.0, "coulomb", "Sim2Sim: ODE, no friction"),
    ("ode-webots", 0.0, "coulomb", "Sim2Sim: ODE as Webots sets it up, no friction; not run in Webots"),
    ("physx", 0.2, "coulomb", "PhysX, 20 % of the torque limit in every joint"),
    ("physx+all", 0.01, "real", "The virtual robot at the paper's 1 %"),
    ("physx+all", 0.1, "real", "The virtual robot at 10 %"),
    ("physx+all", 0.2, "real", "The virtual robot at 20 %"),
    ("physx+rest", 0.0, "coulomb", "The virtual robot without friction: all else"),
    ("physx+friction", 0.2, "real", "The virtual robot's friction alone, 20 %"),
    ("physx+nominal", 0.0, "coulomb", "The virtual robot with nothing hidden"),
)
"""Engine, level, law, title of the tables of methods."""


def write_replication(out: Path, result: Replication, clips: Mapping[str, Path]) -> Path:
    """Write every file of the comparison into `out`; return the path of the page. `clips`: policy -> animated image.

    Raises:
        StictionError: the folder cannot be written.

    """
    figures = draw_figures(result)
    try:
        result.write(out)
        for name, figure in figures.items():
            figure.savefig(out / f"{name}.png", dpi=120, facecolor="white")
        sheets = sheets_of(result)
        (out / "tables.md").write_text("\n".join(sheet.markdown() for sheet in sheets), encoding="utf-8")
        page = out / "report.html"
        text = render_page(TITLE, sections(result, figures, clips), lead(result), warnings(result))
        page.write_text(text, encoding="utf-8")
    except OSError as error:
        raise StictionError(f"the results cannot be written to {out}: {error}; choose another --out") from error
    return page


def draw_figures(result: Replication) -> dict[str, Figure]:
    """Return the friction budget and who follows up to where."""
    ways = list(dict.fromkeys(point.method for point in result.budget))
    found = {"budget": draw_budget(result.budget, ways, result.summary["dead_band"])} if result.budget else {}
    torques = [onset for onset in result.onsets if not has_coefficient(onset.friction_law)]
    return found | ({"needs": draw_needs(torques, ways)} if torques else {})


def sheets_of(result: Replication) -> list[Sheet]:
    """Return the tables that a README can take."""
    first = [verdict_sheet(result.verdicts), needs_sheet(result.onsets), onset_sheet(result.onsets)]
    stairs = stairs_sheet(result)
    return [*first, *spot_sheets(result), *([stairs] if stairs else [])]


def spot_sheets(result: Replication) -> list[Sheet]:
    """Return the methods at every spot where some were walked."""
    found = (methods_sheet(result, *spot) for spot in SPOTS)
    return [sheet for sheet in found if sheet.rows]


def sections(result: Replication, figures: Mapping[str, Figure], clips: Mapping[str, Path]) -> list[Section]:
    """Return the sections of the page."""
    page = [Section("What became of the paper's sentences", verdict_sheet(result.verdicts).blocks())]
    if "needs" in figures:
        caption = "Up to which friction each way follows: the bar in all engines, a mark in each. Hollow: to the end."
        blocks = (picture(figure_uri(figures["needs"]), caption), *needs_sheet(result.onsets).blocks())
        page.append(Section("Which training does my joint need?", blocks))
    if "budget" in figures:
        caption = "Slower of forward and backward. Points: training seeds; band: 95 % t-interval; green: 80 to 120 %."
        blocks = (picture(figure_uri(figures["budget"]), caption), *onset_sheet(result.onsets).blocks())
        page.append(Section("The friction budget", blocks))
    if clips:
        shown = [picture(file_uri(path), name) for name, path in clips.items()]
        page.append(Section("Side by side: 0.5 m/s commanded, 20 % friction", (row(*shown),)))
    tables: list[Markup] = [block for sheet in spot_sheets(result) for block in sheet.blocks()]
    if tables:
        page.append(Section("Every method, place by place", tuple(tables)))
    if stairs := stairs_sheet(result):
        page.append(Section("Stairs", stairs.blocks()))
    page.append(Section("Where the paper's figures are", counterpart_sheet().blocks()))
    return [*page, Section("What was run", run_blocks(result))]


def run_blocks(result: Replication) -> tuple[Markup, ...]:
    """Return methods, policies, grids and machine."""
    summary = result.summary
    policies = [
        (name, p["way"], str(p["seed"]), p["revision"], p["digest"][:16], p["command"])
        for name, p in summary["policies"].items()
    ]
    grids = [paragraph(f"{name}: {json.dumps(grid)}") for name, grid in summary["grids"].items()]
    return (
        paragraph(f"Command: {summary['command']}"),
        page_table(("method", "what it is"), list(result.ways.items())),
        fold("Policies", [page_table(("policy", "method", "seed", "revision", "digest", "made by"), policies)]),
        fold("Grids", grids),
        paragraph(f"Revision {summary['revision']}, {summary['seconds']:.0f} s on {summary['machine']['cpu']}."),
        paragraph("Everything here is simulation. The virtual robot plays the real one; no robot was involved."),
    )


def lead(result: Replication) -> str:
    """Return the outcome in a sentence or two."""
    counts = Counter(verdict.outcome for verdict in result.verdicts)
    told = ", ".join(f"{number} {outcome}" for outcome, number in counts.items())
    needs = {cells[0]: cells[1] for cells in needs_sheet(result.onsets).rows}
    follow = f" With 20 % friction, who follows everywhere: {needs['20 %']}." if result.onsets else ""
    return f"Of {len(result.verdicts)} sentences and explanations: {told}.{follow}"


def warnings(result: Replication) -> list[str]:
    """Return what a reader must know before the numbers."""
    found: list[str] = []
    single: Sequence[str] = sorted({m.method for m in result.means if m.seeds == 1})
    if single:
        found.append(f"One training seed, a sample and no verdict: {', '.join(single)}.")
    missing = [way for way in ("none", "actuator", "deception") if way not in result.ways]
    if missing:
        found.append(f"Of the paper's three methods there is no policy here for: {', '.join(missing)}.")
    return found
