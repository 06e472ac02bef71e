"""The page of the experiment on training with friction, its figures, and its tables as Markdown."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup

from stiction.formats.errors import StictionError
from stiction.formats.experiment import Experiment
from stiction.formats.following import BAND
from stiction.formats.friction import level_text
from stiction.report.experiment_figures import draw_budget, draw_collapse, draw_conditions, draw_learning
from stiction.report.experiment_tables import (
    following_sheet,
    methods_sheet,
    onset_sheet,
    part_sheet,
    run_sheet,
    verdict_sheet,
)
from stiction.report.following import changes_sheet, judged_text
from stiction.report.page import Section, figure_uri, fold, paragraph, picture, render_page
from stiction.report.sheet import Sheet

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Training with dry friction in the joints"

CAPTIONS = {
    "budget": f"Thin: a seed. Thick: the mean over seeds, with its 95 % t-interval. Green: {BAND} of the command.",
    "learning": "Speed in training, randomised, noisy and pushed, under each method's own friction; all seeds, mean.",
    "conditions": "Students. A triangle is a seed and points where it is told to walk. A bar: the t-interval.",
    "collapse": "Friction of the shank on three axes. The axis on which curves agree is the one that predicts.",
    "load": "Friction that grows with the force and torque in the joint; trained at several coefficients.",
    "go1": "The same three ways to train, on a quadruped.",
}
"""Figure -> what to see in it."""

HEADINGS = {
    "budget": "Speed over friction",
    "learning": "How fast they learn",
    "conditions": "Every way of training, side by side",
    "collapse": "Which number predicts the onset",
    "load": "Friction that grows with load",
    "go1": "A robot that can fall",
}
"""Figure -> heading of its section."""


APART = ("following", "verdicts", "runs")
"""Tables that are not folded away."""


def write_experiment(out: Path, experiment: Experiment) -> Path:
    """Write every file of the experiment into `out`; return the path of the page.

    Raises `StictionError` where the folder cannot be written.
    """
    figures = draw_figures(experiment)
    try:
        experiment.write(out)
        for name, figure in figures.items():
            figure.savefig(out / f"{name}.png", dpi=110, facecolor="white")
        sheets = sheets_of(experiment)
        (out / "tables.md").write_text("\n".join(sheet.markdown() for sheet in sheets.values()), encoding="utf-8")
        page = out / "report.html"
        text = render_page(TITLE, sections(experiment, figures, sheets), lead(experiment), warnings(experiment))
        page.write_text(text, encoding="utf-8")
    except OSError as error:
        raise StictionError(f"the results cannot be written to {out}: {error}; choose another --out") from error
    return page


def draw_figures(experiment: Experiment) -> dict[str, Figure]:
    """Return the figures that the results so far have something to show in."""
    known = {mean.condition for mean in experiment.means}
    parts = {
        part: [c.name for c in experiment.conditions if c.part == part and c.name in known] for part in experiment.parts
    }
    figures = {}
    if parts["1"]:
        figures["budget"] = draw_budget(experiment, parts["1"])
        figures["learning"] = draw_learning(experiment, parts["1"])
    if walked := [name for part in ("1", "2", "3", "gait", "history") for name in parts[part]]:
        figures["conditions"] = draw_conditions(experiment, walked)
    if experiment.onsets:
        figures["collapse"] = draw_collapse(experiment)
    if parts["5"]:
        figures["load"] = draw_budget(experiment, parts["5"], "load")
    if parts["6"]:
        figures["go1"] = draw_budget(experiment, parts["6"])
    return figures


def sheets_of(experiment: Experiment) -> dict[str, Sheet]:
    """Return the tables in the order of the page."""
    first = [condition.name for condition in experiment.conditions if condition.part == "1"]
    sheets = {"verdicts": verdict_sheet(experiment)}
    if first:
        sheets["following"] = following_sheet(experiment, first)
        sheets |= {f"methods-{who}": methods_sheet(experiment, first, who) for who in ("student", "teacher")}
    used = {condition.part for condition in experiment.conditions}
    sheets |= {f"part-{part}": part_sheet(experiment, part) for part in experiment.parts if part in used}
    if experiment.onsets:
        sheets["onsets"] = onset_sheet(experiment)
    return sheets | {"runs": run_sheet(experiment)}


def sections(experiment: Experiment, figures: Mapping[str, Figure], sheets: Mapping[str, Sheet]) -> list[Section]:
    """Return the sections of the page: verdicts, figures, tables, what was run."""
    page = [Section(sheets["following"].title, sheets["following"].blocks())] if "following" in sheets else []
    changes = changes_sheet(experiment.summary)
    told = (fold(changes.title, changes.blocks()),) if changes else ()
    page.append(Section("What became of the paper's sentences", (*sheets["verdicts"].blocks(), *told)))
    for name, figure in figures.items():
        page.append(Section(HEADINGS[name], (picture(figure_uri(figure), CAPTIONS[name]),)))
    tables = [fold(sheet.title, sheet.blocks()) for name, sheet in sheets.items() if name not in APART]
    page.append(Section("Tables", tuple(tables)))
    return [*page, Section("What was run", _run_blocks(experiment, sheets["runs"]))]


def _run_blocks(experiment: Experiment, runs: Sheet) -> tuple[Markup, ...]:
    """Return what was run, on what, and how it was evaluated."""
    summary = experiment.summary
    settings = {name: value for name, value in summary["evaluation"].items() if name != "noise"}
    return (
        paragraph(f"Command: {summary['command']}"),
        paragraph(f"Evaluation: {json.dumps(settings)}; held fixed: {json.dumps(summary['conditions_of_evaluation'])}"),
        paragraph(f"Revision {summary['revision']}, on {summary['machine']['cpu']}."),
        *((paragraph(told),) if (told := judged_text(summary)) else ()),
        paragraph("Everything here is simulation. A training seed is one sample, however many episodes it walks."),
        fold(runs.title, (runs.html(),)),
    )


def lead(experiment: Experiment) -> str:
    """Return the answer in a few sentences: how far it has come, and how many sentences came out how."""
    finished = sum(run.state == "finished" for run in experiment.runs)
    outcomes = Counter(verdict.outcome for verdict in experiment.verdicts)
    said = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.most_common())
    return (
        f"{finished} of {len(experiment.runs)} runs are finished. Of {len(experiment.verdicts)} sentences of the paper "
        f"on training with friction: {said}."
        f"{_follow_text(experiment)}"
    )


def _follow_text(experiment: Experiment) -> str:
    """Say at which levels the students of each condition of the first part follow with every seed."""
    first = {f"{c.name}/student": c.name for c in experiment.conditions if c.part == "1"}
    said = []
    for way, name in first.items():
        own = [cell for cell in experiment.following if cell.method == way]
        sure = ", ".join(level_text("coulomb", cell.friction_level) for cell in own if cell.every_seed)
        if own:
            said.append(f"{name} at {sure or 'no tested level'}")
    return f" With every seed follow: {'; '.join(said)}." if said else ""


def warnings(experiment: Experiment) -> list[str]:
    """Return what a reader must know first: that the code changed meanwhile, and what is missing."""
    failed: Mapping[str, str] = experiment.summary["failed"]
    return [*experiment.summary["warnings"], *(f"{name} failed: {reason}" for name, reason in failed.items())]
