"""The page of the benches: what identification found of virtual robots, beside what was there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from stiction.core import records
from stiction.core.statistics import wilson
from stiction.report.page import (
    COLORS,
    INK,
    Section,
    figure_block,
    fold,
    legend,
    new_figure,
    paragraph,
    table,
)
from stiction_experiments.bench.robots import IdentifiedFriction, Score, score
from stiction_experiments.lab.study import Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def by_robot(rows: Sequence[IdentifiedFriction]) -> dict[str, list[IdentifiedFriction]]:
    """Return the rows of each robot."""
    robots: dict[str, list[IdentifiedFriction]] = {}
    for row in rows:
        robots.setdefault(row.robot, []).append(row)
    return robots


def report(
    rows: Sequence[IdentifiedFriction],
    next_steps: Mapping[str, str],
    settings: Mapping[str, Any],
    warnings: Sequence[str] = (),
) -> Report:
    """Return the report of the study.

    next_steps: robot -> the command that trains with what was found of it, or why there is none; settings: `failed` is
    robot -> why it could not be identified, and more for summary.json.
    """
    figure, answer = draw_benches(rows), lead(rows)
    robots = {robot: asdict(score(some)) for robot, some in by_robot(rows).items()}
    scores = {"all": asdict(score(rows)), "robots": robots}
    steps = table(["robot", "to train with what was found of it"], list(next_steps.items()))
    return Report(
        title="Virtual robots on the bench",
        lead=answer,
        tables={"bench": rows},
        sections=(
            Section("Found over true", (figure_block(figure, CAPTION), paragraph(SHOWN))),
            Section("Each robot", (robots_table(rows),)),
            Section("Each joint", tuple(fold(robot, [joints_table(some)]) for robot, some in by_robot(rows).items())),
            Section("How a training takes it", (paragraph(TAKEN), steps)),
        ),
        run=(paragraph(SIMULATED),),
        summary={**settings, "next": dict(next_steps), "scores": scores, "lead": answer},
        warnings=warnings,
        figures={"bench": figure},
        further=[
            f"next: {step}" if step.startswith("stiction") else f"{name}: {step}" for name, step in next_steps.items()
        ],
        status=1 if settings["failed"] else 0,
    )


def lead(rows: Sequence[IdentifiedFriction]) -> str:
    """Return how many intervals hold."""
    total = score(rows)
    identified = f"{total.joints} joints of {len(by_robot(rows))} virtual robots, {total.identified} of them identified"
    if not total.identified:
        return f"{identified}."
    low, high = wilson(total.held, total.identified)
    return (
        f"{identified}: {total.held} intervals of 95 % hold the friction that a perfect log would show ({low:.0%} to "
        f"{high:.0%}, every joint taken as independent, though those of a robot share a log)."
    )


SHOWN = (
    "A log shows friction in the unit in which the motor reports its torque: f/k, where k is the torque that the motor "
    "gives over the torque that it reports. Under a law with load it also shows what the load adds while the joint "
    "moves on its bench. Intervals are held against that, (f + load)/k. What is left is the method's own error: "
    "sensors, delays, backlash and a friction law that is not Coulomb's. Nothing but this page and bench.csv has the "
    "truth in it."
)
CAPTION = "Friction found over (f + load)/k, with its 95 % interval: a point a joint, a colour a robot, the line is 1."
TAKEN = (
    "training.json proposes one level for all joints, that of the worst, with a margin for the load that was not on "
    "the bench; joints.json has the numbers themselves, which `stiction train --joints` takes as the nominal joints."
)
SIMULATED = "Everything here is simulation. No robot was involved."


def draw_benches(rows: Sequence[IdentifiedFriction]) -> Figure:
    """Return what was found over what a perfect log shows, joint by joint, robot beside robot."""
    figure, (axis,) = new_figure(size=(9.6, 3.6))
    axis.axhline(1.0, color=INK, linewidth=0.8)
    begin = 0
    for index, (robot, some) in enumerate(by_robot(rows).items()):
        drawn = [
            (begin + number, row.identified / row.shown, row.low / row.shown, row.high / row.shown)
            for number, row in enumerate(some)
            if row.identified is not None and row.low is not None and row.high is not None and row.shown > 0.0
        ]
        begin += len(some) + 2
        if drawn:
            x, ratio, low, high = np.array(drawn).T
            ends = [ratio - low, high - ratio]
            color = COLORS[index % len(COLORS)]
            axis.errorbar(x, ratio, yerr=ends, fmt=".", markersize=4, linewidth=0.8, color=color, label=robot)
    axis.set(ylabel="found over true", xticks=[])
    legend(axis, ncols=2)
    return figure


def robots_table(rows: Sequence[IdentifiedFriction]) -> Markup:
    """Return a row for all robots and for each: how many intervals hold, median and worst error."""
    lines = [[robot, *records.texts(score(some))] for robot, some in ({"all": rows} | by_robot(rows)).items()]
    caption = "Errors are relative, against (f + load)/k unless of f itself."
    return table(("robot", *records.header(Score)), lines, caption)


def joints_table(rows: Sequence[IdentifiedFriction]) -> Markup:
    """Return every joint of a robot."""
    lines = [
        [*records.texts(row), f"{row.shown:.4g}", "yes" if row.holds(row.shown) else "no", error_text(row)]
        for row in rows
    ]
    return table((*records.header(IdentifiedFriction), "(f + load)/k [N m]", "holds", "error [%]"), lines)


def error_text(row: IdentifiedFriction) -> str:
    """Return the error against what a perfect log shows, a dash where there is none."""
    error = row.error(row.shown)
    return "–" if error is None else f"{error:+.1%}"
