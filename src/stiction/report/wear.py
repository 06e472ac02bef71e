"""The page on wear: at how much friction a policy's life ends, and whether its monitor saw that coming."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from stiction.formats.errors import StictionError
from stiction.formats.following import BAND, LEAST, MOST, pace
from stiction.formats.life import Life, Reading, Window
from stiction.formats.results import write_summary
from stiction.formats.rows import write_rows
from stiction.report.following import judged_text
from stiction.report.page import Section, figure_uri, paragraph, picture, render_page, table
from stiction.report.wear_figures import draw_ratios, draw_readings


def write_wear(
    out: Path, lives: Sequence[Life], windows: Sequence[Window], readings: Sequence[Reading], summary: dict[str, Any]
) -> Path:
    """Write lives.csv, windows.csv, readings.csv, summary.json, figures and report.html into `out`; return the page.

    readings: of all monitors; where there are none, readings.csv is not written. The files have the walks in which
    friction stayed as well; the figures and the table of robots have those in which it grew.

    Raises:
        StictionError: something cannot be written.

    """
    worn = [row for row in lives if row.steady is None]
    noticed = [row for row in readings if row.steady is None]
    try:
        for name, rows in (("lives", lives), ("windows", windows), ("readings", readings)):
            (out / f"{name}.csv").unlink(missing_ok=True)
            if rows:
                write_rows(out / f"{name}.csv", rows)
        write_summary(out / "summary.json", summary)
        ratios = draw_ratios([row for row in windows if row.steady is None], worn)
        ratios.savefig(out / "wear.png", dpi=150, facecolor="white")
        page = out / "report.html"
        parts = sections(picture(figure_uri(ratios), SPEED), worn, _monitor(out, noticed), summary)
        lead = " ".join(answers(summary["groups"], summary["settings"]["wear"]["end"], summary["ways"]))
        page.write_text(render_page("Wear", parts, lead, summary["warnings"]), encoding="utf-8")
    except OSError as error:
        raise StictionError(f"the study cannot be written to {out}: {error}; choose another --out") from error
    return page


def sections(
    ratios: Markup, worn: Sequence[Life], monitor: tuple[Markup, ...], summary: dict[str, Any]
) -> list[Section]:
    """Return the sections of the page.

    ratios: the figure of speed; worn: lives with friction that grew; monitor: what monitors said, as blocks.
    """
    settings = summary["settings"]
    joints = ", ".join(settings["wear"]["joints"]) or "all joints"
    rows = [_cells(row, settings["wear"]["end"]) for row in worn]
    made = (
        WHAT.format(joints=joints, **settings),
        f"Command: {summary['command']}",
        f"Revision {summary['revision']}, on {summary['machine']['cpu']}.",
        *([judged_text(summary)] if "judged" in summary else []),
    )
    return [
        Section("Speed while friction grows", (ratios,)),
        *([Section("Ways of training, over their seeds", _ways(summary["ways"]))] if summary["ways"] else []),
        Section("Every robot", (table(HEADER, rows), paragraph(ENDS))),
        Section("Does the monitor notice?", (*monitor, paragraph(MONITOR))),
        Section("Where nothing grew", _controls(summary["groups"])),
        Section("What was run", tuple(map(paragraph, made))),
    ]


SPEED = (
    f"Speed over the commanded one, means over windows, against the wear in the middle of each; a thin line is a "
    f"robot, a thick one their mean where all of them walk. Green: {BAND}, where a robot follows. Above it has not "
    "begun to, from where it stays below the policy's life is over."
)

WAYS = (
    "A policy is one sample: the geometric mean of the wear at which the lives of its robots end; then the mean of the "
    "logarithm over the policies, and its t-interval. Where a life goes on at the greatest wear that was tried, that "
    "wear stands for it: the mean is at least so much. One that never follows stands with the least wear: at most. "
    "Such means have no interval."
)

HEADER = (
    *("policy", "level", "robot", "ratio, first", "last", "follows from", "life ends at", "how"),
    *("unusual reading at", "which is", "growth told at", "which is"),
)

ENDS = (
    "Wear is a factor on each joint's dry friction, as a bench without load would find it. An end is known at the end "
    "of the first window that counts, and is reported at the wear in its middle. A robot lives while it follows: from "
    f"the first window within {BAND} of the command, and `follows from` where others came before it, to the last one. "
    f"Too slow: under {LEAST} from there on; too fast: over {MOST}; from the start: no window follows."
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

CONTROLS = (
    "The same robots under the same policies, for as long, with friction that stays. At the wear at which the others "
    "begin, that is the same walk but for growth: what is noticed there would have been noticed without any. x1 is the "
    "level itself, which friction that grows only passes. Whatever a monitor notices there, at once or later, is a "
    "false alarm; in brackets Wilson's 95 % interval over these robots. A life that ends there, or never was one, did "
    "not end by growth."
)

CONTROL_HEADER = (
    *("policy", "level", "friction stays at", "robots", "how they end"),
    *("false alarms: unusual reading", "at once", "false alarms: growth told"),
)

NO_CONTROLS = "No robot walked with friction that stays (--no-control): false alarms are not known."

WHAT = (
    "Virtual robots in {engine}, cell {cell}, with parameters of their own; the friction of {joints} grows by equal "
    "ratios from x{wear[start]:g} to x{wear[end]:g} of its level in {wear[seconds]:g} s and stays there for a window, "
    "under the constant command {command}. Nothing corrects the heading; the speed is that along the command, in the "
    "robot's frame. The first {settle:g} s are left out; windows have {window:g} s. Each robot walks once. Intervals "
    "are 95 % t-intervals of the mean of the factor's logarithm over the robots that these seeds made: they speak of "
    "virtual robots under this one policy, not of other trainings of its method."
)


def answers(groups: Sequence[dict[str, Any]], last: float, ways: Sequence[dict[str, Any]] = ()) -> list[str]:
    """Return a sentence or two for each policy and level, and one for each way of training with several seeds.

    last: the greatest factor that was tried [1]; ways: as of `stiction.transfer.wear_life.over_seeds`.
    """
    said = [" ".join((_ended(group, last), _noticed(group), *_stayed(group))) for group in groups]
    return [*said, *map(_way, ways)]


def _way(way: dict[str, Any]) -> str:
    """Say when the lives under one way of training end."""
    mean, spread, each = _way_life(way)
    over = f" (95 % over training seeds: {spread})" if spread else ""
    return f"{way['way']} at level {way['friction_level']}, {len(way['policies'])} seeds: {mean}{over}; {each}."


def _way_life(way: dict[str, Any]) -> tuple[str, str, str]:
    """Return the mean of one way in words, its interval, empty where lives did not end within what was tried, and the
    mean of each policy.
    """
    each = ", ".join(map(_policy_life, way["policies"].values()))
    if way["mean"] is not None:
        low, high = way["interval95"]
        return f"its policies' lives end at x{way['mean']:.2f}", f"x{low:.2f} to x{high:.2f}", each
    for name, words in (("at_least", "at least"), ("at_most", "at most")):
        if way[name] is not None:
            return f"its policies' lives end {words} at x{way[name]:.2f}", "", each
    return "some lives do not end and some robots never follow, so that there is no mean", "", each


def _policy_life(life: dict[str, Any]) -> str:
    """Return one policy's mean: after a sign where lives ended beyond what was tried, none where on both sides."""
    if life["alive"] and life["never"]:
        return "no mean"
    return f"{'≥ ' if life['alive'] else '≤ ' if life['never'] else ''}x{life['mean']:.2f}"


def _ways(ways: Sequence[dict[str, Any]]) -> tuple[Markup, ...]:
    """Return the table of the ways of training that have several policies."""
    header = ("way of training", "level", "seeds", "lives", "95 % over training seeds", "each seed")
    rows = []
    for way in ways:
        mean, spread, each = _way_life(way)
        rows.append([way["way"], way["friction_level"], str(len(way["policies"])), mean, spread or "–", each])
    return table(header, rows), paragraph(WAYS)


def _ended(group: dict[str, Any], last: float) -> str:
    """Say when the lives of one policy's robots ended."""
    count, ends = group["robots"], group["ends"]
    begin = f"{group['policy']} at level {group['friction_level']}:{_first_text(group)}"
    if group["mean"] is not None:
        spread = group["interval95"]
        of = f" (95 % over robots: x{spread[0]:.2f} to x{spread[1]:.2f})" if spread else ", one robot"
        return f"{begin} its life ends at x{group['mean']:.2f}{of}{_of_falls(ends)}."
    said = [f"{number} of {count} {PLURAL[end].format(last=last)}" for end, number in ends.items()]
    middle = f"; the median life ends at x{group['median']:.2f}" if group["median"] is not None else ""
    return f"{begin} {', '.join(said)}{middle}."


def _first_text(group: dict[str, Any]) -> str:
    """Say how many robots do not follow at first, and from which wear on they do; nothing where all follow."""
    wrong = [f"{number} of {group['robots']} {one}" for one, number in group["first"].items() if one != "follows"]
    if not wrong:
        return ""
    later = "" if group["begin"] is None else f", and those that come to follow do so from x{group['begin']:.2f} on"
    return f" at first {', '.join(wrong)}{later};"


PLURAL = {
    "alive": "robots still follow at x{last:g}",
    "too slow": f"slow under {LEAST} of the command before that",
    "too fast": f"run at over {MOST} of it in the end",
    "fell": "fall over before that",
    "too slow from the start": f"never follow, at first under {LEAST} of the command",
    "too fast from the start": f"never follow, at first over {MOST} of the command",
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


def _stayed(group: dict[str, Any]) -> list[str]:
    """Say what came where friction stayed, a sentence for each wear at which it did."""
    said = []
    for one in group["controls"]:
        alarms = f"; false alarms: an unusual reading for {_alarms(one, 'unusual')}, growth for {_alarms(one, 'grown')}"
        said.append(
            f"Where friction stayed at x{one['steady']:g}, {_ends_text(one)}{alarms if group['monitored'] else ''}."
        )
    return said


def _ends_text(control: dict[str, Any]) -> str:
    """Return how robots ended whose friction stayed: `3 of 5 follow to the end, 2 too fast from the start`."""
    ends = control["ends"]
    others = (f"{number} {end}" for end, number in ends.items() if end != "alive")
    return ", ".join((f"{ends.get('alive', 0)} of {control['robots']} follow to the end", *others))


def _alarms(control: dict[str, Any], name: str) -> str:
    """Return how many robots set off one signal, with the interval of the share."""
    low, high = control["interval95"][name]
    return f"{control['alarms'][name]} of {control['robots']} ({low:.0%} to {high:.0%})"


def _controls(groups: Sequence[dict[str, Any]]) -> tuple[Markup, ...]:
    """Return the table of the walks in which friction stayed."""
    rows = []
    for group in groups:
        for one in group["controls"]:
            alarms = [_alarms(one, "unusual"), str(one["at_once"]["unusual"]), _alarms(one, "grown")]
            named = [group["policy"], group["friction_level"], f"x{one['steady']:g}"]
            counts = [str(one["robots"]), _ends_text(one)]
            rows.append([*named, *counts, *(alarms if group["monitored"] else ["no monitor", "–", "–"])])
    return (table(CONTROL_HEADER, rows), paragraph(CONTROLS)) if rows else (paragraph(NO_CONTROLS),)


def _monitor(out: Path, readings: Sequence[Reading]) -> tuple[Markup, ...]:
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


def _cells(row: Life, last: float) -> list[str]:
    """Return one row as text."""
    at = f"x{row.factor:.2f}" if row.factor is not None else f"over x{last:g}" if row.end == "alive" else "–"
    notices = []
    for factor, when in ((row.unusual_factor, row.unusual), (row.grown_factor, row.grown)):
        notices += ["no monitor", "–"] if not row.monitored else ["–" if factor is None else f"x{factor:.2f}", when]
    begin = "–" if row.begin is None else f"x{row.begin:.2f}"
    ratios = map(_ratio_text, (row.first_ratio, row.last_ratio))
    return [row.policy, row.friction_level, str(row.robot), *ratios, begin, at, row.end, *notices]


def _ratio_text(ratio: float | None) -> str:
    """Return a speed ratio, and what is wrong with it."""
    if ratio is None:
        return "–"
    return f"{ratio:.2f}" if pace(ratio) == "follows" else f"{ratio:.2f}, {pace(ratio)}"
