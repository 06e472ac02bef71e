"""The page of the experiment on training with friction, its figures, and its tables as Markdown."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from stiction.files.results import DIRECTIONS, ResultRow
from stiction.files.velocity import parse_command
from stiction.joints.friction import level_axis, level_number
from stiction.report.following import shade_following
from stiction.report.page import (
    INK,
    Section,
    Sheet,
    figure_block,
    fold,
    label_ends,
    legend,
    line_look,
    new_figure,
    paragraph,
    same_scale,
    settings_table,
)
from stiction_experiments.friction.answer import compared, has_claims, lead, named, question
from stiction_experiments.friction.learned import learned_sheets
from stiction_experiments.friction.manifest import TWO_PHASE
from stiction_experiments.friction.records import HIGHEST, STUDENT, ConditionRecord, Experiment, SeedMean, short_name
from stiction_experiments.lab import study
from stiction_experiments.lab.claims import JUDGED
from stiction_experiments.lab.following import changes_sheet, stalled_text
from stiction_experiments.lab.straight import BAND, DEFINITION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WORDS = dict(zip(DIRECTIONS, ("forward", "backward"), strict=True))

MOST_TOGETHER = 5
"""Conditions that one pair of axes can show; more have a panel each."""

ACROSS = 3
"""Such panels beside each other."""


def _band(axis: Axes) -> None:
    """Shade the speeds that count as following, and mark standing still."""
    shade_following(axis)
    axis.axhline(0.0, color=INK, linewidth=0.8)


def policies_of(experiment: Experiment) -> list[str]:
    """Return which policies of a run were evaluated: its student, and of two phases its teacher. Always the student."""
    return [STUDENT, *sorted({mean.who for mean in experiment.means} - {STUDENT})]


def rows_of(experiment: Experiment, condition: str, who: str = STUDENT) -> list[ResultRow]:
    """Return the rows of one policy of a condition, all seeds, forward and backward."""
    named = (row for row in experiment.rows if row.policy == f"{condition}-s{row.seed}/{who}")
    return [row for row in named if row.command in WORDS]


def means_of(experiment: Experiment, condition: str, who: str = STUDENT) -> list[SeedMean]:
    """Return the means over its seeds, by rising level."""
    own = (m for m in experiment.means if (m.condition, m.who) == (condition, who) and m.command in WORDS)
    return sorted(own, key=lambda m: m.friction_level)


def draw_budget(experiment: Experiment, conditions: Sequence[str]) -> Figure:
    """Return speed ratio over friction level: panels for student and teacher, forward and backward.

    A thin line is a seed, a thick one their mean, the band around it the 95 % t-interval.
    """
    evaluated = policies_of(experiment)
    figure, axes = new_figure(len(evaluated), 2, size=(9.6, 3.2 * len(evaluated)))
    panels = [(who, command) for who in evaluated for command in WORDS]
    for axis, (who, command) in zip(axes, panels, strict=True):
        _band(axis)
        for condition in conditions:
            look = line_look(condition, conditions)
            means = [m for m in means_of(experiment, condition, who) if m.command == command]
            _draw_mean(axis, means, look, short_name(condition))
            _draw_interval(axis, means, look)
            rows = rows_of(experiment, condition, who)
            _draw_seeds(axis, [row for row in rows if row.command == command], look)
        speed = abs(parse_command(command).velocity[0])
        axis.set(title=f"{who}, {WORDS[command]}, {speed:g} m/s", ylabel="speed reached / commanded")
    for axis in axes[-2:]:
        axis.set_xlabel(level_axis("coulomb"))
    same_scale(axes)
    for axis in axes[1::2]:
        label_ends(axis)
    legend(axes[0])
    return figure


def _draw_seeds(axis: Axes, rows: Sequence[ResultRow], look: Mapping[str, Any]) -> None:
    """Draw a thin line a seed over levels. look: of `line_look`."""
    seeds: dict[int, list[tuple[float, float]]] = {}
    for row in rows:
        if row.speed_ratio is not None:
            seeds.setdefault(row.seed, []).append((level_number("coulomb", row.friction_level), row.speed_ratio))
    for points in map(sorted, seeds.values()):
        axis.plot(*zip(*points, strict=True), linewidth=0.6, alpha=0.6, marker=".", markersize=3, **look)


def _draw_mean(axis: Axes, means: Sequence[SeedMean], look: Mapping[str, Any], label: str) -> None:
    """Draw the mean over levels. look: of `line_look`."""
    levels = [level_number("coulomb", m.friction_level) for m in means]
    axis.plot(levels, [m.mean for m in means], linewidth=2, label=label, **look)


def _draw_interval(axis: Axes, means: Sequence[SeedMean], look: Mapping[str, Any]) -> None:
    """Draw the interval of the mean over levels. Of two seeds it would be wider than the figure: both are lines."""
    points = [(level_number("coulomb", m.friction_level), m) for m in means]
    if known := [(at, m.low, m.high) for at, m in points if m.low is not None and m.seeds > 2]:
        levels, low, high = zip(*known, strict=True)
        axis.fill_between(levels, low, high, color=look["color"], alpha=0.15, linewidth=0)


def draw_each(experiment: Experiment, conditions: Sequence[str]) -> Figure:
    """Return speed ratio over friction level, a panel for each condition and policy.

    A thin line is a seed, a thick one their mean.
    """
    pairs = [(who, name) for who in policies_of(experiment) for name in conditions if means_of(experiment, name, who)]
    rows = -(-len(pairs) // ACROSS)
    figure, axes = new_figure(rows, ACROSS, size=(9.6, 0.4 + 2.4 * rows))
    commands = list(WORDS)
    for axis, (who, name) in zip(axes, pairs, strict=False):
        _band(axis)
        means, walked = means_of(experiment, name, who), rows_of(experiment, name, who)
        for command in commands:
            look = line_look(command, commands)
            _draw_seeds(axis, [row for row in walked if row.command == command], look)
            _draw_mean(axis, [m for m in means if m.command == command], look, WORDS[command])
        seeds = len({row.seed for row in walked})
        own = short_name(name) if who == STUDENT else f"{short_name(name)}, {who}"
        axis.set_title(f"{own}, {seeds} seed{'s' * (seeds > 1)}")
    used, unused = axes[: len(pairs)], axes[len(pairs) :]
    for axis in unused:
        axis.set_visible(False)
    same_scale(used)
    for axis in used[::ACROSS]:
        axis.set_ylabel("reached / commanded")
    for axis in used[-ACROSS:]:
        axis.set_xlabel(level_axis("coulomb"))
    legend(used[0])
    return figure


def draw_learning(experiment: Experiment, conditions: Sequence[str]) -> Figure:
    """Return speed ratio in training over the teacher's iterations: a thin line a seed, a thick one their mean."""
    figure, axes = new_figure(1, 2, size=(9.6, 3.4))
    for axis, (name, title) in zip(axes, (("forward_ratio", "forward"), ("backward_ratio", "backward")), strict=True):
        _band(axis)
        for condition in conditions:
            look = line_look(condition, conditions)
            curves: dict[str, list[tuple[int, float]]] = {}
            for point in experiment.curves:
                if point.phase == "teacher" and point.run.rpartition("-s")[0] == condition:
                    curves.setdefault(point.run, []).append((point.iteration, getattr(point, name)))
            for curve in curves.values():
                axis.plot(*zip(*curve, strict=True), linewidth=0.6, alpha=0.6, **look)
            if curves:
                ends = [end for end, _ in min(curves.values(), key=len)]
                mean = np.mean([[ratio for _, ratio in curve[: len(ends)]] for curve in curves.values()], axis=0)
                axis.plot(ends, mean, linewidth=2, label=short_name(condition), **look)
        axis.set(title=f"{title}, while training", xlabel="iteration")
    axes[0].set_ylabel("speed reached / commanded")
    label_ends(axes[-1])
    legend(axes[0])
    return figure


def _is_at(row: ResultRow | SeedMean, level: float) -> bool:
    return abs(row.friction_level - level) < 1e-6


def mean_text(mean: SeedMean | None) -> str:
    """Return a mean with half the width of its interval, `0.93 ± 0.05`; without one where there is a single seed."""
    if mean is None:
        return "–"
    return f"{mean.mean:.2f}" if mean.high is None else f"{mean.mean:.2f} ± {mean.high - mean.mean:.2f}"


def methods_sheet(experiment: Experiment, conditions: Sequence[str], who: str) -> Sheet:
    """Return the speed ratio of some conditions over the levels up to `HIGHEST`, a row for each direction."""
    own = [m for condition in conditions for m in means_of(experiment, condition, who)]
    means = {(m.condition, m.command, m.friction_level): m for m in own}
    levels = sorted({m.friction_level for m in own if m.friction_level <= HIGHEST})
    rows = [
        (f"{short_name(name)}, {word}", *(mean_text(means.get((name, command, level))) for level in levels))
        for name in conditions
        for command, word in WORDS.items()
    ]
    header = (f"{who}, speed ratio [1] at friction [of τ_max]", *(f"{100 * level:g} %" for level in levels))
    counts = sorted({m.seeds for m in own})
    seeds = "1 seed" if counts == [1] else f"{' or '.join(map(str, counts))} seeds"
    note = f"Speed reached over commanded, mean and 95 % t-interval over {seeds}." if counts else ""
    return Sheet(f"Speed over friction, {who}", header, tuple(rows), note)


def following_sheet(experiment: Experiment, conditions: Sequence[str]) -> Sheet:
    """Return how many seeds of some conditions follow, a column a level up to `HIGHEST`, students before teachers."""
    how, evaluated = named(experiment), policies_of(experiment)
    names = {
        f"{name}/{who}": f"{how[name]}, {who}" if len(evaluated) > 1 else how[name]
        for who in evaluated
        for name in conditions
    }
    own = [cell for cell in experiment.following if cell.method in names]
    levels = sorted({cell.friction_level for cell in own if cell.friction_level <= HIGHEST})
    at = {(cell.method, cell.friction_level): cell.text for cell in own}
    tried = {cell.method for cell in own}
    rows = [(text, *(at.get((name, level), "–") for level in levels)) for name, text in names.items() if name in tried]
    header = ("seeds that follow at friction [of τ_max]", *(f"{100 * level:g} %" for level in levels))
    walked = {
        row: name for name in names for row in rows_of(experiment, *name.split("/")) if row.friction_level in levels
    }
    note = f"{DEFINITION} {stalled_text(walked, lambda row: names[walked[row]])}".rstrip()
    return Sheet("How many training seeds follow", header, tuple(rows), note)


def part_sheet(experiment: Experiment, part: str) -> Sheet:
    """Return teacher and student of a part's conditions at no friction, the mean of training, and the nominal level."""
    own = [condition for condition in experiment.conditions if condition.part == part]
    rows = [_condition_row(experiment, condition, who) for condition in own for who in policies_of(experiment)]
    header = (
        *("condition", "policy", "seeds", "speed ratio without friction [1]", "at the mean of training [1]"),
        *("at the nominal friction [1]", "falls [% of walks]", "jitter [rad/s²]", "tripod [% of moving steps]"),
    )
    note = (
        "Speed reached over commanded, forward / backward, mean over seeds with its 95 % t-interval where there are "
        "several. Falls, jitter and tripod share: at the nominal friction, mean over both directions and seeds."
    )
    return Sheet(experiment.parts[part], header, tuple(rows), note)


def _condition_row(experiment: Experiment, condition: ConditionRecord, who: str) -> tuple[str, ...]:
    cells = []
    for level in (0.0, condition.training_mean, condition.nominal):
        means = {m.command: m for m in means_of(experiment, condition.name, who) if _is_at(m, level)}
        cells.append(" / ".join(mean_text(means.get(command)) for command in WORDS))
    rows = [row for row in rows_of(experiment, condition.name, who) if _is_at(row, condition.nominal)]
    seeds = len({row.seed for row in rows})
    figures = (_mean(rows, "fall_rate", ".0%"), _mean(rows, "joint_jitter", ".0f"), _mean(rows, "tripod_share", ".0%"))
    return f"{condition.name}: {condition.purpose}", who, str(seeds), *cells, *figures


def _mean(rows: Sequence[ResultRow], column: str, form: str) -> str:
    """Return the mean of a column over rows that have it, a dash where none has."""
    values = [getattr(row, column) for row in rows if getattr(row, column) is not None]
    return format(sum(values) / len(values), form) if values else "–"


def run_sheet(experiment: Experiment) -> Sheet:
    """Return every run with its command, state, revision and time."""
    arguments = {condition.name: condition.arguments for condition in experiment.conditions}
    preset = experiment.summary.get("preset", TWO_PHASE)
    rows = tuple(
        (
            run.name,
            f"--preset {preset} {arguments[run.condition]} --seed {run.seed}",
            run.state,
            run.revision or "–",
            "–" if run.minutes is None else f"{run.minutes:.0f}",
        )
        for run in experiment.runs
    )
    return Sheet("Runs", ("run", "stiction train", "state", "revision", "time [min]"), rows)


FIGURES = {
    "budget": (
        "Speed over friction",
        f"Thin: a seed. Thick: the mean, of three or more with its 95 % t-interval. Green: {BAND} of the command.",
    ),
    "each": (
        "Speed over friction, each by itself",
        f"Thin: a seed. Thick: the mean. Blue: forward; orange, dashed: backward. Green: {BAND} of the command.",
    ),
    "learning": (
        "How fast they learn",
        "Speed in training, randomised, noisy and pushed, under each method's own friction; all seeds, mean.",
    ),
}
"""Figure -> heading of its section, and what to see in it."""

APART = ("following", "verdicts", "runs")
"""Tables that are not folded away."""


def report(experiment: Experiment) -> study.Report:
    """Return the report of the experiment."""
    figures, sheets = draw_figures(experiment), sheets_of(experiment)
    return study.Report(
        title=question(experiment),
        lead=lead(experiment),
        tables=experiment.tables,
        sections=sections(experiment, figures, sheets),
        run=_run_blocks(experiment, sheets["runs"]),
        summary=experiment.plain,
        notes=[f"{name} failed: {reason}" for name, reason in experiment.summary["failed"].items()],
        figures=figures,
        sheets=tuple(sheets.values()),
        json={verdict.id: verdict.outcome for verdict in experiment.verdicts},
    )


def draw_figures(experiment: Experiment) -> dict[str, Figure]:
    """Return the figures that the results so far have something to show in."""
    known = {mean.condition for mean in experiment.means}
    first = [c.name for c in experiment.conditions if c.part == "1" and c.name in known]
    figures = {}
    if side_by_side := [name for name in compared(experiment) if name in known]:
        if len(side_by_side) <= MOST_TOGETHER:
            figures["budget"] = draw_budget(experiment, side_by_side)
        else:
            figures["each"] = draw_each(experiment, side_by_side)
    if first:
        figures["learning"] = draw_learning(experiment, first)
    return figures


def sheets_of(experiment: Experiment) -> dict[str, Sheet]:
    """Return the tables in the order of the page."""
    sheets = {}
    if has_claims(experiment):
        sheets["verdicts"] = study.verdict_sheet(experiment.verdicts, JUDGED, "The paper's sentences")
    if side_by_side := compared(experiment):
        sheets["following"] = following_sheet(experiment, side_by_side)
        sheets |= {f"methods-{who}": methods_sheet(experiment, side_by_side, who) for who in policies_of(experiment)}
    used = {condition.part for condition in experiment.conditions}
    sheets |= {f"part-{part}": part_sheet(experiment, part) for part in experiment.parts if part in used}
    sheets |= learned_sheets(experiment.learned)
    return sheets | {"runs": run_sheet(experiment)}


def sections(experiment: Experiment, figures: Mapping[str, Figure], sheets: Mapping[str, Sheet]) -> list[Section]:
    """Return the sections of the page: verdicts, figures, tables, what was run."""
    page = [Section("Who follows", sheets["following"].blocks())] if "following" in sheets else []
    if "verdicts" in sheets:
        changes = changes_sheet(experiment.summary, {one.id: one.sentence for one in experiment.verdicts})
        folded = (fold(changes.title, changes.blocks()),) if changes else ()
        page.append(Section("What became of the paper's sentences", (*sheets["verdicts"].blocks(), *folded)))
    for name, figure in figures.items():
        heading, caption = FIGURES[name]
        page.append(Section(heading, (figure_block(figure, caption),)))
    tables = [fold(sheet.title, sheet.blocks()) for name, sheet in sheets.items() if name not in APART]
    return [*page, Section("Tables", tuple(tables))]


def kept_texts(summary: Mapping[str, Any]) -> list[str]:
    """Say whence rows are that were kept from before, a sentence for each command that made some."""
    # As a file gives it back, with lists in place of tuples.
    now, texts = json.loads(json.dumps(summary["evaluation"])), []
    for one in summary.get("kept", ()):
        before = json.loads(json.dumps(one["evaluation"] or {}))
        other = ", ".join(f"{name} {before[name]}" for name in before if name in now and before[name] != now[name])
        cpu = (one["machine"] or {}).get("cpu", "a machine that is not known")
        own = f", evaluated with {other}" if other else ""
        texts.append(
            f"Kept from before: the rows of {', '.join(one['runs'])}, by {one['command']}, revision {one['revision']}, "
            f"on {cpu}{own}. All others are by the command above."
        )
    return texts


def _run_blocks(experiment: Experiment, runs: Sheet) -> tuple[Markup, ...]:
    """Return what was run, and how it was evaluated."""
    summary = experiment.summary
    settings = {name: value for name, value in summary["evaluation"].items() if name != "noise"}
    return (
        paragraph("Everything here is simulation. A training seed is one sample, however many episodes it walks."),
        *map(paragraph, kept_texts(summary)),
        fold("Settings of the evaluation", (settings_table(settings | summary["conditions_of_evaluation"]),)),
        fold(runs.title, (runs.html(),)),
    )
