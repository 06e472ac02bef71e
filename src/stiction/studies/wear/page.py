"""The page on wear: at how much friction a policy's life ends, and whether its monitor saw that coming."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from stiction.formats.following import BAND, LEAST, MOST, pace
from stiction.formats.results import FOLLOWS
from stiction.report.page import COLORS, Section, figure_uri, legend, new_figure, paragraph, picture, table
from stiction.studies.study import Report
from stiction.studies.wear.lives import Life, Reading, Window

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_ratios(windows: Sequence[Window], lives: Sequence[Life]) -> Figure:
    """Return the speed ratio over wear, a panel for each level, a colour for each policy."""
    levels = list(dict.fromkeys(row.friction_level for row in lives))
    policies = list(dict.fromkeys(row.policy for row in lives))
    figure, axes = new_figure(len(levels), 1, (8.0, 3.4 * len(levels)))
    for axis, level in zip(axes, levels, strict=True):
        axis.axhspan(*FOLLOWS, color=COLORS[2], alpha=0.12, linewidth=0)
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


def _plain(axis: Axes) -> None:
    """Write factors as people do."""
    low, high = axis.get_xlim()
    ticks = [tick for tick in TICKS if low <= tick <= high]
    axis.set_xticks(ticks, [f"x{tick:g}" for tick in ticks])
    axis.set_xticks([], minor=True)


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


def report(
    lives: Sequence[Life],
    windows: Sequence[Window],
    readings: Sequence[Reading],
    settings: dict[str, Any],
    warnings: Sequence[str] = (),
) -> Report:
    """Return the report of the study.

    The files have the walks in which friction stayed as well; the figures and the table of robots have those in which
    it grew. readings: of all monitors; settings: `settings`, `groups`, `ways`, and more for summary.json.
    """
    last = settings["settings"]["wear"]["end"]
    worn = [row for row in lives if row.steady is None]
    noticed = [row for row in readings if row.steady is None]
    ratios = draw_ratios([row for row in windows if row.steady is None], worn)
    monitor = draw_readings(noticed) if noticed else None
    said = answers(settings["groups"], last, settings["ways"])
    joints = ", ".join(settings["settings"]["wear"]["joints"]) or "all joints"
    return Report(
        title="Wear",
        lead=" ".join(said),
        tables={"lives": lives, "windows": windows, "readings": readings},
        sections=(
            Section("Speed while friction grows", (picture(figure_uri(ratios), SPEED),)),
            *([Section("Training methods, over their seeds", _ways(settings["ways"]))] if settings["ways"] else []),
            Section("Every robot", (table(HEADER, [_cells(row, last) for row in worn]), paragraph(ENDS))),
            Section("Does the monitor notice?", (_monitor(monitor), paragraph(MONITOR))),
            Section("Where nothing grew", _controls(settings["groups"])),
        ),
        run=(paragraph(WHAT.format(joints=joints, **settings["settings"])),),
        summary=settings | {"lives": list(map(asdict, lives))},
        warnings=warnings,
        figures={"wear": ratios, "monitor": monitor},
        answer=said,
    )


SPEED = (
    f"Speed over the commanded one, means over windows, against the wear in the middle of each; a thin line is a "
    f"robot, a thick one their mean where all of them walk. Green: {BAND}, where a robot follows. Above it has not "
    "begun to, from where it stays below the policy's life is over."
)

METHODS = (
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


def answers(groups: Sequence[dict[str, Any]], last: float, methods: Sequence[dict[str, Any]] = ()) -> list[str]:
    """Return a sentence or two for each policy and level, and one for each training method with several seeds.

    last: the greatest factor that was tried [1]; methods: as of `stiction.studies.wear.lives.over_seeds`.
    """
    said = [" ".join((_ended(group, last), _noticed(group), *_stayed(group))) for group in groups]
    return [*said, *map(_way, methods)]


def _way(method: dict[str, Any]) -> str:
    """Say when the lives under one training method end."""
    mean, spread, each = _way_life(method)
    over = f" (95 % over training seeds: {spread})" if spread else ""
    return (
        f"{method['way']} at level {method['friction_level']}, {len(method['policies'])} seeds: {mean}{over}; {each}."
    )


def _way_life(method: dict[str, Any]) -> tuple[str, str, str]:
    """Return the mean of one way in words, its interval, empty where lives did not end within what was tried, and the
    mean of each policy.
    """
    each = ", ".join(map(_policy_life, method["policies"].values()))
    if method["mean"] is not None:
        low, high = method["interval95"]
        return f"its policies' lives end at x{method['mean']:.2f}", f"x{low:.2f} to x{high:.2f}", each
    for name, words in (("at_least", "at least"), ("at_most", "at most")):
        if method[name] is not None:
            return f"its policies' lives end {words} at x{method[name]:.2f}", "", each
    return "some lives do not end and some robots never follow, so that there is no mean", "", each


def _policy_life(life: dict[str, Any]) -> str:
    """Return one policy's mean: after a sign where lives ended beyond what was tried, none where on both sides."""
    if life["alive"] and life["never"]:
        return "no mean"
    return f"{'≥ ' if life['alive'] else '≤ ' if life['never'] else ''}x{life['mean']:.2f}"


def _ways(methods: Sequence[dict[str, Any]]) -> tuple[Markup, ...]:
    """Return the table of the training methods that have several policies."""
    header = ("training method", "level", "seeds", "lives", "95 % over training seeds", "each seed")
    rows = []
    for method in methods:
        mean, spread, each = _way_life(method)
        rows.append([method["way"], method["friction_level"], str(len(method["policies"])), mean, spread or "–", each])
    return table(header, rows), paragraph(METHODS)


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


def _monitor(figure: Figure | None) -> Markup:
    """Return the figure of what monitors said against the truth; a sentence where there is none."""
    if figure is None:
        return paragraph("None of these bundles has a wear monitor; `stiction export --wear` puts one into a bundle.")
    caption = (
        "What the monitor took the friction for, with its 95 % interval, against the truth (line), window by window; "
        "hollow: it said that the walk is unusual."
    )
    return picture(figure_uri(figure), caption)


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
