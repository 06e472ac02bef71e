"""The page on adaptation, from the study's summary: latents taken away, what they tell, and whether wear is told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from stiction.formats.results import ResultRow
from stiction.report.page import (
    COLORS,
    INK,
    Section,
    figure_uri,
    fold,
    legend,
    new_figure,
    paragraph,
    picture,
    table,
)
from stiction.studies.study import Report

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


ROWS = {"step": "one step", "walk": "whole walk"}
"""What a probe of the figure reads at once -> its words."""

LOWEST = -0.2
"""Left end of the axis of R² [-]: what is below is drawn there, it tells nothing either."""


def draw_probes(methods: dict[str, Any], inputs: dict[str, str], targets: dict[str, str]) -> Figure:
    """Return R² of every input, a panel for friction per joint and one for friction per robot.

    A dot is a seed, a bar the t-interval of their mean where there are several.

    Args:
        methods: training -> `probes`, as in the summary; those of a step and of whole walks are drawn.
        inputs: input -> its words, in the order from top to bottom.
        targets: `joint` and `robot` -> what a panel is called.

    """
    probes = {method: [p for p in found["probes"] if not p["shuffled"]] for method, found in methods.items()}
    there = {(probe["input"], probe["row"]) for found in probes.values() for probe in found}
    shown = [(name, row) for name in inputs for row in ROWS if (name, row) in there]
    figure, axes = new_figure(1, len(targets), size=(4.6 * len(targets) + 1.6, 0.42 * len(shown) + 1.6))
    heights = {key: height for height, key in enumerate(shown)}
    for axis, (per, title) in zip(axes, targets.items(), strict=True):
        for index, (method, found) in enumerate(probes.items()):
            shift = 0.12 * (index - (len(methods) - 1) / 2)
            for probe in (p for p in found if p["per"] == per and (p["input"], p["row"]) in heights):
                height = heights[probe["input"], probe["row"]]
                _mark(axis, probe, height + shift, COLORS[index % len(COLORS)], "" if height else method)
        axis.axvline(0.0, color=INK, linewidth=0.8)
        axis.set(title=title, xlabel="R² on unseen robots", xlim=(LOWEST, 1.02), ylim=(len(shown) - 0.5, -0.5))
        words = [f"{inputs[name]}, {ROWS[row]}" for name, row in shown]
        axis.set_yticks(range(len(shown)), words if axis is axes[0] else [""] * len(shown))
    legend(axes[0])
    return figure


def _mark(axis: Axes, probe: dict[str, Any], height: float, colour: str, label: str) -> None:
    """Draw one training's R² of one input."""
    interval = probe["interval95"]
    if interval is not None:
        axis.plot([max(end, LOWEST) for end in interval], [height, height], color=colour, linewidth=3, alpha=0.35)
    seeds = [max(value, LOWEST) for value in probe["each"]]
    axis.plot(seeds, [height] * len(seeds), "o", color=colour, markersize=4, label=label or None)


def draw_effects(methods: dict[str, Any], latents: dict[str, str]) -> Figure:
    """Return by how much another z* changes the speed ratio, over the friction level, a panel for each training.

    methods: training -> `effects`, as in the summary. A thin line is a seed, a thick one their mean.
    latents: where z* comes from -> its words.
    """
    figure, axes = new_figure(1, max(1, len(methods)), size=(3.8 * max(1, len(methods)), 3.2))
    for axis, (method, found) in zip(axes, methods.items(), strict=False):
        for colour, (latent, words) in zip(COLORS, latents.items(), strict=False):
            points = _sorted(found["effects"], latent)
            levels = [100 * point["level"] for point in points]
            for seed in range(len(points[0]["each"]) if points else 0):
                axis.plot(levels, [point["each"][seed] for point in points], color=colour, linewidth=0.7, alpha=0.5)
            axis.plot(levels, [p["difference"] for p in points], color=colour, marker="o", markersize=4, label=words)
        axis.axhline(0.0, color=INK, linewidth=0.8)
        axis.set(title=method, xlabel="friction, % of torque limit")
    ends = [end for axis in axes for end in axis.get_ylim()]
    for axis in axes:
        axis.set_ylim(min(ends), max(ends))  # the trainings are to be compared
    axes[0].set_ylabel("change of the speed ratio")
    legend(axes[0])
    return figure


def _sorted(effects: Sequence[dict[str, Any]], latent: str) -> list[dict[str, Any]]:
    """Return what one latent does to the speed ratio, from low friction to high."""
    found = [effect for effect in effects if (effect["latent"], effect["figure"]) == (latent, "speed_ratio")]
    return sorted(found, key=lambda effect: effect["level"])


LATENT = {"mean": "frozen at its mean", "swapped": "of another friction level", "peer": "of a robot at the same level"}
"""Where the latent comes from, in words."""

INPUT = {
    "latent": "z*",
    "explicit": "explicit estimate o_exp*",
    "frame": "one frame",
    "moments": "moments of a frame",
    "history 11": "history, H = 10",
    "history 21": "history, H = 20",
    "history 51": "history, H = 50",
    "teacher": "teacher's z, from o_priv",
}
"""Inputs of the probes, in words."""

TARGET = {"joint": "each joint's friction, drawn joint by joint", "robot": "the one friction of a robot's joints"}

ABOUT_LATENTS = (
    "The student walks with the same network, initial state and noise; only what the actor is given as z* changes. The "
    "mean is over all robots and measured steps of the same evaluation with another seed. A swapped z* is that of a "
    "robot with the same command, half of the levels away, at the same step: its friction is wrong, and its gait is at "
    "another phase. The robot at the same level is the control for the second: what it does to the walk, wrong "
    "friction alone cannot explain. Differences are to the walk on the robot's own z*, means over commands."
)

ABOUT_PROBES = (
    "Ridge regression to f/τ_max, fitted on three quarters of the robots, its penalty chosen within them, R² on the "
    "last quarter: 1 is perfect, 0 is no better than the mean of the training robots. All but the friction is drawn as "
    "in training: masses, gains, inertia, damping, delay, offsets, ground, pushes, noise, commands. No torque is in "
    "o_H; what makes it is: target, angle, velocity. A linear probe of o_H cannot multiply them, the moments do."
)

ABOUT_WEAR = (
    "The monitor maps the moments of a window of walking to each joint's f/τ_max, with a 95 % interval from robots it "
    "was not fitted on; R² and coverage are of a third group. It needs the network's input alone. A target is exposed "
    "where the lower end of its R² is above {:g}, and withheld elsewhere. All of this is simulation, with the "
    "randomisation of training: no robot has confirmed it."
)

EACH_LINE = "A thin line is a training seed, a thick one their mean."
EACH_DOT = (
    "A dot is a training seed, a bar the 95 % t-interval of their mean. One step: z*, or the frames that it was made "
    "of, as they come."
)


def percent(values: Sequence[bool]) -> str:
    """Return how many of `values` hold."""
    return f"{sum(values)} of {len(values)}"


def span(interval: Sequence[float] | None, digits: int = 2) -> str:
    """Return an interval in words, a dash where there is none."""
    return "–" if interval is None else f"{interval[0]:.{digits}f} to {interval[1]:.{digits}f}"


def find(probes: Sequence[dict[str, Any]], name: str, row: str, per: str) -> dict[str, Any]:
    """Return one probe."""
    return next(p for p in probes if (p["input"], p["row"], p["per"], p["shuffled"]) == (name, row, per, False))


def lead(summary: dict[str, Any]) -> str:
    """Return the answer, a sentence for each training: over its seeds, where it has several."""
    texts = []
    for method, found in summary["methods"].items():
        runs = [summary["runs"][name] for name in found["runs"]]
        one = len(runs) == 1
        probes = runs[0]["probes"] if one else found["probes"]  # one run's intervals are over robots
        told = [run["wear"]["told"] for run in runs]
        texts.append(_sentence(found["runs"][0] if one else f"{method}, {len(runs)} seeds", probes, told))
    return " ".join(texts)


def _sentence(name: str, probes: Sequence[dict[str, Any]], told: Sequence[Sequence[bool]]) -> str:
    """Return what is told of friction, in words; told: for each run, of each joint and of the level."""
    star, moments = (find(probes, kind, "walk", "joint") for kind in ("latent", "moments"))
    level = find(probes, "latent", "walk", "robot")
    return (
        f"{name}: z* tells each joint's friction with R² {star['mean']:.2f} ({span(star['interval95'])}), a robot's"
        f" level with {level['mean']:.2f} ({span(level['interval95'])}); moments of the same walk tell each joint's"
        f" with {moments['mean']:.2f} ({span(moments['interval95'])}); {monitored(told)}."
    )


def monitored(told: Sequence[Sequence[bool]]) -> str:
    """Return what wear monitors tell, in words; told: as of `_sentence`."""
    joints, levels = [sum(one[:-1]) for one in told], [one[-1] for one in told]
    if not any(joints) and not any(levels):
        return "no wear is told"
    low, high, of = min(joints), max(joints), len(told[0]) - 1
    parts = []
    if high:
        parts.append(f"the friction of {low if low == high else f'{low} to {high}'} of {of} joints")
    if any(levels):
        parts.append("the robot's level" if all(levels) else f"in {percent(levels)} runs the robot's level")
    return f"a wear monitor tells {' and '.join(parts)}"


def report(found: dict[str, Any]) -> Report:
    """Return the report of the study, from what summary.json has of it."""
    effects, probes = draw_effects(found["methods"], LATENT), draw_probes(found["methods"], INPUT, TARGET)
    return Report(
        title="What does adaptation do?",
        lead=lead(found),
        tables={"results": [ResultRow(**row) for run in found["runs"].values() for row in run["latents"]["rows"]]},
        sections=sections(found, effects, probes),
        summary=found,
        figures={"latents": effects, "probes": probes},
    )


def sections(summary: dict[str, Any], effects: Figure, probes: Figure) -> list[Section]:
    """Return the page's parts, with the figures of `draw_effects` and `draw_probes`."""
    runs = summary["runs"]
    effects_tables = {name: effects_table(name, run["latents"]["effects"]) for name, run in runs.items()}
    probes_tables = {name: probes_table(name, run["probes"]) for name, run in runs.items()}
    wear_tables = {name: wear_table(name, run["wear"]) for name, run in runs.items()}
    return [
        Section(
            "Latents taken away and swapped",
            (
                paragraph(ABOUT_LATENTS),
                picture(figure_uri(effects), EACH_LINE),
                *over_runs(summary["methods"], effects_tables, lambda name, m: effects_table(name, m["effects"])),
            ),
        ),
        Section(
            "What z* tells of the friction",
            (
                paragraph(ABOUT_PROBES),
                picture(figure_uri(probes), EACH_DOT),
                *over_runs(summary["methods"], probes_tables, lambda name, m: probes_table(name, m["probes"])),
            ),
        ),
        Section(
            "Can it watch for wear?",
            (paragraph(ABOUT_WEAR.format(summary["threshold"])), *_or_folded("every run", list(wear_tables.values()))),
        ),
    ]


def over_runs(
    methods: dict[str, Any], tables: dict[str, Markup], pooled: Callable[[str, dict[str, Any]], Markup]
) -> list[Markup]:
    """Return a training's table over its seeds where it has several, and those of its runs folded.

    methods: training -> what its runs have together; tables: run -> its table; pooled: makes the table over seeds.
    """
    found: list[Markup] = []
    for method, one in methods.items():
        own = [tables[name] for name in one["runs"]]
        if len(own) > 1:
            found += [pooled(f"{method}, over {len(own)} seeds", one), fold(f"{method}: every run", own)]
        else:
            found += own
    return found


def _or_folded(title: str, tables: list[Markup]) -> list[Markup]:
    """Return few tables as they are, and many behind a fold."""
    return tables if len(tables) <= 2 else [*tables[:1], fold(title, tables[1:])]


def effects_table(name: str, effects: Sequence[dict[str, Any]]) -> Markup:
    """Return what other latents change, a row for each latent and level."""
    ratio, error = (
        [effect for effect in effects if effect["figure"] == figure] for figure in ("speed_ratio", "tracking_error")
    )
    rows = [
        [
            f"{LATENT[a['latent']]}, {a['level']:.0%}",
            f"{a['own']:.2f}",
            f"{a['value']:.2f}",
            f"{a['difference']:+.3f} ({span(a['interval95'], 3)})",
            f"{b['difference']:+.3f} ({span(b['interval95'], 3)})",
        ]
        for a, b in zip(ratio, error, strict=True)
    ]
    header = ("z*, friction", "speed ratio, own z*", "with this z*", "difference", "difference of the error [m/s]")
    return table(header, rows, f"{name}: 95 % intervals in brackets")


def probes_table(name: str, probes: Sequence[dict[str, Any]]) -> Markup:
    """Return R² of every input, friction per joint and per robot side by side."""
    cells: dict[str, list[str]] = {}
    for probe in probes:
        label = f"{INPUT[probe['input']]}, {probe['row']}" + (", friction shuffled" if probe["shuffled"] else "")
        cells.setdefault(label, []).append(f"{probe['mean']:.2f} ({span(probe['interval95'])})")
    rows = [[label, *values] for label, values in cells.items()]
    return table(("input", *TARGET.values()), rows, f"{name}: R² on unseen robots, 95 % intervals in brackets")


def wear_table(name: str, wear: dict[str, Any]) -> Markup:
    """Return what the monitor tells of each joint, and how well."""
    rows = [
        [target, "yes" if told else "no", f"{r2:.2f}", f"± {reach:.3f}", f"{cover:.0%}"]
        for target, told, r2, reach, cover in zip(
            wear["targets"], wear["told"], wear["determination"], wear["reach"], wear["coverage"], strict=True
        )
    ]
    header = ("f/τ_max of", "told", "R²", "95 % interval", "coverage")
    return table(header, rows, f"{name}: windows of {wear['window']:g} s")
