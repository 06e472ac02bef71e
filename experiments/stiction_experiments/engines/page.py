"""The page of the study of engines: what each did in the conformance suite, and how the same policies walk in each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

import numpy as np
import rich.table
from markupsafe import Markup

from stiction.engines.catalog import TIMESTEP
from stiction.report.page import (
    COLORS,
    INK,
    Section,
    figure_block,
    file_uri,
    fold,
    labelled,
    legend,
    new_figure,
    paragraph,
    picture,
    row_table,
    table,
)
from stiction_experiments.engines.conformance import flight
from stiction_experiments.engines.run import ROUNDS, FigureRow, PaceRow, Traces
from stiction_experiments.engines.walks import COARSE, CONTACT_TIME, FINE, MUJOCO, STIFF, EpisodeRow, WalkRow
from stiction_experiments.lab.study import Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure


CLOSE = 0.1
"""A speed is reached, and two simulators agree, within this share [-]."""

TextTable = tuple[list[str], list[list[str]]]
"""Header and lines."""


def judge(low: float | None, high: float | None) -> str:
    """Return whether an interval of a ratio is within 1 ± `CLOSE`: `within`, `outside`, or `not decided`."""
    if low is None or high is None:
        return "not decided"
    if low >= 1 - CLOSE and high <= 1 + CLOSE:
        return "within"
    return "outside" if high < 1 - CLOSE or low > 1 + CLOSE else "not decided"


def conformance_lines(rows: Sequence[FigureRow]) -> list[str]:
    """Return how many figures each engine passes at each timestep, and which it fails."""
    lines = []
    for engine, timestep in dict.fromkeys((row.engine, row.timestep) for row in rows):
        own = [row for row in rows if (row.engine, row.timestep) == (engine, timestep)]
        failed = [f"{row.check}: {row.figure}" for row in own if not row.passed]
        count = f"{len(own) - len(failed)} of {len(own)} figures at steps of {1000 * timestep:g} ms"
        lines.append(f"{engine} passes {count}" + (f", not {'; '.join(failed)}." if failed else "."))
    return lines


def distance(rows: Sequence[WalkRow], one: str, other: str) -> float | None:
    """Return the mean difference of two simulators' speed ratios over all walks that both have [-]; None: no walk."""
    first, second = (
        {(row.policy, row.friction_level, row.command): row.speed_ratio for row in rows if row.simulator == name}
        for name in (one, other)
    )
    both = [abs(first[cell] - second[cell]) for cell in first if cell in second]
    return fmean(both) if both else None


REFERENCES = (MUJOCO, COARSE, STIFF)
"""Simulators that the others are compared with: the last two show the effect of step and contacts."""


def simulator_table(rows: Sequence[WalkRow]) -> TextTable:
    """Return a line a simulator: walks without friction at the commanded speed, agreement with others, falls."""
    levels = list(dict.fromkeys(row.friction_level for row in rows))
    header = ["simulator", f"within ±{CLOSE:.0%} of the command, no friction [walks]"]
    header += [f"speed over training's, {level:.0%} friction [1]" for level in levels]
    header += [*(f"differs from {name} by [1]" for name in REFERENCES), "falls [episodes]"]
    lines = []
    for name in dict.fromkeys(row.simulator for row in rows):
        own = [row for row in rows if row.simulator == name]
        free = [judge(row.speed_low, row.speed_high) for row in own if row.friction_level == 0]
        line = [name, f"{free.count('within')} of {len(free)} ({free.count('not decided')} not decided)"]
        for level in levels:
            ratios = [row.to_training for row in own if row.friction_level == level and row.to_training is not None]
            line.append(f"{min(ratios):.2f} to {max(ratios):.2f}" if ratios else "–")
        apart = [None if name == other else distance(rows, name, other) for other in REFERENCES]
        line += ["–" if value is None else f"{value:.3f}" for value in apart]
        lines.append([*line, f"{sum(row.falls for row in own)} of {sum(row.episodes for row in own)}"])
    return header, lines


FLOOR = 1e-9
"""Smallest error that is drawn [rad]: a logarithm has no zero."""

STYLES = ("-", "--", "-.", ":")
"""Line styles of the engines, whose lines often lie on each other."""

SIMULATOR_COLORS = (INK, *COLORS, "#c9556a")
"""Colours of the simulators: those of the page and two more."""


def draw_motions(motions: Traces) -> Figure:
    """Return a joint's torque, its speed in all engines and in closed form, the error of its angle, and the flight."""
    figure, (load, speed, error, flown) = new_figure(2, 2, size=(9.5, 5.6))
    load.plot(motions.time, motions.load, color=INK)
    load.axhline(1.0, color=INK, linewidth=0.8, linestyle="--")
    load.set(xlabel="time [s]", ylabel="torque over dry friction", title="one joint: held, driven, let go")
    speed.plot(motions.time, motions.exact_speed, color=INK, linewidth=3.0, alpha=0.5, label="exact")
    for number, name in enumerate(motions.speed):
        style = {"color": COLORS[number % len(COLORS)], "linestyle": STYLES[number % len(STYLES)], "linewidth": 1.3}
        speed.plot(motions.time, motions.speed[name], label=name, **style)
        error.semilogy(motions.time, np.maximum(motions.error[name], FLOOR), label=name, **style)
        flown.semilogy(motions.flight_time, np.maximum(motions.flight[name], FLOOR), label=name, **style)
    speed.set(xlabel="time [s]", ylabel="speed [rad/s]", title="its speed, all engines and exact")
    error.set(xlabel="time [s]", ylabel="error of the angle [rad]", title="its angle, against the exact one")
    flown.set(xlabel="time [s]", ylabel="largest error of a joint [rad]", title="free flight, against fine MuJoCo")
    flown.set_ylim(bottom=1e-6)
    for axis in (speed, flown):
        legend(axis)
    return figure


def draw_walks(rows: Sequence[WalkRow], episodes: Sequence[EpisodeRow]) -> Figure:
    """Return speed over commanded speed, a panel a friction level: policies and commands down, simulators by colour."""
    levels = list(dict.fromkeys(row.friction_level for row in rows))
    cells = list(dict.fromkeys((row.policy, row.command) for row in rows))
    names = list(dict.fromkeys(row.simulator for row in rows))
    figure, axes = new_figure(1, len(levels), size=(5.2 * len(levels), 1.6 + 0.8 * len(cells)))
    for axis, level in zip(axes, levels, strict=True):
        axis.axvspan(1 - CLOSE, 1 + CLOSE, color=INK, alpha=0.15, linewidth=0)
        for number, name in enumerate(names):
            offset = 0.7 * (number - (len(names) - 1) / 2) / len(names)
            color = SIMULATOR_COLORS[number % len(SIMULATOR_COLORS)]
            mine = [one for one in episodes if (one.simulator, one.friction_level) == (name, level)]
            heights = [cells.index((one.policy, one.command)) + offset for one in mine]
            axis.plot([one.speed_ratio for one in mine], heights, ".", color=color, markersize=3, alpha=0.5)
            means = [row for row in rows if (row.simulator, row.friction_level) == (name, level)]
            heights = [cells.index((row.policy, row.command)) + offset for row in means]
            axis.plot([row.speed_ratio for row in means], heights, "|", color=color, markersize=9, label=name)
        axis.set(xlabel="speed over commanded speed", title=f"{level:.0%} friction", ylim=(len(cells) - 0.5, -0.5))
        axis.set_yticks(range(len(cells)), [f"{policy}\n{command}" for policy, command in cells])
    legend(figure, labelled(axes[0]), loc="outside lower center", ncols=4)
    return figure


def figure_table(rows: Sequence[FigureRow], timestep: float) -> TextTable:
    """Return header and lines of the figures at one timestep: a figure a line, an engine a column."""
    mine = [row for row in rows if row.timestep == timestep]
    engines = list(dict.fromkeys(row.engine for row in mine))
    lines: dict[tuple[str, str], dict[str, FigureRow]] = {}
    for row in mine:
        lines.setdefault((row.check, row.figure), {})[row.engine] = row
    cells = []
    for (check, figure), tests in lines.items():
        one = next(iter(tests.values()))
        values = [
            f"{value(tests[name])}{'' if tests[name].passed else ' FAIL'}" if name in tests else "–" for name in engines
        ]
        complete = len(tests) == len(engines) and all(row.passed for row in tests.values())
        verdict = "pass" if complete else "FAIL"
        cells.append([check, figure, f"{one.bound:.3g}{unit(one)}", *values, verdict])
    return ["check", "figure", "bound", *engines, "verdict"], cells


def unit(row: FigureRow) -> str:
    """Return the unit after a space, nothing for a ratio or a count."""
    return "" if row.unit == "1" else f" {row.unit}"


def value(row: FigureRow) -> str:
    """Return what came out, as text."""
    return "not a number" if row.value is None else f"{row.value:.2g}"


def walk_table(rows: Sequence[WalkRow], cell: Callable[[WalkRow], str], caption: str) -> Markup:
    """Return a table with a cell for each row: policy, friction and command down, simulators across."""
    names = list(dict.fromkeys(row.simulator for row in rows))
    lines: dict[tuple[str, float, str], dict[str, str]] = {}
    for row in rows:
        lines.setdefault((row.policy, row.friction_level, row.command), {})[row.simulator] = cell(row)
    body = [
        [policy, f"{level:.0%}", command, *(by_name.get(name, "–") for name in names)]
        for (policy, level, command), by_name in lines.items()
    ]
    return table(
        ["policy", "friction [of τ_max]", "command", *(f"{name} [1]" for name in names)], body, caption, grouped=True
    )


def _speeds(row: WalkRow) -> str:
    text = f"{row.speed_ratio:.2f}{_interval(row.speed_low, row.speed_high)}"
    if row.to_training is None:
        return text
    return f"{text}; {row.to_training:.2f}{_interval(row.to_training_low, row.to_training_high)}"


def _interval(low: float | None, high: float | None) -> str:
    """Return an interval in brackets, nothing where there is none."""
    return "" if low is None or high is None else f" ({low:.2f} to {high:.2f})"


def _verdicts(row: WalkRow) -> str:
    """Return both verdicts, and falls."""
    against = "" if row.to_training is None else f" / {judge(row.to_training_low, row.to_training_high)}"
    falls = f"{row.falls} of {row.episodes} fell, {row.fall_low:.0%} to {row.fall_high:.0%}"
    return f"{judge(row.speed_low, row.speed_high)}{against}; {falls}"


HOW_FIGURES = (
    "Every engine has the same robot, and is given torques and bounds of dry friction from outside, step by step. A "
    "figure passes where its magnitude is within the bound, which is the same for every engine and set for steps of "
    f"{1000 * TIMESTEP:g} ms. In `joint order`, `free flight` and `standing` the reference is MuJoCo, in the last two "
    "with finer steps: there MuJoCo's own figures show its step alone."
)

HOW_WALKS = (
    "The robot of the data sheet on flat ground: no sensor noise, no delay, Coulomb friction of the same share of the "
    "torque limit in every joint. Simulators: `training`, the batched MuJoCo that the policies were trained in, at its "
    f"own step and at {1000 * FINE:g} ms; the engines with one robot, its controllers outside of them, at "
    f"{1000 * TIMESTEP:g} ms; MuJoCo again at the training's step, and with contacts that give way in "
    f"{1000 * CONTACT_TIME:g} ms. An interval is over episodes, which differ by their first joint angles, and not over "
    "trainings. Differences are means over all walks of the speed over the commanded one."
)

SPEEDS = (
    "Mean speed over the commanded speed with its 95 % t-interval over episodes, then that speed over the one in "
    "`training` with its 95 % interval."
)

VERDICTS = (
    f"Whether the whole interval is within ±{CLOSE:.0%} of the commanded speed / of the speed in training's simulator, "
    "and robots that fell with Wilson's 95 % interval."
)


@dataclass(frozen=True)
class EnginesResult:
    """All that a study of engines found."""

    conformance: Sequence[FigureRow]
    pace: Sequence[PaceRow]
    walks: Sequence[WalkRow]
    """How policies walked; none where they were left out."""
    episodes: Sequence[EpisodeRow]
    motions: Traces | Path
    """To be drawn; or the file of what was drawn before."""
    missing: dict[str, str]
    """Engines that cannot be had here -> why, and how to get them."""


def report(result: EnginesResult, settings: dict[str, Any]) -> Report:
    """Return the report of the study. settings: `robot`, `engines`, `evaluation`, `policies` and `seconds`."""
    failed = [row for row in result.conformance if not row.passed]
    missing = [f"{name} was not tested: {line}." for name, line in result.missing.items()]
    answers = [*conformance_lines(result.conformance), *missing]
    rows: dict[str, Sequence[Any]] = {"conformance": result.conformance, "pace": result.pace, "walks": result.walks}
    figures = {"walks": draw_walks(result.walks, result.episodes) if result.walks else None}
    if isinstance(result.motions, Path):
        motions = picture(file_uri(result.motions), motions_text(result), white=True)
    else:
        figures["motions"] = drawn = draw_motions(result.motions)
        motions = figure_block(drawn, motions_text(result))
    answered = {"failures": len(failed), "answers": answers, "missing": result.missing}
    return Report(
        title="What does each physics engine do with a joint, a foot, a walk?",
        lead="\n".join(lead(result)),
        tables=rows | {"episodes": result.episodes},
        sections=sections(result, motions, figures["walks"], settings["robot"]),
        run=run_blocks(settings),
        summary=settings | answered | {name: [asdict(row) for row in some] for name, some in rows.items()},
        notes=[*map(failure, failed), *missing],
        figures=figures,
        answer=(*printed_tables(result), *answers),
        status=1 if failed else 0,
    )


def lead(result: EnginesResult) -> list[str]:
    """Return which engines pass every figure at each timestep, and how far walks differ between simulators."""
    rows, lines = result.conformance, []
    for step in dict.fromkeys(row.timestep for row in rows):
        counts: dict[str, list[bool]] = {}
        for row in rows:
            if row.timestep == step:
                counts.setdefault(row.engine, []).append(row.passed)
        missed = {engine: passed.count(False) for engine, passed in counts.items() if not all(passed)}
        right = [engine for engine in counts if engine not in missed] if missed else ["every engine"]
        parts = [f"{', '.join(right)} {'does' if len(right) == 1 else 'do'} all that is asked"] if right else []
        parts += [f"{engine} misses {number} of {len(counts[engine])} figures" for engine, number in missed.items()]
        lines.append(f"At steps of {1000 * step:g} ms {'; '.join(parts)}.")
    apart = {
        name: distance(result.walks, name, MUJOCO) for name in dict.fromkeys(row.simulator for row in result.walks)
    }
    gaps = ", ".join(f"{100 * by:.0f} % in {name}" for name, by in apart.items() if name != MUJOCO and by is not None)
    return [*lines, *([f"The same walks differ from {MUJOCO}'s, of the commanded speed, by {gaps}."] if gaps else [])]


def failure(row: FigureRow) -> str:
    """Return a figure that is out of bounds in words."""
    return (
        f"{row.engine} at {1000 * row.timestep:g} ms fails {row.check}: {row.figure} is {value(row)}{unit(row)}, "
        f"within {row.bound:g} expected"
    )


def printed_tables(result: EnginesResult) -> list[rich.table.Table]:
    """Return the figures, a table a timestep, and the simulators for the terminal."""
    timesteps = dict.fromkeys(row.timestep for row in result.conformance)
    texts = {f"steps of {1000 * step:g} ms": figure_table(result.conformance, step) for step in timesteps}
    if result.walks:
        texts["the same policies in every simulator"] = simulator_table(result.walks)
    tables = []
    for title, (header, lines) in texts.items():
        tables.append(rich.table.Table(title=title))
        for number, name in enumerate(header):
            tables[-1].add_column(name, justify="left" if number < 2 else "right", overflow="fold")
        for line in lines:
            tables[-1].add_row(*line)
    return tables


def motions_text(result: EnginesResult) -> str:
    """Return what the figure of one joint shows."""
    return (
        f"Steps of {1000 * result.conformance[0].timestep:g} ms. A shank with dry friction under a torque that holds "
        "it, breaks it away and lets it go, against its exact motion; and a flight under torques at all joints, "
        f"against MuJoCo at steps of {1000 * flight.FINE:g} ms."
    )


def sections(result: EnginesResult, motions: Markup, walks: Figure | None, robot: str) -> list[Section]:
    """Return the sections of the page. motions: the figure of one joint; walks: None where nobody walked."""
    tables = [
        fold(
            f"Every figure at steps of {1000 * step:g} ms",
            [table(*figure_table(result.conformance, step), grouped=True)],
        )
        for step in dict.fromkeys(row.timestep for row in result.conformance)
    ]
    parts = [
        Section("One joint and a free flight", (motions,)),
        Section("Conformance", (paragraph(f"The robot is {robot}. {HOW_FIGURES}"), *tables)),
        Section("Pace", (paragraph(PACE), row_table(result.pace))),
    ]
    if walks is not None:
        caption = f"Bars: means; points: episodes; grey: the commanded speed ±{CLOSE:.0%}."
        blocks = (figure_block(walks, caption), table(*simulator_table(result.walks)), paragraph(HOW_WALKS))
        every = [walk_table(result.walks, _speeds, SPEEDS), walk_table(result.walks, _verdicts, VERDICTS)]
        cells = (fold("Every policy, friction and command, simulators side by side", every),)
        parts.append(Section("The same policies in every simulator", (*blocks, *cells)))
    return parts


PACE = (
    "Physics steps per second of processor time, of a robot that stands under its controllers with dry friction and "
    "whose motion is read at every step; all engines in turn in the same run, the median of "
    f"{ROUNDS} rounds. The share is over the first engine's."
)


def run_blocks(settings: dict[str, Any]) -> tuple[Markup, ...]:
    """Return what walked, and how; nothing where nobody did."""
    blocks: tuple[Markup, ...] = ()
    if settings["policies"]:
        cfg = settings["evaluation"]
        policies = [(name, p["method"], str(p["seed"]), p["revision"]) for name, p in settings["policies"].items()]
        blocks = (
            paragraph(
                f"{cfg['episodes']} episodes of {cfg['seconds']:g} s a walk, the first {cfg['settle']:g} s left out, "
                f"seed {cfg['seed']}."
            ),
            table(["policy", "method", "seed", "revision"], policies),
        )
    return (*blocks, paragraph("Everything here is simulation."))
