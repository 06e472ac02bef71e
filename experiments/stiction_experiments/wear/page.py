"""The page on wear: at how much friction a policy's lifetime ends, and what its monitor noticed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from stiction.files.wear import LEVEL
from stiction.report.following import shade_following
from stiction.report.page import (
    Section,
    figure_block,
    fold,
    label_ends,
    labelled,
    legend,
    line_look,
    mark_look,
    new_figure,
    paragraph,
    row_table,
    table,
)
from stiction.virtual.cases import BENCH
from stiction_experiments.lab.straight import BAND, FAST, SLOW
from stiction_experiments.lab.study import Report
from stiction_experiments.wear.lifetimes import NEVER, SIGNALS, Lifetime, Reading, Window, factor_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure


TICKS = (0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
"""Factors that are written under an axis, as far as they are on it."""


def draw_ratios(windows: Sequence[Window], lifetimes: Sequence[Lifetime], joints: Sequence[str] = ()) -> Figure:
    """Return the speed ratio over wear, a panel for each level and command, a colour and style for each policy.

    joints: those that wear; none is all of them.
    """
    # By the robots and not by the windows: those that fall at once have none.
    panels = list(dict.fromkeys((row.friction_level, one) for row in lifetimes for one in row.command.split()))
    policies = list(dict.fromkeys(row.policy for row in lifetimes))
    figure, axes = new_figure(len(panels), 1, (8.0, 3.4 * len(panels)))
    for axis in axes[1:]:
        # So that forward and backward can be held side by side.
        axis.sharex(axes[0])
        axis.sharey(axes[0])
    for axis, (level, command) in zip(axes, panels, strict=True):
        shade_following(axis)
        for policy in policies:
            look = line_look(policy, policies)
            rows = [row for row in windows if (row.policy, row.friction_level, row.command) == (policy, level, command)]
            own = [row for row in lifetimes if (row.policy, row.friction_level) == (policy, level)]
            lines = [[row for row in rows if row.robot == robot] for robot in dict.fromkeys(row.robot for row in own)]
            for line in lines:
                points = [row.factor for row in line], [row.ratio for row in line]
                axis.plot(*points, linewidth=0.7, alpha=0.5, **look)
            shared = min((len(line) for line in lines), default=0)
            means = [sum(line[at].ratio for line in lines) / len(lines) for at in range(shared)]
            factors = [row.factor for row in lines[0][:shared]] if lines else []
            axis.plot(factors, means, linewidth=2, label=policy, **look)
        axis.set(
            xscale="log",
            xlabel="wear, factor on dry friction",
            ylabel="speed reached / commanded",
            title=", ".join((command, level_title(level), *joints)),
        )
    for axis in axes:
        ticks = [tick for tick in TICKS if axis.get_xlim()[0] <= tick <= axis.get_xlim()[1]]
        axis.set_xticks(ticks, [f"x{tick:g}" for tick in ticks])
        axis.set_xticks([], minor=True)
        label_ends(axis)
    # Under the panels: the lines of several policies leave it no place in them.
    legend(figure, labelled(axes[0]), loc="outside lower center", ncols=3)
    return figure


def level_title(level: str) -> str:
    """Return in words of which friction the factors are: `x1 is 10 % of the torque limit`."""
    share = friction_of(level, 1.0)
    return f"x1 is {share} of the torque limit" if share.endswith("%") else f"x1 is the level {level}"


def draw_readings(readings: Sequence[Reading]) -> Figure:
    """Return estimate and truth over time, a panel a policy, level and command, a colour, style and mark a robot."""
    panels = list(dict.fromkeys((row.policy, row.friction_level, row.command) for row in readings))
    figure, axes = new_figure(len(panels), 1, (8.0, 3.4 * len(panels)))
    for axis, panel in zip(axes, panels, strict=True):
        rows = [row for row in readings if (row.policy, row.friction_level, row.command) == panel]
        robots = list(dict.fromkeys(f"robot {row.robot}" for row in rows))
        for number, robot in enumerate(robots):
            look, mark = line_look(robot, robots), mark_look(robot, robots)
            mine = [row for row in rows if f"robot {row.robot}" == robot]
            axis.plot([row.time for row in mine], [100 * row.true for row in mine], linewidth=1.0, **look)
            shift, color = number / len(robots), look["color"]
            for row in mine:
                if row.estimate is None or row.low is None or row.high is None:
                    continue
                ends = max(0.0, row.estimate - row.low), max(0.0, row.high - row.estimate)
                fill = "none" if row.unusual else color
                style = {"marker": mark, "markersize": 4, "markerfacecolor": fill, "capsize": 2, "linewidth": 0.8}
                bars = [[100 * end] for end in ends]
                axis.errorbar(row.time + shift, 100 * row.estimate, bars, color=color, **style)
            axis.plot([], [], linewidth=1.0, marker=mark, markersize=4, label=robot, **look)
        target = "mean over the joints" if rows[0].target == LEVEL else rows[0].target
        axis.set(
            xlabel="time [s]", ylabel=f"f/τ_max [%], {target}", title=f"{panel[0]}, {panel[2]}, {level_title(panel[1])}"
        )
        legend(axis)
    return figure


def report(
    lifetimes: Sequence[Lifetime],
    windows: Sequence[Window],
    readings: Sequence[Reading],
    settings: dict[str, Any],
    warnings: Sequence[str] = (),
) -> Report:
    """Return the report of the study. settings: `settings`, `groups`, `ways`, and more for summary.json.

    Figures and the table of robots show the walks in which friction grew, the files have all.
    """
    worn = [row for row in lifetimes if row.steady is None]
    noticed = [row for row in readings if row.steady is None]
    grown = [row for row in windows if row.steady is None]
    ratios = draw_ratios(grown, worn, settings["settings"]["wear"]["joints"])
    monitor = draw_readings(noticed) if noticed else None
    unread = NO_READING if any(row.monitored for row in lifetimes) else NO_MONITOR
    shown = paragraph(unread) if monitor is None else figure_block(monitor, MONITOR_CAPTION)
    groups, methods = settings["groups"], settings["ways"]
    lines = [lead(groups, settings["settings"]), *answers(groups, methods)]
    joints = ", ".join(settings["settings"]["wear"]["joints"]) or "all joints"
    commanded = " and ".join(settings["settings"]["commands"])
    over_seeds = Section("Training methods, over their seeds", (method_table(methods), paragraph(METHODS)))
    return Report(
        title="How long does a policy follow while friction grows?",
        lead=lines[0],
        tables={"lives": lifetimes, "windows": windows, "readings": readings},
        sections=(
            Section("Speed while friction grows", (figure_block(ratios, SPEED),)),
            Section("Every policy", (group_table(groups), paragraph(ENDS))),
            *([over_seeds] if methods else []),
            Section("Every robot", (fold("Speed, end and readings, robot by robot", [row_table(worn, grouped=True)]),)),
            Section("Does the monitor notice?", (shown, paragraph(MONITOR))),
            Section("Where nothing grew", control_blocks(groups)),
        ),
        run=(paragraph(WHAT.format(joints=joints, commanded=commanded, **settings["settings"])),),
        summary=settings | {"lives": list(map(asdict, lifetimes))},
        warnings=warnings,
        figures={"wear": ratios, "monitor": monitor},
        answer=lines,
    )


SPEED = (
    "Speed over the commanded one, means over windows, against the wear in the middle of each; a thin line is a robot, "
    f"a thick one their mean where all of them walk. Green: {BAND}, where a robot follows."
)

METHODS = (
    "A policy is one sample: the geometric mean of the wear at which the lifetimes of its robots end; then the mean of "
    "the logarithm over the policies, and its t-interval. A lifetime that goes on counts with the greatest wear that "
    "was tried, so that the mean is at least so much (≥); a robot that never follows with the least: at most (≤)."
)

ENDS = (
    "Wear is a factor on each joint's dry friction, as a bench without load would find it. A lifetime lasts from the "
    f"first window within {BAND} of the command (`follows from wear`, where others came before it) to the last one; "
    "its end is known at the end of the window after that, and reported at the wear in that window's middle. Of "
    "several commands the one that is followed worst counts, window by window. Too slow: "
    f"under {SLOW} from there on; too fast: over {FAST}; from the start: no window follows. The mean and its 95 % "
    "interval over robots are of the logarithm, and given where every lifetime ended within the wear that was tried."
)

NO_MONITOR = "None of these bundles has a wear monitor; `stiction export --wear` puts one into a bundle."

NO_READING = "No wear monitor came to a reading: no walk was as long as its window."

MONITOR_CAPTION = (
    "The monitor's estimate of the friction, with its 95 % interval, against the truth (line), window by window; "
    "hollow: an unusual reading."
)

MONITOR = (
    "The monitor reads the input of the policy's network, nothing else, and gives an estimate once a window. An "
    "unusual reading is unlike those that it was fitted on: more friction, or another robot. At once: in the first "
    "window, when nothing had worn yet. Growth is detected by the first reading whose 95 % interval lies wholly above "
    "that of the first one. Before and after: the end of the policy's lifetime. The truth is the friction in motion "
    "that a bench without load would find. A monitor is fitted in the training's simulator, on Coulomb friction: it "
    "takes whatever else a robot has for friction, or for unusual."
)

CONTROLS = (
    "The same robots under the same policies, for as long, with friction that stays: at the wear at which the others "
    "begin, so that growth alone is missing, and at x1, the level itself. Whatever a monitor notices there, at once or "
    "later, is a false alarm, of the robots that it read; in brackets Wilson's 95 % interval over these."
)

NO_CONTROLS = "No robot walked with friction that stays (--no-control): false alarms are not known."

WHAT = (
    "Virtual robots in {engine}, cell {cell}, with parameters of their own; the friction of {joints} grows by equal "
    "ratios from x{wear[start]:g} to x{wear[end]:g} of its level in {wear[seconds]:g} s and stays there for a window, "
    "under the constant command {commanded}. Nothing corrects the heading; the speed is that along the command, in the "
    "robot's frame. The first {settle:g} s are left out; windows have {window:g} s. Each robot walks once a "
    "command. Intervals over robots are of virtual robots under this one policy, not of other trainings of its method."
)


def lead(groups: Sequence[dict[str, Any]], settings: dict[str, Any]) -> str:
    """Return in one sentence from and up to which wear each policy follows. settings: of the study."""
    wear, commands = settings["wear"], settings["commands"]
    lives: dict[str, list[str]] = {}
    for one in groups:
        lives.setdefault(one["friction_level"], []).append(f"{one['policy']} {_lifetime_text(one)}")
    lines = [
        f"While dry friction grows from {friction_of(level, wear['start'])} to {friction_of(level, wear['end'])} "
        f"of {level if level == BENCH else 'the torque limit'}, {'; '.join(own)}."
        for level, own in lives.items()
    ]
    along = [one for one in commands if one.startswith("vx=")]
    if len({one.startswith("vx=-") for one in along}) == 1:
        lines.append(f"They walked one way alone, {' and '.join(along)}: whether they follow both ways is not known.")
    return " ".join(lines)


def friction_of(level: str, factor: float | None) -> str:
    """Return the friction of worn joints of a level in words: of the torque limit, or the factor on a bench's."""
    try:
        return "–" if factor is None else f"{100 * float(level) * factor:.3g} %"
    except ValueError:
        return factor_text(factor)


def _lifetime_text(group: dict[str, Any]) -> str:
    """Return from and up to which wear the robots of one policy and level follow."""
    if all(what.endswith(NEVER) for what in group["ends"]):
        return "never follows"
    if not group["first"] and group["mean"] is not None:
        return f"falls at {friction_of(group['friction_level'], group['mean'])}, before its first window is over"
    later = group["begin"] is not None and not group["first"].get("follows")
    level = group["friction_level"]
    begin = f"from {friction_of(level, group['begin'])} on, " if later else ""
    if group["mean"] is not None:
        return f"follows {begin}up to {friction_of(level, group['mean'])}"
    return f"follows {begin}to the end on {group['ends'].get('alive', 0)} of {group['robots']} robots"


def answers(groups: Sequence[dict[str, Any]], methods: Sequence[dict[str, Any]] = ()) -> list[str]:
    """Return a line for each policy and level, and for each training method with several seeds."""
    return [
        *(f"{one['policy']} at level {one['friction_level']}: {_counts(one['ends'])}; {_mean(one)}." for one in groups),
        *(
            f"{one['way']} at level {one['friction_level']}, {len(one['policies'])} seeds: {_mean(one)}."
            for one in methods
        ),
    ]


def _mean(group: dict[str, Any]) -> str:
    """Return the mean wear at which lifetimes end with its interval, or a bound of it."""
    for name, sign in (("mean", ""), ("at_least", "≥ "), ("at_most", "≤ ")):
        if group.get(name) is not None:
            spread = f" ({_span(group['interval95'])})" if group["interval95"] else ""
            return f"lifetimes end at {sign}{factor_text(group[name])}{spread}"
    return "no mean wear at the end"


def _counts(counts: dict[str, int]) -> str:
    """Return how often each thing came: `2 too slow, 1 fell`."""
    return ", ".join(f"{number} {what}" for what, number in counts.items())


def _span(interval: Sequence[float] | None) -> str:
    """Return an interval of wear, a dash where there is none."""
    return "–" if interval is None else " to ".join(map(factor_text, interval))


def group_table(groups: Sequence[dict[str, Any]]) -> Markup:
    """Return how the robots of each policy and level ended, and what its monitors noticed."""
    header: tuple[str, ...] = ("policy", "level [of τ_max]", "robots", "at first", "follows from wear [1]", "ends")
    header += ("mean wear at the end [1]", "95 % [1]", "median [1]")
    rows = []
    for one in groups:
        ends = [_counts(one["ends"]), factor_text(one["mean"]), _span(one["interval95"]), factor_text(one["median"])]
        noticed = [_counts(one[name]) if one["monitored"] else "no monitor" for name in SIGNALS]
        held = "–" if one["held"] is None else f"{one['held']:.0%}"
        named = [one["policy"], one["friction_level"], str(one["robots"])]
        rows.append([*named, _counts(one["first"]), factor_text(one["begin"]), *ends, *noticed, held])
    return table(
        (*header, "unusual reading", "growth detected", "95 % intervals hold [% of readings]"), rows, grouped=True
    )


def method_table(methods: Sequence[dict[str, Any]]) -> Markup:
    """Return when lifetimes end of the training methods that have several policies."""
    header: tuple[str, ...] = (
        "training method",
        "level [of τ_max]",
        "seeds",
        "mean wear at the end [1]",
        "95 % over seeds [1]",
    )
    header += ("at least [1]", "at most [1]")
    rows = [
        [
            *(one["way"], one["friction_level"], str(len(one["policies"]))),
            *(factor_text(one["mean"]), _span(one["interval95"])),
            *(factor_text(one["at_least"]), factor_text(one["at_most"])),
            ", ".join(map(_policy_mean, one["policies"].values())),
        ]
        for one in methods
    ]
    return table((*header, "each seed [1]"), rows)


def _policy_mean(policy: dict[str, Any]) -> str:
    """Return one policy's mean, after a sign where it is a bound; none where it is neither."""
    if policy["alive"] and policy["never"]:
        return "no mean"
    return f"{'≥ ' if policy['alive'] else '≤ ' if policy['never'] else ''}{factor_text(policy['mean'])}"


def control_blocks(groups: Sequence[dict[str, Any]]) -> tuple[Markup, ...]:
    """Return the table of the walks in which friction stayed."""
    header: tuple[str, ...] = ("policy", "level [of τ_max]", "friction stays at wear [1]", "robots", "ends")
    header += ("false alarms: unusual reading [robots]", "at once [robots]")
    rows = []
    for group in groups:
        for one in group["controls"]:
            alarms = [_alarms(one, "unusual"), str(one["at_once"]["unusual"]), _alarms(one, "grown")]
            named = [group["policy"], group["friction_level"], f"x{one['steady']:g}"]
            counts = [str(one["robots"]), _counts(one["ends"])]
            rows.append([*named, *counts, *(alarms if group["monitored"] else ["no monitor", "–", "–"])])
    if not rows:
        return (paragraph(NO_CONTROLS),)
    return table((*header, "false alarms: growth detected [robots]"), rows), paragraph(CONTROLS)


def _alarms(control: dict[str, Any], name: str) -> str:
    """Return how many of the robots that a monitor read set off one signal, with the interval of the share."""
    if not control["read"]:
        return "nothing read"
    low, high = control["interval95"][name]
    return f"{control['alarms'][name]} of {control['read']} ({low:.0%} to {high:.0%})"
