"""Tables of the experiment on training with friction, for its page and, as Markdown, for a README."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from stiction.formats.experiment import LIMITS, ConditionRecord, Experiment, SeedMean
from stiction.formats.following import LEAST
from stiction.formats.results import ResultRow
from stiction.report.following import levels_sheet
from stiction.report.sheet import Sheet

WHO = ("student", "teacher")


def mean_text(mean: SeedMean | None) -> str:
    """Return a mean with half the width of its interval, `0.93 ± 0.05`; without one where there is a single seed."""
    if mean is None:
        return "–"
    return f"{mean.mean:.2f}" if mean.high is None else f"{mean.mean:.2f} ± {mean.high - mean.mean:.2f}"


def methods_sheet(experiment: Experiment, conditions: Sequence[str], who: str) -> Sheet:
    """Return the speed ratio of some conditions over the levels up to 30 %, a row for each direction."""
    means = {
        (m.condition, m.command, m.friction_level): m
        for m in experiment.means
        if m.who == who and m.condition in conditions and m.command in ("vx=0.5", "vx=-0.5")
    }
    levels = sorted({level for _, _, level in means if level <= 0.3})
    rows = [
        (f"{name}, {word}", *(mean_text(means.get((name, command, level))) for level in levels))
        for name in conditions
        for word, command in (("forward", "vx=0.5"), ("backward", "vx=-0.5"))
    ]
    header = (f"{who}, friction in % of the torque limit", *(f"{100 * level:g}" for level in levels))
    counts = sorted({m.seeds for m in means.values()})
    seeds = "1 seed" if counts == [1] else f"{' or '.join(map(str, counts))} seeds"
    note = f"Speed reached over commanded, mean and 95 % t-interval over {seeds}." if counts else ""
    return Sheet(f"Speed over friction, {who}", header, tuple(rows), note)


def following_sheet(experiment: Experiment, conditions: Sequence[str]) -> Sheet:
    """Return how many seeds of some conditions follow, students before teachers, over the levels up to 30 %."""
    names = {f"{name}/{who}": f"{name}, {who}" for who in WHO for name in conditions}
    own = [replace(cell, method=names[cell.method]) for cell in experiment.following if cell.method in names]
    rank = list(names.values())
    return levels_sheet(sorted(own, key=lambda cell: rank.index(cell.method)), "How many training seeds follow")


def part_sheet(experiment: Experiment, part: str) -> Sheet:
    """Return teacher and student of a part's conditions at no friction, the mean of training, and the nominal level."""
    rows = []
    for condition in experiment.conditions:
        if condition.part == part:
            rows += [_condition_row(experiment, condition, who) for who in WHO]
    header = (
        *("condition", "policy", "seeds", "without friction", "at the mean of training", "at the nominal friction"),
        *("falls", "jitter [rad/s²]", "tripod"),
    )
    note = (
        "Speed reached over commanded, forward / backward, mean over seeds with its 95 % t-interval where there are "
        "several. Falls, jitter and tripod share: at the nominal friction, mean over both directions and seeds."
    )
    return Sheet(experiment.parts[part], header, tuple(rows), note)


def _condition_row(experiment: Experiment, condition: ConditionRecord, who: str) -> tuple[str, ...]:
    """Return one policy of one condition."""
    own = [m for m in experiment.means if (m.condition, m.who) == (condition.name, who)]

    def at(level: float) -> str:
        found = {m.command: m for m in own if abs(m.friction_level - level) < 1e-6}
        return " / ".join(mean_text(found.get(command)) for command in ("vx=0.5", "vx=-0.5"))

    rows = [
        row
        for row in experiment.rows
        if row.policy == f"{condition.name}-s{row.seed}/{who}"
        and abs(row.friction_level - condition.nominal) < 1e-6
        and row.command in ("vx=0.5", "vx=-0.5")
    ]
    seeds = len({row.seed for row in rows})
    levels = 0.0, condition.training_mean, condition.nominal
    figures = (_mean(rows, "fall_rate", ".0%"), _mean(rows, "joint_jitter", ".0f"), _mean(rows, "tripod_share", ".0%"))
    return f"{condition.name}: {condition.purpose}", who, str(seeds), *(at(level) for level in levels), *figures


def _mean(rows: Sequence[ResultRow], column: str, form: str) -> str:
    """Return the mean of a column over rows that have it, a dash where none has."""
    values = [getattr(row, column) for row in rows if getattr(row, column) is not None]
    return format(sum(values) / len(values), form) if values else "–"


def verdict_sheet(experiment: Experiment) -> Sheet:
    """Return what became of each sentence."""
    rows = tuple((v.id, v.outcome, f"“{v.sentence}”", v.criterion, v.evidence) for v in experiment.verdicts)
    note = (
        "Numbers are means over training seeds with their 95 % t-interval in brackets and every seed in parentheses. "
        f"`undecided`: the interval straddles the criterion. {LIMITS} One seed carries no verdict. Each sentence is "
        "judged by itself at 95 %: the number of sentences is not corrected for."
    )
    return Sheet("The paper's sentences", ("", "outcome", "sentence", "criterion", "evidence"), rows, note)


def onset_sheet(experiment: Experiment) -> Sheet:
    """Return the friction at which each condition slows under 80 %, on every candidate axis."""
    names = list(experiment.onsets[0].scales) if experiment.onsets else []
    rows = []
    for onset in experiment.onsets:
        values = [onset.on(name) for name in names]
        nowhere = "stays above" if onset.level is None else "under from the start"
        rows.append((onset.condition, *(nowhere if value is None else f"{value:.3f}" for value in values)))
    note = " ".join(f"{c.method}: {c.axis or 'no axis'}; {c.reason}." for c in experiment.collapses)
    return Sheet(
        f"Friction at which the slower direction slows under {LEAST}", ("condition", *names), tuple(rows), note
    )


def run_sheet(experiment: Experiment) -> Sheet:
    """Return every run with its command, state, revision and time."""
    arguments = {condition.name: condition.arguments for condition in experiment.conditions}
    rows = tuple(
        (
            run.name,
            f"--preset two-phase {arguments[run.condition]} --seed {run.seed}",
            run.state,
            run.revision or "–",
            "–" if run.minutes is None else f"{run.minutes:.0f}",
        )
        for run in experiment.runs
    )
    return Sheet("Runs", ("run", "stiction train", "state", "revision", "minutes"), rows)
