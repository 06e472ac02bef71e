"""The page on adaptation, from the study's summary: latents taken away, their information, and the wear monitor."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from stiction.core.decode import from_plain
from stiction.files.results import ResultRow
from stiction.report.page import (
    COLORS,
    INK,
    Section,
    figure_block,
    fold,
    legend,
    line_look,
    mark_look,
    new_figure,
    paragraph,
    same_scale,
    table,
)
from stiction_experiments.adaptation.probes import HISTORIES, TEST_OF
from stiction_experiments.lab.study import Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Rows = Sequence[dict[str, Any]]
"""Effects, or probes."""

ROWS = {"step": "one step", "walk": "whole walk"}
"""Input of a probe in the figure -> its words."""

LOWEST = -0.2
"""Left end of the axis of R² [-]; values below are drawn there."""


def draw_probes(methods: dict[str, Any], inputs: dict[str, str], targets: dict[str, str]) -> Figure:
    """Return R² of every input, a panel for friction per joint and one for friction per robot.

    methods: training -> `probes`, as in the summary, of a step and of whole walks. inputs: input -> its label, from top
    to bottom; targets: `joint` and `robot` -> title of a panel.
    """
    probes = {method: [p for p in results["probes"] if not p["shuffled"]] for method, results in methods.items()}
    probed = {(probe["input"], probe["row"]) for results in probes.values() for probe in results}
    shown = [(name, row) for name in inputs for row in ROWS if (name, row) in probed]
    figure, axes = new_figure(1, len(targets), size=(4.6 * len(targets) + 1.6, 0.42 * len(shown) + 1.6))
    heights = {key: height for height, key in enumerate(shown)}
    for axis, (per, title) in zip(axes, targets.items(), strict=True):
        for index, (method, results) in enumerate(probes.items()):
            shift = 0.12 * (index - (len(methods) - 1) / 2)
            for probe in (p for p in results if p["per"] == per and (p["input"], p["row"]) in heights):
                height, mark = heights[probe["input"], probe["row"]], mark_look(method, list(methods))
                color = COLORS[index % len(COLORS)]
                at, label = height + shift, None if height else method
                if probe["interval95"] is not None:
                    ends = [max(end, LOWEST) for end in probe["interval95"]]
                    axis.plot(ends, [at, at], color=color, linewidth=3, alpha=0.35)
                seeds = [max(value, LOWEST) for value in probe["each"]]
                axis.plot(seeds, [at] * len(seeds), mark, color=color, markersize=4, label=label)
        axis.axvline(0.0, color=INK, linewidth=0.8)
        axis.set(title=title, xlabel="R² on unseen robots", xlim=(LOWEST, 1.02), ylim=(len(shown) - 0.5, -0.5))
        words = [f"{inputs[name]}, {ROWS[row]}" for name, row in shown]
        axis.set_yticks(range(len(shown)), words if axis is axes[0] else [""] * len(shown))
    legend(axes[0])
    return figure


def draw_effects(methods: dict[str, Any], latents: dict[str, str]) -> Figure:
    """Return by how much another z* changes the speed ratio, over the friction level, a panel for each training.

    methods: training -> `effects`, as in the summary; latents: where z* comes from -> its label.
    """
    figure, axes = new_figure(1, max(1, len(methods)), size=(3.8 * max(1, len(methods)), 3.2))
    for axis, (method, result) in zip(axes, methods.items(), strict=False):
        for latent, words in latents.items():
            look = line_look(latent, list(latents))
            points = [one for one in result["effects"] if (one["latent"], one["figure"]) == (latent, "speed_ratio")]
            points.sort(key=lambda point: point["level"])
            levels = [100 * point["level"] for point in points]
            for seed in range(len(points[0]["each"]) if points else 0):
                axis.plot(levels, [point["each"][seed] for point in points], linewidth=0.7, alpha=0.5, **look)
            axis.plot(
                levels,
                [p["difference"] for p in points],
                marker=mark_look(latent, list(latents)),
                markersize=4,
                label=words,
                **look,
            )
        axis.axhline(0.0, color=INK, linewidth=0.8)
        axis.set(title=method, xlabel="friction, % of torque limit")
    same_scale(axes)
    axes[0].set_ylabel("change of the speed ratio")
    legend(axes[0])
    return figure


LATENT = {"mean": "frozen at its mean", "swapped": "of another friction level", "peer": "of a robot at the same level"}
"""Where the latent comes from, in words."""

INPUT = {
    "latent": "z*",
    "explicit": "explicit estimate o_exp*",
    "frame": "one frame",
    "moments": "moments of a frame",
    **{f"history {length}": f"history, H = {length - 1}" for length in HISTORIES},
    "teacher": "teacher's z, from o_priv",
}
"""Inputs of the probes, in words."""

TARGET = {"joint": "each joint's friction, drawn joint by joint", "robot": "the one friction of a robot's joints"}

ABOUT_LATENTS = (
    "The student walks with the same network, initial state and noise; only what the actor is given as z* changes. The "
    "mean is over all robots and measured steps of the same evaluation with another seed. A swapped z* is that of a "
    "robot with the same command, half of the levels away, at the same step: its friction is wrong, and its gait is at "
    "another phase. The robot at the same level is the control for the second. Differences are to the walk on the "
    "robot's own z*, means over commands."
)

ABOUT_PROBES = (
    f"Ridge regression to f/τ_max, R² on unseen robots, one in {TEST_OF}: 1 is perfect, 0 is no better than the mean "
    "of the training robots. All but the friction is drawn as in training. No torque is in o_H; what makes it is: "
    "target, angle, velocity. A linear probe of o_H cannot multiply them, the moments do."
)

ABOUT_WEAR = (
    "The monitor maps the moments of a window of walking to each joint's f/τ_max, with a 95 % interval from robots it "
    "was not fitted on; R² and coverage are of a third group. It needs the network's input alone. A target is exposed "
    "where the lower end of its R² is above {:g}, and withheld elsewhere. All of this is simulation, with the "
    "randomisation of training: no robot has confirmed it."
)

EACH_LINE = "A thin line is a training seed, a thick one their mean."
EACH_DOT = (
    "A dot is a training seed, a bar the 95 % t-interval of their mean. One step: a single z*, or the frames behind it."
)


def span(interval: Sequence[float] | None, digits: int = 2) -> str:
    """Return an interval in words, a dash where there is none."""
    return "–" if interval is None else f"{interval[0]:.{digits}f} to {interval[1]:.{digits}f}"


def answers(summary: dict[str, Any]) -> list[str]:
    """Return R² of z* and of the moments over whole walks, and what the wear monitors give, a line for each training.

    Intervals are over seeds; those of a single run over robots.
    """
    lines = []
    for method, one in summary["methods"].items():
        runs = [summary["runs"][name] for name in one["runs"]]
        whole = {
            (probe["input"], probe["per"]): f"{probe['mean']:.2f} ({span(probe['interval95'])})"
            for probe in (one["probes"] if len(runs) > 1 else runs[0]["probes"])
            if probe["row"] == "walk" and not probe["shuffled"]
        }
        scores = [
            f"{INPUT[name]} {whole[name, per]} per {per}" for name in (known_by(whole), "moments") for per in TARGET
        ]
        monitored = ", ".join(f"{sum(estimated(run['wear']))} of {len(estimated(run['wear']))}" for run in runs)
        name = one["runs"][0] if len(runs) == 1 else f"{method}, {len(runs)} seeds"
        lines.append(f"{name}: R² of the friction from {'; '.join(scores)}; monitored targets: {monitored}.")
    return lines


def known_by(probed: Collection[tuple[str, str]]) -> str:
    """Return by what a policy knows its friction, z* or else its estimates; probed: inputs, each with its target."""
    return "latent" if ("latent", "robot") in probed else "explicit"


def effect_text(summary: dict[str, Any]) -> str:
    """Return how much of its command a policy's speed changes by another latent, as a sentence to be read aloud.

    Empty where no policy has a latent.
    """
    parts = []
    for latent in GIVEN:
        sizes = {
            method: max((abs(e["difference"]) for e in one["effects"] if _is_speed(e, latent)), default=None)
            for method, one in summary["methods"].items()
        }
        changes = [f"{100 * size:.0f} % ({method})" for method, size in sizes.items() if size is not None]
        if changes:
            parts.append(f"by up to {', '.join(changes)} when {GIVEN[latent]}")
    return f"A policy's speed changes, of the command, {'; '.join(parts)}." if parts else ""


def _is_speed(effect: dict[str, Any], latent: str) -> bool:
    return bool(effect["latent"] == latent and effect["figure"] == "speed_ratio")


GIVEN = {
    "mean": "its latent (what the last frames told) is frozen at its mean",
    "swapped": "it is given the latent of a robot with other friction",
    "peer": "it is given that of a robot with the same friction",
}
"""Latents in place of a robot's own, as the answer says them."""


def lead(summary: dict[str, Any]) -> list[str]:
    """Return what another latent does, then how much of the friction can be read, as a sentence for each training."""
    lines = list(filter(None, [effect_text(summary)]))
    for method, one in summary["methods"].items():
        runs = [summary["runs"][name] for name in one["runs"]]
        probes = one["probes"] if len(runs) > 1 else runs[0]["probes"]
        means = {(p["input"], p["per"]): p["mean"] for p in probes if p["row"] == "walk" and not p["shuffled"]}
        seeds = f"{len(runs)} training seeds" if len(runs) > 1 else "one training seed"
        known = known_by(means)
        words = {"latent": "the latent z*", "explicit": "the estimates"}[known]
        robot, joint = means[known, "robot"], means[known, "joint"]
        lines.append(
            f"From {words} of {method} ({seeds}), over a walk, the mean friction of a robot can be read with R² "
            f"{robot:.2f}, that of each joint with R² {joint:.2f}; from the moments of the frames behind them, "
            f"with {means['moments', 'robot']:.2f} and {means['moments', 'joint']:.2f}."
        )
    return lines


def report(result: dict[str, Any]) -> Report:
    """Return the report of the study, from what summary.json has of it."""
    swapped = {method: one for method, one in result["methods"].items() if one["effects"]}
    effects = draw_effects(swapped, LATENT) if swapped else None
    probes = draw_probes(result["methods"], INPUT, TARGET)
    lines = answers(result)
    return Report(
        title="What does adaptation do?",
        lead="\n".join(lead(result)),
        tables={
            "results": [
                from_plain(ResultRow, row, name)
                for name, run in result["runs"].items()
                for row in run["latents"]["rows"]
            ]
        },
        sections=sections(result, effects, probes),
        summary=result,
        figures=({} if effects is None else {"latents": effects}) | {"probes": probes},
        answer=lines,
    )


def sections(summary: dict[str, Any], effects: Figure | None, probes: Figure) -> list[Section]:
    """Return the page's parts, with the figures of `draw_effects`, None without a latent, and `draw_probes`."""
    wear = [wear_table(name, run["wear"]) for name, run in summary["runs"].items()]
    if len(wear) > 2:
        wear = [wear[0], fold("every run", wear[1:])]
    methods, runs = summary["methods"], summary["runs"].items()
    latents: list[Section] = []
    if effects is not None:
        each = {name: run["latents"]["effects"] for name, run in runs}
        tables = over_runs({m: one for m, one in methods.items() if one["effects"]}, each, "effects", effects_table)
        parts = (paragraph(ABOUT_LATENTS), figure_block(effects, EACH_LINE), *tables)
        latents = [Section("Latents taken away and swapped", parts)]
    readable = over_runs(methods, {name: run["probes"] for name, run in runs}, "probes", probes_table)
    return [
        *latents,
        Section(
            "How much friction can be read from what the policy knows",
            (paragraph(ABOUT_PROBES), figure_block(probes, EACH_DOT), *readable),
        ),
        Section("Can it watch for wear?", (paragraph(ABOUT_WEAR.format(summary["threshold"])), *wear)),
    ]


def over_runs(
    methods: dict[str, Any], runs: dict[str, Rows], key: str, tabulate: Callable[[str, Rows], Markup]
) -> list[Markup]:
    """Return a training's table over its seeds where it has several, and those of its runs folded.

    methods: training -> its `runs`, and under `key` what they have together; runs: run -> the same of its own.
    """
    blocks: list[Markup] = []
    for method, one in methods.items():
        own = [tabulate(name, runs[name]) for name in one["runs"]]
        if len(own) > 1:
            pooled = tabulate(f"{method}, over {len(own)} seeds", one[key])
            blocks += [pooled, fold(f"{method}: every run", own)]
        else:
            blocks += own
    return blocks


def effects_table(name: str, effects: Rows) -> Markup:
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
    header = (
        "z*, friction",
        "speed ratio, own z* [1]",
        "with this z* [1]",
        "difference [1]",
        "difference of the error [m/s]",
    )
    return table(header, rows, f"{name}: 95 % intervals in brackets")


def probes_table(name: str, probes: Rows) -> Markup:
    """Return R² of every input, friction per joint and per robot side by side."""
    cells: dict[str, list[str]] = {}
    for probe in probes:
        label = f"{INPUT[probe['input']]}, {probe['row']}" + (", friction shuffled" if probe["shuffled"] else "")
        cells.setdefault(label, []).append(f"{probe['mean']:.2f} ({span(probe['interval95'])})")
    rows = [[label, *values] for label, values in cells.items()]
    return table(
        ("input", *(f"{words} [1]" for words in TARGET.values())),
        rows,
        f"{name}: R² on unseen robots, 95 % intervals in brackets",
    )


def estimated(wear: dict[str, Any]) -> list[bool]:
    """Return which targets a monitor estimates; summaries before its version 3 call that `told`."""
    return wear["estimated"] if "estimated" in wear else wear["told"]


def wear_table(name: str, wear: dict[str, Any]) -> Markup:
    """Return which joints' friction the monitor estimates, and how well."""
    rows = [
        [target, "yes" if estimate else "no", f"{r2:.2f}", f"± {reach:.3f}", f"{cover:.0%}"]
        for target, estimate, r2, reach, cover in zip(
            wear["targets"], estimated(wear), wear["determination"], wear["reach"], wear["coverage"], strict=True
        )
    ]
    header = ("f/τ_max of", "estimated", "R² [1]", "95 % interval [of τ_max]", "coverage [% of windows]")
    return table(header, rows, f"{name}: windows of {wear['window']:g} s")
