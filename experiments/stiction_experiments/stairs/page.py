"""The page on stairs: which share of the robots climbs which step height."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from stiction.core import records
from stiction.core.statistics import wilson
from stiction.evaluation.course import PATIENCE
from stiction.report.page import (
    INK,
    Section,
    figure_block,
    fold,
    legend,
    line_look,
    mark_look,
    new_figure,
    paragraph,
    table,
)
from stiction.robots.terrain import LANDING, STEPS, TREAD
from stiction.task.terrain import FINISH_MARGIN
from stiction_experiments.lab.study import Report
from stiction_experiments.stairs.climb import ENOUGH, Climb, highest_climbed

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def report(rows: Sequence[Climb], settings: dict[str, Any]) -> Report:
    """Return the report of the study. settings: `settings` and `policies`."""
    figure, sentences = draw_stairs(rows), answers(rows)
    ends = [wilson(row.successes, row.trials) for row in rows]
    lines = [
        [*records.texts(row), f"{100 * low:.0f} to {100 * high:.0f}"]
        for row, (low, high) in zip(rows, ends, strict=True)
    ]
    header = (*records.header(Climb), "95 % of succeed [% of trials]")
    counted = f"dashed: the {100 * ENOUGH:g} % that count as climbed"
    caption = f"Share of trials that succeed, with Wilson's 95 % interval; {counted}."
    return Report(
        title="Stairs, climbed blind",
        lead="\n".join(sentences),
        tables={"stairs": rows},
        sections=(
            Section("Success over step height", (figure_block(figure, caption),)),
            Section(
                "Every height",
                (fold("Trials, falls and steps passed, height by height", [table(header, lines, grouped=True)]),),
            ),
        ),
        run=(paragraph(WHAT),),
        summary=settings | {"rows": list(map(asdict, rows))},
        figures={"stairs": figure},
        answer=sentences,
    )


WHAT = (
    f"{STEPS} steps up, a landing of {2 * LANDING:g} m, {STEPS} steps down, each {TREAD:.2f} m deep, the highest level "
    "with the landing; the robot is blind. A pilot holds its heading and corrects nothing else. A trial succeeds when "
    f"the base has been over the landing and is then {FINISH_MARGIN:g} m beyond the last step without a fall, within "
    f"{PATIENCE:g} times what the commanded speed takes. Nominal masses, training's sensor noise, no delay."
)


def answers(rows: Sequence[Climb]) -> list[str]:
    """Return the greatest height that enough trials climb, a sentence for each policy."""
    heights_by_policy: dict[str, list[str]] = {}
    for mine in _by_policy(rows).values():
        heights_by_policy.setdefault(mine[0].policy, []).append(f"{_height(mine)} {_friction(mine[0].friction_level)}")
    return [f"{policy} climbs {', and '.join(heights)}." for policy, heights in heights_by_policy.items()]


def _height(rows: Sequence[Climb]) -> str:
    """Return the greatest height that one policy climbs at one level, and in how many trials, in words."""
    best = highest_climbed(rows)
    if best is None:
        return "none of the tested steps"
    low, high = wilson(best.successes, best.trials)
    share = f"{best.successes} of {best.trials} trials, 95 % interval {100 * low:.0f} to {100 * high:.0f} %"
    return f"steps of {100 * best.step_height:g} cm ({share})"


def _friction(level: float) -> str:
    return f"with {100 * level:g} % joint friction" if level else "without joint friction"


def draw_stairs(rows: Sequence[Climb]) -> Figure:
    """Return the share of successes over step height, a line for each policy and level."""
    figure, (axis,) = new_figure(size=(7.0, 3.6))
    axis.axhline(ENOUGH, color=INK, linewidth=0.8, linestyle="--")
    policies = _by_policy(rows)
    for name, mine in policies.items():
        look = line_look(name, list(policies)) | {"marker": mark_look(name, list(policies)), "markersize": 4}
        heights = [100 * row.step_height for row in mine]
        share = np.array([row.successes / row.trials for row in mine])
        low, high = np.array([wilson(row.successes, row.trials) for row in mine]).T
        ends = np.maximum(0.0, [share - low, high - share])
        axis.errorbar(heights, share, ends, capsize=2, label=name, **look)
    axis.set(xlabel="step height [cm]", ylabel="share of trials that succeed", ylim=(-0.03, 1.03))
    legend(axis)
    return figure


def _by_policy(rows: Sequence[Climb]) -> dict[str, list[Climb]]:
    """Return the rows of each policy and level by its name, from low steps to high."""
    by_policy: dict[str, list[Climb]] = {}
    for row in rows:
        by_policy.setdefault(f"{row.policy} {_friction(row.friction_level)}", []).append(row)
    return {name: sorted(mine, key=lambda row: row.step_height) for name, mine in by_policy.items()}
