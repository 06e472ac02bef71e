"""The page on stairs: which share of the robots climbs which step height."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiction.formats.climb import ENOUGH, Climb, highest_climbed, wilson
from stiction.formats.results import write_summary
from stiction.formats.rows import write_rows
from stiction.report.page import INK, Section, figure_uri, legend, new_figure, paragraph, picture, render_page, table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_stairs(out: Path, rows: Sequence[Climb], summary: dict[str, Any]) -> Path:
    """Write stairs.csv, summary.json, stairs.png and report.html into `out`; return the path of the page."""
    figure = draw_stairs(rows)
    write_rows(out / "stairs.csv", rows)
    write_summary(out / "summary.json", summary)
    figure.savefig(out / "stairs.png", dpi=150, facecolor="white")
    caption = f"Share of trials that succeed, with Wilson's 95 % interval; the line is {ENOUGH:.0%}."
    sections = [
        Section("Success over step height", (picture(figure_uri(figure), caption),)),
        Section("Every height", (table(HEADER, [_cells(row) for row in rows]),)),
        Section(
            "What was run",
            (
                paragraph(WHAT),
                paragraph(f"Command: {summary['command']}"),
                paragraph(f"Revision {summary['revision']}, on {summary['machine']['cpu']}."),
            ),
        ),
    ]
    page = out / "report.html"
    text = render_page("Stairs", sections, " ".join(answers(rows)), summary["warnings"])
    page.write_text(text, encoding="utf-8")
    return page


HEADER = ("policy", "friction", "step height [cm]", "succeed", "95 % interval", "fell", "steps passed", "time [s]")

WHAT = (
    "Six steps up, a landing of 1.2 m, six steps down, each 0.30 m deep, the highest level with the landing; the robot "
    "sees nothing of them. A pilot holds its heading and corrects nothing else. A trial succeeds when the base has "
    "been over the landing and is then 0.6 m beyond the last step without a fall, within twice the time that the "
    "commanded speed takes. Nominal masses, training's sensor noise, no delay."
)


def answers(rows: Sequence[Climb]) -> list[str]:
    """Return a sentence for each policy and level: the greatest height that enough trials climb."""
    sentences = []
    for policy, level in _groups(rows):
        best = highest_climbed(row for row in rows if (row.policy, row.friction_level) == (policy, level))
        at = f"{policy} at {100 * level:g} % friction"
        if best is None:
            sentences.append(f"{at} climbs none of the tested heights in {ENOUGH:.0%} of the trials.")
            continue
        low, high = wilson(best.successes, best.trials)
        share = f"{best.successes} of {best.trials} trials, {low:.0%} to {high:.0%}"
        sentences.append(f"{at} climbs {100 * best.step_height:g} cm: {share}.")
    return sentences


def draw_stairs(rows: Sequence[Climb]) -> Figure:
    """Return the share of successes over step height, a line for each policy and level."""
    figure, (axis,) = new_figure(size=(7.0, 3.6))
    axis.axhline(ENOUGH, color=INK, linewidth=0.8, linestyle="--")
    for policy, level in _groups(rows):
        mine = sorted(
            (row for row in rows if (row.policy, row.friction_level) == (policy, level)),
            key=lambda row: row.step_height,
        )
        heights = [100 * row.step_height for row in mine]
        share = [row.successes / row.trials for row in mine]
        bounds = [wilson(row.successes, row.trials) for row in mine]
        axis.errorbar(
            heights,
            share,
            yerr=[
                [max(0.0, s - low) for s, (low, _) in zip(share, bounds, strict=True)],
                [max(0.0, high - s) for s, (_, high) in zip(share, bounds, strict=True)],
            ],
            marker="o",
            markersize=4,
            capsize=2,
            label=f"{policy}, {100 * level:g} % friction",
        )
    axis.set(xlabel="step height [cm]", ylabel="share of trials that succeed", ylim=(-0.03, 1.03))
    legend(axis)
    return figure


def _groups(rows: Sequence[Climb]) -> list[tuple[str, float]]:
    """Return each policy and level once, in the order of first appearance."""
    return list(dict.fromkeys((row.policy, row.friction_level) for row in rows))


def _cells(row: Climb) -> list[str]:
    """Return one row as text."""
    low, high = wilson(row.successes, row.trials)
    return [
        row.policy,
        f"{100 * row.friction_level:g} %",
        f"{100 * row.step_height:g}",
        f"{row.successes} of {row.trials}",
        f"{low:.0%} to {high:.0%}",
        f"{row.falls}",
        f"{row.steps_climbed:.1f}",
        "–" if row.seconds is None else f"{row.seconds:.1f}",
    ]
