"""The page of the paper's comparison: verdicts, the friction budget, every method in every place, and clips."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from stiction.formats.errors import StictionError
from stiction.formats.following import BAND, LEAST
from stiction.formats.replication import Replication
from stiction.report.following import (
    changes_sheet,
    judged_text,
    needs_sentence,
    needs_sheet,
    places_sheet,
)
from stiction.report.page import Section, figure_uri, fold, paragraph, picture, render_page
from stiction.report.page import table as page_table
from stiction.report.replication_clips import ClipPair, clip_sections
from stiction.report.replication_figures import curves, draw_budget, draw_needs
from stiction.report.replication_methods import place_sheets, stairs_sheet
from stiction.report.replication_tables import (
    counterpart_sheet,
    evidence_sheet,
    forward_sheet,
    onset_sheet,
    verdict_sheet,
)
from stiction.report.sheet import Sheet

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.figure import Figure

TITLE = "Does it transfer? The paper's comparison"

SAID = 0.2
"""Friction of which the first sentence says who follows [-]: that of the training."""

REMEDY = (
    "A verdict takes several training seeds of every way that a sentence compares: give bundles or runs of each seed "
    "with --policies, or train them with --preset full. It has three seeds or more of every way "
    "on flat ground, and of `none` and `deception` over stairs. It has no policy of an Actuator Net for stairs: E9 is "
    "judged only where such policies are given."
)
"""What to do about a single seed."""


def write_replication(out: Path, result: Replication, clips: Sequence[ClipPair]) -> Path:
    """Write every file of the comparison into `out`; return the path of the page. clips: of some policies.

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
    """Return the friction budget and who follows where."""
    ways = list(dict.fromkeys(point.method for point in result.budget))
    found = {"budget": draw_budget(result.budget, ways, result.summary["dead_band"])} if curves(result.budget) else {}
    return found | ({"needs": draw_needs(result.needs, list(result.ways))} if result.needs else {})


def sheets_of(result: Replication) -> list[Sheet]:
    """Return the tables that a README can take."""
    needs = (needs_sheet(result.needs), places_sheet(result.needs)) if result.needs else ()
    changes = changes_sheet(result.summary)
    first = [*needs, onset_sheet(result.onsets), verdict_sheet(result.verdicts), *((changes,) if changes else ())]
    others = (*(forward_sheet(result.forward, virtual) for virtual in (True, False)), stairs_sheet(result.samples))
    return [*first, *(sheet for sheet in others if sheet), *place_sheets(result.samples)]


def sections(result: Replication, figures: Mapping[str, Figure], clips: Sequence[ClipPair]) -> list[Section]:
    """Return the sections of the page: what a robot builder needs, the verdicts, then all the rest folded."""
    page = []
    if "needs" in figures:
        caption = (
            "Training seeds that follow. ▼ too slow, ▲ too fast, × fell; a seed can be too slow one way, too fast "
        )
        caption += "the other."
        table = fold("The same place by place, in numbers", places_sheet(result.needs).blocks())
        blocks = (*needs_sheet(result.needs).blocks(), picture(figure_uri(figures["needs"]), caption), table)
        page.append(Section("Which training does my joint need?", blocks))
    if "budget" in figures:
        caption = f"Slower of forward and backward. Points: training seeds; band: 95 % t-interval; green: {BAND}."
        table = fold(f"Where each way slows under {LEAST}, in numbers", onset_sheet(result.onsets).blocks())
        page.append(Section("The friction budget", (picture(figure_uri(figures["budget"]), caption), table)))
    page += clip_sections(clips)
    if fed := forward_blocks(result):
        page.append(Section("Is it enough to feed friction forward?", fed))
    page.append(Section("What became of the paper's sentences", verdict_blocks(result)))
    if stairs := stairs_sheet(result.samples):
        page.append(Section("Stairs", stairs.blocks()))
    if places := place_sheets(result.samples):
        page.append(Section("Every method, place by place", tuple(fold(one.title, one.blocks()) for one in places)))
    page.append(Section("Where the paper's figures are", counterpart_sheet().blocks()))
    return [*page, Section("What was run", run_blocks(result))]


def forward_blocks(result: Replication) -> tuple[Markup, ...]:
    """Return what feeding friction forward came to: on the virtual robot, and behind a fold where f is known."""
    robot, sheet = (forward_sheet(result.forward, virtual) for virtual in (True, False))
    return (*(robot.blocks() if robot else ()), *((fold(sheet.title, sheet.blocks()),) if sheet else ()))


def verdict_blocks(result: Replication) -> tuple[Markup, ...]:
    """Return the verdicts, and behind a fold for each its numbers, their intervals and the rows that it read."""
    sheet = verdict_sheet(result.verdicts)
    short = replace(sheet, header=sheet.header[:-1], rows=tuple(cells[:-1] for cells in sheet.rows))
    folds = []
    for verdict in result.verdicts:
        rows = evidence_sheet(verdict.id, result.behind)
        blocks = [paragraph(verdict.evidence), *(rows.blocks() if rows.rows else ())]
        folds.append(fold(f"{verdict.id}: {verdict.outcome}", blocks))
    changes = changes_sheet(result.summary)
    told = (fold(changes.title, changes.blocks()),) if changes else ()
    return (*short.blocks(), *told, fold("Numbers, intervals and the rows behind each sentence (evidence.csv)", folds))


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
        *((paragraph(again),) if (again := judged_text(summary)) else ()),
        paragraph("Everything here is simulation. The virtual robot plays the real one; no robot was involved."),
    )


def lead(result: Replication) -> str:
    """Return the outcome in a sentence or two; where every way has one training seed, first that nothing is judged."""
    single, several = seeds_of_ways(result)
    told = ""
    if several:
        counts = Counter(verdict.outcome for verdict in result.verdicts)
        outcomes = ", ".join(f"{number} {outcome}" for outcome, number in counts.items())
        told = f"Of {len(result.verdicts)} sentences and explanations: {outcomes}."
    elif single:
        told = f"One training seed a way: numbers, no verdicts. {REMEDY}"
    return f"{told} {needs_sentence(result.needs, SAID)}".strip()


def seeds_of_ways(result: Replication) -> tuple[list[str], list[str]]:
    """Return the ways of training of which one seed walked, and those of several; on stairs apart from flat ground."""
    seeds: dict[str, set[str]] = {}
    for sample in result.samples:
        where = sample.method if sample.terrain == "flat" else f"{sample.method} on stairs"
        seeds.setdefault(where, set()).update(sample.seeds.split())
    return [way for way, own in seeds.items() if len(own) == 1], [way for way, own in seeds.items() if len(own) > 1]


def warnings(result: Replication) -> list[str]:
    """Return what a reader must know before the numbers."""
    found: list[str] = list(result.summary.get("warnings", []))
    failed: Mapping[str, str] = result.summary.get("failed", {})
    found += [f"Not trained, and left out: {name}. {reason}" for name, reason in failed.items()]
    single, several = seeds_of_ways(result)
    if single and several:
        found.append(f"One training seed, a number and no verdict: {', '.join(single)}. {REMEDY}")
    kept = [f"{part.title} ({part.kept})" for part in result.parts if part.kept]
    if kept:
        found.append(f"Not walked by this command: {'; '.join(kept)}.")
    found += [f"{part.title}. {warning}" for part in result.parts for warning in part.warnings]
    missing = [way for way in ("none", "actuator", "deception") if way not in result.ways]
    if missing:
        found.append(f"Of the paper's three methods there is no policy here for: {', '.join(missing)}.")
    return found
