"""The page of the study of onsets: on which axis robots and gains agree, and what it predicts of others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean, median
from typing import TYPE_CHECKING, Any

from stiction.core.provenance import seed_streams
from stiction.evaluation.onset import onset
from stiction.files.onset import AXES, LEAST, NOTICED, SCHEMA_VERSION, STANDS, OnsetCondition, OnsetEvidence
from stiction.files.plain import write_object
from stiction.report.page import Section, Sheet, figure_block, legend, line_look, mark_look, new_figure
from stiction_experiments.lab.study import Report
from stiction_experiments.onset.measure import OnsetRow, ReachRow, reaches_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CONDITIONS = (
    "saturn_lite",
    *(f"saturn_lite@{change}" for change in ("kp=0.5", "kp=2", "torque=0.5", "torque=2", "action=0.5", "action=2")),
    *("go1", "go2"),
)
"""Robots and gains that choose the axis, trained without friction."""

FEWEST, CLOSE, SAMPLES = 2, 1.1, 1000
"""Seeds that a condition needs; ratio of spreads under which the axis of less knowledge is taken; samples of seeds."""

UNDECIDED = 0.25
"""Share of samples with another axis from which on the choice is undecided."""

STANDSTILL = "work"
"""Axis by which a standstill is predicted: the closest one that counts a joint by what it does. A mean over joints
counts the arms of a biped, which hardly move, as much as its knees."""

FREE = ("none", "imported")
"""Methods whose policies met no friction; those of others are imported."""

READINGS = {"onset": "Onset", "relative_onset": "Relative onset", "standstill": "Standstill"}
"""Field of a row -> its name: three frictions at which a policy gives up."""

Onsets = Mapping[str, Sequence[OnsetRow]]
"""Condition -> its seeds that have an onset."""


@dataclass(frozen=True)
class Choice:
    """The axis on which conditions lie closest."""

    conditions: Onsets
    reading: str
    """One of `READINGS`."""
    axis: str
    spreads: Mapping[str, float]
    """Axis -> largest over smallest onset of the conditions, the closest first [1]."""
    middle: float
    """Median onset of the conditions on the chosen axis."""
    again: float
    """Share of samples of the seeds that choose it too [1]."""


def ordered(rows: Sequence[OnsetRow]) -> list[OnsetRow]:
    """Return the rows in the order of the conditions, other policies behind."""
    places = {name: place for place, name in enumerate(CONDITIONS)}
    return sorted(
        rows,
        key=lambda row: (row.method != "none", places.get(row.robot, len(places)), row.robot, row.seed, row.policy),
    )


def conditions_of(rows: Sequence[OnsetRow], reading: str = "onset") -> dict[str, list[OnsetRow]]:
    """Return the conditions that have enough seeds with an onset."""
    by_robot: dict[str, list[OnsetRow]] = {}
    for row in rows:
        if row.method == "none" and row.robot in CONDITIONS and getattr(row, reading) is not None:
            by_robot.setdefault(row.robot, []).append(row)
    return {name: own for name, own in by_robot.items() if len(own) >= FEWEST}


def on_axis(rows: Sequence[OnsetRow], axis: str, reading: str = "onset") -> float:
    """Return the median onset of a condition's seeds on an axis."""
    return median((getattr(row, reading) or 0.0) * getattr(row, axis) for row in rows)


def spreads_of(conditions: Onsets, reading: str = "onset") -> dict[str, float]:
    """Return axis -> the largest over the smallest onset of the conditions [1]."""
    spreads = {}
    for axis in AXES:
        values = [on_axis(own, axis, reading) for own in conditions.values()]
        spreads[axis] = max(values) / min(values)
    return spreads


def closest(spreads: Mapping[str, float]) -> str:
    """Return the axis of the smallest spread; of those within `CLOSE` of it the one that needs the least knowledge."""
    least = min(spreads.values())
    return next(axis for axis in AXES if spreads[axis] <= CLOSE * least)


def choose(conditions: Onsets, reading: str = "onset", samples: int = SAMPLES) -> Choice:
    """Return the axis that carries, and how often resampled seeds choose it again; at least one condition."""
    spreads = spreads_of(conditions, reading)
    axis = closest(spreads)
    generator = seed_streams(0, ["onset"])["onset"]
    same = 0
    for _ in range(samples):
        drawn = {
            name: [own[i] for i in generator.integers(len(own), size=len(own))] for name, own in conditions.items()
        }
        same += closest(spreads_of(drawn, reading)) == axis
    middle = median(on_axis(own, axis, reading) for own in conditions.values())
    by_spread = dict(sorted(spreads.items(), key=lambda item: item[1]))
    return Choice(conditions, reading, axis, by_spread, middle, same / samples)


def best_choice(rows: Sequence[OnsetRow]) -> Choice | None:
    """Return the choice by the onset, or by the relative one where more conditions have that; None of under two."""
    each = {reading: conditions_of(rows, reading) for reading in ("onset", "relative_onset")}
    reading = max(each, key=lambda name: len(each[name]))
    return choose(each[reading], reading) if len(each[reading]) > 1 else None


def evidence_of(
    choice: Choice, rows: Sequence[OnsetRow], reaches: Sequence[ReachRow], provenance: Mapping[str, str]
) -> OnsetEvidence:
    """Return what the product judges and predicts by: conditions with a standstill too, and robots that chose nothing.

    rows: every policy; provenance: `command` and `revision` of the study.
    """

    def condition(name: str, seeds: Sequence[OnsetRow]) -> OnsetCondition:
        walked = [[each for each in reaches if each.policy == row.policy] for row in seeds]
        return OnsetCondition(
            robot=name,
            onsets=tuple(getattr(row, choice.reading) or 0.0 for row in seeds),
            noticed=tuple(onset(reaches_of(each).relative, NOTICED) or 0.0 for each in walked),
            standstill=tuple(row.standstill or 0.0 for row in seeds),
            jitter=tuple(fmean(row.jitter for row in each if row.friction_level == 0.0) for each in walked),
            factors={axis: tuple(getattr(row, axis) for row in seeds) for axis in AXES},
        )

    whole = [row for row in rows if row.standstill is not None and getattr(row, choice.reading) is not None]
    chosen = {name: [row for row in seeds if row in whole] for name, seeds in choice.conditions.items()}
    others: dict[str, list[OnsetRow]] = {}
    for row in whole:
        if row.method in FREE and row.robot not in CONDITIONS:
            others.setdefault(row.robot, []).append(row)
    return OnsetEvidence(
        choice.axis,
        choice.reading == "relative_onset",
        choice.again,
        STANDSTILL,
        tuple(condition(name, seeds) for name, seeds in chosen.items() if len(seeds) >= FEWEST),
        tuple(condition(*each) for each in others.items()),
        **provenance,
    )


def choice_text(choice: Choice) -> str:
    """Say which number carries, how far, and how sure that is."""
    best, least, spread = AXES[choice.axis], choice.spreads[choice.axis], choice.spreads["torque_limit"]
    what = READINGS[choice.reading].lower()
    sure = f"{choice.again:.0%} of resampled seeds choose it too"
    decided = sure if 1 - choice.again <= UNDECIDED else f"undecided, only {sure}"
    return (
        f"On {best} the {what}s of all robots and gains lie within a factor of {least:.2f} ({decided}), on f / τ_max "
        f"within {spread:.2f}. Their middle is {choice.middle:.3g}."
    )


def lead(choices: Mapping[str, Choice | None]) -> str:
    """Return the answer, by the onset and by the relative one."""
    lines = []
    for reading, choice in choices.items():
        if choice is None:
            lines.append(
                f"{READINGS[reading]}: fewer than two conditions have two seeds with one; nothing is said yet."
            )
            continue
        without = [condition for condition in CONDITIONS if condition not in choice.conditions]
        missing = f" Without: {', '.join(without)}." if without else ""
        lines.append(f"{READINGS[reading]}: {choice_text(choice)}{missing}")
    return "\n".join(lines)


def axes_sheet(choice: Choice) -> Sheet:
    """Return the onset of every condition on every axis, the axis of the smallest spread first."""
    lines = []
    for axis, spread in choice.spreads.items():
        values = (f"{on_axis(own, axis, choice.reading):.3g}" for own in choice.conditions.values())
        lines.append((AXES[axis], f"{spread:.2f}", *values))
    return Sheet(
        f"{READINGS[choice.reading]} on each axis",
        ("axis", "largest over smallest", *choice.conditions),
        tuple(lines),
        f"Median of the seeds. {choice_text(choice)}",
    )


def predictions_sheet(rows: Sequence[OnsetRow], readings: Mapping[str, tuple[str, float]]) -> Sheet | None:
    """Return what is predicted of the policies without friction that chose no axis; None where there are none.

    A policy trained with friction follows as far as it was trained. readings: field of a row -> axis, and the middle of
    the conditions on it.
    """
    lines = []
    for row in rows:
        if row.method not in FREE or (row.method == "none" and row.robot in CONDITIONS):
            continue
        cells = []
        for reading, (axis, middle) in readings.items():
            measured, predicted = getattr(row, reading), middle / getattr(row, axis)
            error = "–" if measured is None else f"{predicted / measured - 1:+.0%}"
            cells += [f"{predicted:.1%}", "not seen" if measured is None else f"{measured:.1%}", error]
        lines.append((row.policy, row.method, f"{row.reach:.2f}", *cells))
    if not lines:
        return None
    names = [READINGS[reading].lower() for reading in readings]
    columns = (column for name in names for column in (f"{name}, predicted", "walked", "error"))
    header = ("policy", "method", "reach without friction", *columns)
    note = "; ".join(
        f"{READINGS[reading]}: the middle of the conditions on {AXES[axis]}, {middle:.3g}"
        for reading, (axis, middle) in readings.items()
    )
    return Sheet("Others", header, tuple(lines), f"{note}.")


def seeds_sheet(rows: Sequence[OnsetRow]) -> Sheet:
    """Return the onsets of every policy."""
    lines = tuple(
        (
            row.robot,
            row.method,
            str(row.seed),
            f"{row.reach:.2f}",
            *("–" if value is None else f"{value:.1%}" for value in (getattr(row, reading) for reading in READINGS)),
        )
        for row in rows
    )
    header = ("robot", "method", "seed", "reach without friction", "onset", "relative onset", "standstill")
    note = (
        f"Friction over torque limit at which the worst fast command falls under {LEAST:g}; relative: {LEAST:g} of its "
        f"reach without friction; standstill: the mean of all fast commands under {STANDS:g} of theirs without."
    )
    return Sheet("Onset of every policy", header, lines, note)


def draw(rows: Sequence[OnsetRow], reaches: Sequence[ReachRow], axis: str) -> Figure:
    """Return the worst reach over f/τ_max and over friction on the chosen axis, a line for each policy."""
    figure, panels = new_figure(1, 2, size=(11.0, 4.6))
    names = list(CONDITIONS)
    for panel, by in zip(panels, ("torque_limit", axis), strict=True):
        for row in rows:
            if row.method != "none" or row.robot not in names:
                continue
            reach = reaches_of([each for each in reaches if each.policy == row.policy]).worst
            levels = [level for level in reach if level > 0.0]
            label = row.robot if row.robot not in {str(line.get_label()) for line in panel.lines} else "_"
            panel.plot(
                [level * getattr(row, by) for level in levels],
                [reach[level] for level in levels],
                marker=mark_look(row.robot, names),
                markersize=4,
                linewidth=1.0,
                label=label,
                **line_look(row.robot, names),
            )
        panel.axhline(LEAST, color="0.5", linewidth=0.8)
        panel.set(xscale="log", xlabel=AXES[by], ylabel="worst reach of the fast commands", ylim=(-0.1, 1.3))
    legend(panels[0])
    return figure


def report(
    rows: Sequence[OnsetRow], reaches: Sequence[ReachRow], settings: dict[str, Any], provenance: Mapping[str, str] = {}
) -> Report:
    """Return the report of the study. provenance: `command` and `revision`, for evidence.json."""
    each = {reading: conditions_of(rows, reading) for reading in READINGS}
    choices = {reading: choose(own, reading) if len(own) > 1 else None for reading, own in each.items()}
    made = [choice for choice in choices.values() if choice is not None]
    sheets = [axes_sheet(choice) for choice in made]
    evidence = best_choice(rows)
    by = {} if evidence is None else {evidence.reading: (evidence.axis, evidence.middle)}
    if still := each["standstill"]:
        by["standstill"] = (STANDSTILL, median(on_axis(own, STANDSTILL, "standstill") for own in still.values()))
    if (others := predictions_sheet(rows, by)) is not None:
        sheets.insert(1, others)
    sheets.append(seeds_sheet(rows))
    figure = draw(rows, reaches, made[0].axis) if made and reaches else None
    answer = lead(choices)
    picture = () if figure is None else (figure_block(figure, "Worst reach over friction, trained without friction."),)

    def write_evidence(out: Path) -> None:
        if evidence is not None:
            plain = asdict(evidence_of(evidence, rows, reaches, provenance))
            write_object(out / "evidence.json", {"schema_version": SCHEMA_VERSION} | plain)

    return Report(
        title="Which number says how much friction is too much?",
        lead=answer,
        tables={"onsets": rows, "reach": reaches},
        sections=[Section("Onsets", (*picture, *(block for sheet in sheets for block in sheet.blocks())))],
        summary=settings | {"lead": answer},
        figures={"onset": figure},
        sheets=sheets,
        files=write_evidence,
    )
