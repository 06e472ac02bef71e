"""The page on wear: at how much friction a policy's life ends, and whether its monitor saw that coming."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiction.formats.life import ENOUGH, Life, Reading, Window
from stiction.formats.results import write_summary
from stiction.formats.rows import write_rows
from stiction.report.page import (
    COLORS,
    INK,
    Section,
    figure_uri,
    legend,
    new_figure,
    paragraph,
    picture,
    render_page,
    table,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_wear(
    out: Path, lives: Sequence[Life], windows: Sequence[Window], readings: Sequence[Reading], summary: dict[str, Any]
) -> Path:
    """Write lives.csv, windows.csv, readings.csv, summary.json, figures and report.html into `out`; return the page.

    readings: of all monitors; where there are none, readings.csv is not written. windows: at least one.
    """
    for name, rows in (("lives", lives), ("windows", windows), ("readings", readings)):
        (out / f"{name}.csv").unlink(missing_ok=True)
        if rows:
            write_rows(out / f"{name}.csv", rows)
    write_summary(out / "summary.json", summary)
    ratios = draw_ratios(windows, lives)
    ratios.savefig(out / "wear.png", dpi=150, facecolor="white")
    settings, end = summary["settings"], summary["settings"]["wear"]["end"]
    sections = [
        Section("Speed while friction grows", (picture(figure_uri(ratios), SPEED),)),
        Section("Every robot", (table(HEADER, [_cells(row, end) for row in lives]), paragraph(ENDS))),
        Section("Does the monitor notice?", (*_monitor(out, readings), paragraph(MONITOR))),
        Section(
            "What was run",
            (
                paragraph(WHAT.format(joints=", ".join(settings["wear"]["joints"]) or "all joints", **settings)),
                paragraph(f"Command: {summary['command']}"),
                paragraph(f"Revision {summary['revision']}, on {summary['machine']['cpu']}."),
            ),
        ),
    ]
    explored = summary["exploratory"]
    warnings = [EXPLORED.format(", ".join(map(str, explored)))] if explored else []
    page = out / "report.html"
    lead = " ".join(answers(summary["groups"], end))
    page.write_text(render_page("Wear", sections, lead, warnings), encoding="utf-8")
    return page


EXPLORED = "Exploratory: the virtual robots {} were looked at while virtual robots were made; they are no evidence."

SPEED = (
    f"Speed over the commanded one, means over windows, against the wear in the middle of each; a thin line is a "
    f"robot, a thick one their mean where all of them walk. The line is {ENOUGH:.0%}: from where a robot stays "
    "under it, the policy's life is over."
)

HEADER = (
    *("policy", "level", "robot", "ratio, first", "last", "life ends at", "how"),
    *("unusual reading at", "which is", "growth told at", "which is"),
)

ENDS = (
    "Wear is a factor on each joint's dry friction, as a bench without load would find it. An end is known at the end "
    "of the first window that counts, and is reported at the wear in its middle."
)

MONITOR = (
    "The monitor hears what the policy's network is given, nothing else, and speaks once a window. An unusual reading "
    "says that the walk is like none that it knows: more friction, or another robot. At once means: in the first "
    "window already, before there was any wear, so that it is no notice of wear. Growth is told by the first reading "
    "whose 95 % interval lies wholly above that of the first one. Before and after: the end of the policy's life. The "
    "truth is the friction in motion that a bench without load would find. A monitor is fitted in the training's "
    "simulator, on Coulomb friction: what else a robot has, more friction at rest, harder contacts, other masses, it "
    "takes for friction or does not know."
)

WHAT = (
    "Virtual robots in {engine}, cell {cell}, with parameters of their own; the friction of {joints} grows by equal "
    "ratios from x{wear[start]:g} to x{wear[end]:g} of its level in {wear[seconds]:g} s and stays there for a window, "
    "under the constant command {command}. Nothing corrects the heading; the speed is that along the command, in the "
    "robot's frame. The first {settle:g} s are left out; windows have {window:g} s. Each robot walks once. Intervals "
    "are 95 % t-intervals of the mean of the factor's logarithm over the robots that these seeds made: they speak of "
    "virtual robots under this one policy, not of other trainings of its method."
)


def answers(groups: Sequence[dict[str, Any]], last: float) -> list[str]:
    """Return a sentence or two for each policy and level; last: the greatest factor that was tried [1]."""
    return [f"{_ended(group, last)} {_noticed(group)}" for group in groups]


def _ended(group: dict[str, Any], last: float) -> str:
    """Say when the lives of one policy's robots ended."""
    count, ends = group["robots"], group["ends"]
    begin = f"{group['policy']} at level {group['friction_level']}:"
    if group["mean"] is not None:
        spread = group["interval95"]
        of = f" (95 % over robots: x{spread[0]:.2f} to x{spread[1]:.2f})" if spread else ", one robot"
        return f"{begin} its life ends at x{group['mean']:.2f}{of}{_of_falls(ends)}."
    said = [f"{number} of {count} {PLURAL[end].format(last=last)}" for end, number in ends.items()]
    middle = f"; the median life ends at x{group['median']:.2f}" if group["median"] is not None else ""
    return f"{begin} {', '.join(said)}{middle}."


PLURAL = {
    "alive": "robots still walk at x{last:g}",
    "slow": f"fall under {ENOUGH:.0%} of the command before that",
    "fell": "fall over before that",
    "slow from the start": f"never reach {ENOUGH:.0%} of the command",
}
"""What robots did."""


def _of_falls(ends: dict[str, int]) -> str:
    """Say how many fell, if any did."""
    return f", {ends['fell']} by a fall" if "fell" in ends else ""


def _noticed(group: dict[str, Any]) -> str:
    """Say what the monitor did."""
    if not group["monitored"]:
        return "The bundle has no wear monitor."
    parts = [
        f"{what} {', '.join(f'{kind} for {number}' for kind, number in group[name].items())}"
        for name, what in (("unusual", "an unusual reading came"), ("grown", "growth was told"))
    ]
    held = "" if group["held"] is None else f" Its 95 % intervals held the truth in {group['held']:.0%} of the windows."
    return f"Of its {group['robots']} monitors, {'; '.join(parts)}.{held}"


def draw_ratios(windows: Sequence[Window], lives: Sequence[Life]) -> Figure:
    """Return the speed ratio over wear, a panel for each level, a colour for each policy."""
    levels = list(dict.fromkeys(row.friction_level for row in lives))
    policies = list(dict.fromkeys(row.policy for row in lives))
    figure, axes = new_figure(len(levels), 1, (8.0, 3.4 * len(levels)))
    for axis, level in zip(axes, levels, strict=True):
        axis.axhline(ENOUGH, color=INK, linewidth=0.8, linestyle="--")
        for color, policy in zip(COLORS * len(policies), policies, strict=False):
            rows = [row for row in windows if (row.policy, row.friction_level) == (policy, level)]
            robots = list(dict.fromkeys(row.robot for row in rows))
            lines = [[row for row in rows if row.robot == robot] for robot in robots]
            for line in lines:
                axis.plot(*_points(line), color=color, linewidth=0.7, alpha=0.5)
            shared = min((len(line) for line in lines), default=0)
            means = [sum(line[at].ratio for line in lines) / len(lines) for at in range(shared)]
            axis.plot([row.factor for row in lines[0][:shared]] if lines else [], means, color=color, label=policy)
        axis.set(xscale="log", xlabel="wear, factor on dry friction", ylabel="speed ratio", title=f"level {level}")
        _plain(axis)
        legend(axis)
    return figure


def _points(line: Sequence[Window]) -> tuple[list[float], list[float]]:
    """Return wear and ratio of a robot's windows."""
    return [row.factor for row in line], [row.ratio for row in line]


TICKS = (0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
"""Factors that are written under an axis, as far as they are on it."""


def _plain(axis) -> None:
    """Write factors as people do."""
    low, high = axis.get_xlim()
    ticks = [tick for tick in TICKS if low <= tick <= high]
    axis.set_xticks(ticks, [f"x{tick:g}" for tick in ticks])
    axis.set_xticks([], minor=True)


def _monitor(out: Path, readings: Sequence[Reading]) -> tuple:
    """Return the figure of what monitors said against the truth; a sentence where there is none."""
    (out / "monitor.png").unlink(missing_ok=True)
    if not readings:
        return (
            paragraph("None of these bundles has a wear monitor; `stiction export --wear` puts one into a bundle."),
        )
    figure = draw_readings(readings)
    figure.savefig(out / "monitor.png", dpi=150, facecolor="white")
    caption = (
        "What the monitor took the friction for, with its 95 % interval, against the truth (line), window by window; "
        "hollow: it said that the walk is unusual."
    )
    return (picture(figure_uri(figure), caption),)


def draw_readings(readings: Sequence[Reading]) -> Figure:
    """Return estimate and truth over time, a panel for each policy and level, a colour for each robot."""
    panels = list(dict.fromkeys((row.policy, row.friction_level) for row in readings))
    figure, axes = new_figure(len(panels), 1, (8.0, 3.4 * len(panels)))
    for axis, panel in zip(axes, panels, strict=True):
        rows = [row for row in readings if (row.policy, row.friction_level) == panel]
        robots = list(dict.fromkeys(row.robot for row in rows))
        for number, robot in enumerate(robots):
            color, mine = COLORS[number % len(COLORS)], [row for row in rows if row.robot == robot]
            axis.plot([row.time for row in mine], [100 * row.true for row in mine], color=color, linewidth=1.0)
            shift = number / len(robots)
            for row in mine:
                if row.estimate is None or row.low is None or row.high is None:
                    continue
                value, ends = 100 * row.estimate, [100 * (row.estimate - row.low), 100 * (row.high - row.estimate)]
                axis.errorbar(
                    row.time + shift,
                    value,
                    [[max(0.0, ends[0])], [max(0.0, ends[1])]],
                    marker="o",
                    markersize=4,
                    color=color,
                    markerfacecolor="none" if row.unusual else color,
                    capsize=2,
                    linewidth=0.8,
                )
            axis.plot([], [], color=color, marker="o", label=f"robot {robot}")
        target = "mean over the joints" if rows[0].target == "level" else rows[0].target
        axis.set(xlabel="time [s]", ylabel=f"f/τ_max [%], {target}", title=f"{panel[0]}, level {panel[1]}")
        legend(axis)
    return figure


def _cells(row: Life, last: float) -> list[str]:
    """Return one row as text."""
    at = f"x{row.factor:.2f}" if row.factor is not None else f"over x{last:g}" if row.end == "alive" else "–"
    notices = []
    for factor, when in ((row.unusual_factor, row.unusual), (row.grown_factor, row.grown)):
        notices += ["no monitor", "–"] if not row.monitored else ["–" if factor is None else f"x{factor:.2f}", when]
    first, final = ("–" if ratio is None else f"{ratio:.2f}" for ratio in (row.first_ratio, row.last_ratio))
    return [row.policy, row.friction_level, str(row.robot), first, final, at, row.end, *notices]
