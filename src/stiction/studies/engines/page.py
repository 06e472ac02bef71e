"""The page of the study of engines: what each did in the conformance suite, and how the same policies walk in each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from statistics import fmean
from typing import TYPE_CHECKING, Any

import numpy as np
import rich.table
from markupsafe import Markup

from stiction.report.page import (
    COLORS,
    INK,
    Section,
    bullets,
    figure_uri,
    legend,
    new_figure,
    paragraph,
    picture,
    row_table,
    table,
)
from stiction.studies.engines.walks import (
    COARSE,
    FINE_TRAINING,
    MUJOCO,
    STIFF,
    TRAINING,
    EpisodeRow,
    FigureRow,
    PaceRow,
    Traces,
    WalkRow,
)
from stiction.studies.study import Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure


CLOSE = 0.1
"""A speed is reached, and two simulators agree, within this share [-]."""

MOST = 0.5
"""Contacts explain a difference where stiffer ones leave at most this share of it."""

Cell = tuple[str, float, str]
"""Policy, friction level, command."""


def judge(low: float | None, high: float | None) -> str:
    """Return whether an interval of a ratio is within 1 ± `CLOSE`: `within`, `outside`, or `not decided`."""
    if low is None or high is None:
        return "not decided"
    if low >= 1 - CLOSE and high <= 1 + CLOSE:
        return "within"
    return "outside" if high < 1 - CLOSE or low > 1 + CLOSE else "not decided"


def conformance_words(rows: Sequence[FigureRow]) -> list[str]:
    """Return a sentence for each timestep: which engines pass all figures, and what the others fail."""
    sentences = []
    for timestep in dict.fromkeys(row.timestep for row in rows):
        mine = [row for row in rows if row.timestep == timestep]
        engines = list(dict.fromkeys(row.engine for row in mine))
        failed = {name: [row for row in mine if row.engine == name and not row.passed] for name in engines}
        passing = [name for name in engines if not failed[name]]
        figures = len({(row.check, row.figure) for row in mine})
        words = [f"{', '.join(passing)} pass{'es' if len(passing) == 1 else ''} all figures"] if passing else []
        words += [
            f"{name} fails {len(lost)} of {sum(row.engine == name for row in mine)} ("
            + "; ".join(f"{row.check}: {row.figure}" for row in lost)
            + ")"
            for name, lost in failed.items()
            if lost
        ]
        sentences.append(f"At steps of {1000 * timestep:g} ms, of {figures} figures: {'; '.join(words)}.")
    return sentences


def walk_words(rows: Sequence[WalkRow]) -> list[str]:
    """Return what the walks say: speeds without friction, what contacts make of it, agreement with the training."""
    if not rows:
        return []
    return [*_reached(rows), *_contacts(rows), *_step(rows), *_agreement(rows), *_falls(rows)]


def _cell(row: WalkRow) -> Cell:
    """Return what a row has in common with those of other simulators."""
    return row.policy, row.friction_level, row.command


def _names(rows: Iterable[WalkRow]) -> list[str]:
    """Return the simulators, in the order of the rows."""
    return list(dict.fromkeys(row.simulator for row in rows))


def _reached(rows: Sequence[WalkRow]) -> list[str]:
    """Return in how many walks without friction each simulator reaches the commanded speed."""
    free = [row for row in rows if row.friction_level == 0]
    if not free:
        return []
    counts = []
    for name in _names(free):
        mine = [row for row in free if row.simulator == name]
        judged = [judge(row.speed_low, row.speed_high) for row in mine]
        open_ones = f" ({judged.count('not decided')} not decided)" if "not decided" in judged else ""
        counts.append(f"{name} {judged.count('within')} of {len(mine)}{open_ones}")
    here = [row for row in free if row.simulator not in (TRAINING, FINE_TRAINING)]
    missed = [row for row in here if judge(row.speed_low, row.speed_high) == "outside"]
    near = [row for row in missed if judge(row.to_training_low, row.to_training_high) == "within"]
    own = [row.speed_ratio for row in free if row.simulator == TRAINING]
    sentences = [
        f"Without friction the commanded speed is reached within ±{CLOSE:.0%} in: {', '.join(counts)} pairs of policy "
        f"and command. In training's own simulator the policies reach {min(own):.2f} to {max(own):.2f} of it."
    ]
    if missed:
        sentences.append(
            f"Of the {len(missed)} walks in the engines that miss it, {len(near)} {'is' if len(near) == 1 else 'are'} "
            f"within ±{CLOSE:.0%} of what the same policy reaches in training's simulator."
        )
    return sentences


def _agreement(rows: Sequence[WalkRow]) -> list[str]:
    """Return how far each engine is from the training's simulator, level by level."""
    sentences = []
    for level in dict.fromkeys(row.friction_level for row in rows):
        parts = []
        for name in _names(rows):
            ratios = [
                row.to_training
                for row in rows
                if (row.simulator, row.friction_level) == (name, level) and row.to_training is not None
            ]
            if ratios:
                parts.append(f"{name} {min(ratios):.2f} to {max(ratios):.2f}")
        if parts:
            sentences.append(f"Speed over that in training's simulator at {level:.0%} friction: {', '.join(parts)}.")
    return sentences


def distance(rows: Sequence[WalkRow], one: str, other: str) -> float | None:
    """Return the mean difference of two simulators' speed ratios over all walks that both have [-]; None: no walk."""
    first, second = ({_cell(row): row.speed_ratio for row in rows if row.simulator == name} for name in (one, other))
    both = [abs(first[cell] - second[cell]) for cell in first if cell in second]
    return fmean(both) if both else None


def _contacts(rows: Sequence[WalkRow]) -> list[str]:
    """Return how far the other engines are from MuJoCo with training's contacts, and with stiffer ones."""
    sentences = []
    for name in _names(rows):
        soft, stiff = distance(rows, name, MUJOCO), distance(rows, name, STIFF)
        if name in (TRAINING, FINE_TRAINING, MUJOCO, COARSE, STIFF) or soft is None or stiff is None:
            continue
        if soft == 0:
            sentences.append(f"{name} does not differ from {MUJOCO}.")
            continue
        verdict = (
            f"stiffer contacts take away {1 - stiff / soft:.0%} of the difference"
            if stiff <= MOST * soft
            else f"stiffer contacts do not explain most of the difference: {stiff / soft:.0%} of it is left"
        )
        sentences.append(
            f"{name} differs from {MUJOCO} by {soft:.3f} of the commanded speed in the mean over all walks, from "
            f"{STIFF} by {stiff:.3f}: {verdict}."
        )
    return sentences


def _step(rows: Sequence[WalkRow]) -> list[str]:
    """Return how far the training's simulator is from the same engine with one robot, at its own and a finer step."""
    own, fine, finer = (
        distance(rows, *pair) for pair in ((TRAINING, COARSE), (TRAINING, MUJOCO), (FINE_TRAINING, MUJOCO))
    )
    if own is None or fine is None or finer is None:
        return []
    return [
        "Training's simulator differs from the same engine with one robot, whose controllers are outside of it, by "
        f"{own:.3f} at the same step, and from that at 2 ms by {fine:.3f}; at steps of 1 ms of its own, by {finer:.3f}."
    ]


def _falls(rows: Sequence[WalkRow]) -> list[str]:
    """Return how many robots fell."""
    fell, all_of_them = sum(row.falls for row in rows), sum(row.episodes for row in rows)
    return [f"{fell} of {all_of_them} robots fell."]


FLOOR = 1e-9
"""Smallest error that is drawn [rad]: a logarithm has no zero."""

STYLES = ("-", "--", "-.", ":")
"""Of the engines' lines, which often lie on each other."""


def draw_motions(motions: Traces) -> Figure:
    """Return a joint's torque, its speed in all engines and in closed form, the error of its angle, and the flight."""
    figure, (load, speed, error, flight) = new_figure(2, 2, size=(9.5, 5.6))
    load.plot(motions.time, motions.load, color=INK)
    load.axhline(1.0, color=INK, linewidth=0.8, linestyle="--")
    load.set(xlabel="time [s]", ylabel="torque over dry friction", title="one joint: held, driven, let go")
    speed.plot(motions.time, motions.exact_speed, color=INK, linewidth=3.0, alpha=0.5, label="exact")
    for number, name in enumerate(motions.speed):
        style = {"color": COLORS[number % len(COLORS)], "linestyle": STYLES[number % len(STYLES)], "linewidth": 1.3}
        speed.plot(motions.time, motions.speed[name], label=name, **style)
        error.semilogy(motions.time, np.maximum(motions.error[name], FLOOR), label=name, **style)
        flight.semilogy(motions.flight_time, np.maximum(motions.flight[name], FLOOR), label=name, **style)
    speed.set(xlabel="time [s]", ylabel="speed [rad/s]", title="its speed, all engines and exact")
    error.set(xlabel="time [s]", ylabel="error of the angle [rad]", title="its angle, against the exact one")
    flight.set(xlabel="time [s]", ylabel="largest error of a joint [rad]", title="free flight, against fine MuJoCo")
    flight.set_ylim(bottom=1e-6)
    for axis in (speed, flight):
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
            offset, color = 0.7 * (number - (len(names) - 1) / 2) / len(names), _color(number)
            mine = [one for one in episodes if (one.simulator, one.friction_level) == (name, level)]
            heights = [cells.index((one.policy, one.command)) + offset for one in mine]
            axis.plot([one.speed_ratio for one in mine], heights, ".", color=color, markersize=3, alpha=0.5)
            means = [row for row in rows if (row.simulator, row.friction_level) == (name, level)]
            heights = [cells.index((row.policy, row.command)) + offset for row in means]
            axis.plot([row.speed_ratio for row in means], heights, "|", color=color, markersize=9, label=name)
        axis.set(xlabel="speed over commanded speed", title=f"{level:.0%} friction", ylim=(len(cells) - 0.5, -0.5))
        axis.set_yticks(range(len(cells)), [f"{policy}\n{command}" for policy, command in cells])
        axis.tick_params(axis="y", labelsize=6)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8, labelcolor=INK, frameon=False)
    return figure


def _color(number: int) -> str:
    """Return the colour of a simulator, one of the page's or of two more."""
    return (INK, *COLORS, "#c9556a")[number % (len(COLORS) + 2)]


def figure_table(rows: Sequence[FigureRow], timestep: float) -> tuple[list[str], list[list[str]]]:
    """Return header and lines of the figures at one timestep: a figure a line, an engine a column."""
    mine = [row for row in rows if row.timestep == timestep]
    engines = list(dict.fromkeys(row.engine for row in mine))
    lines: dict[tuple[str, str], dict[str, FigureRow]] = {}
    for row in mine:
        lines.setdefault((row.check, row.figure), {})[row.engine] = row
    cells = []
    for (check, figure), found in lines.items():
        one = next(iter(found.values()))
        values = [_table_cell(found[name]) if name in found else "–" for name in engines]
        complete = len(found) == len(engines) and all(row.passed for row in found.values())
        verdict = "pass" if complete else "FAIL"
        cells.append([check, figure, f"{one.bound:.3g}{unit(one)}", *values, verdict])
    return ["check", "figure", "bound", *engines, "verdict"], cells


def _table_cell(row: FigureRow) -> str:
    """Return a figure as a cell that cannot be read as a pass where it is none."""
    return value(row) if row.passed else f"{value(row)} FAIL"


def unit(row: FigureRow) -> str:
    """Return the unit after a space, nothing for a ratio or a count."""
    return "" if row.unit == "1" else f" {row.unit}"


def value(row: FigureRow) -> str:
    """Return what came out, as text."""
    return "not a number" if row.value is None else f"{row.value:.2g}"


def walk_table(rows: Sequence[WalkRow]) -> Markup:
    """Return the speeds: policy, friction and command down, simulators across."""
    return _walk_cells(rows, _speeds, "Speed over the commanded speed, and over that in training's simulator.")


def verdict_table(rows: Sequence[WalkRow]) -> Markup:
    """Return whether speeds are within ±10 %, and falls; the same lines and columns."""
    caption = (
        f"Whether the whole interval is within ±{CLOSE:.0%} of the commanded speed / of the speed in training's "
        "simulator, and robots that fell with Wilson's 95 % interval."
    )
    return _walk_cells(rows, _verdicts, caption)


def _walk_cells(rows: Sequence[WalkRow], cell: Callable[[WalkRow], str], caption: str) -> Markup:
    """Return a table with a cell for each row."""
    names = list(dict.fromkeys(row.simulator for row in rows))
    lines: dict[tuple[str, float, str], dict[str, str]] = {}
    for row in rows:
        lines.setdefault((row.policy, row.friction_level, row.command), {})[row.simulator] = cell(row)
    body = [
        [policy, f"{level:.0%}", command, *(found.get(name, "–") for name in names)]
        for (policy, level, command), found in lines.items()
    ]
    return table(["policy", "friction", "command", *names], body, caption)


def _speeds(row: WalkRow) -> str:
    """Return speed and ratio with their intervals."""
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
    "Every engine has the same robot and is told torques and bounds of dry friction from outside, step "
    "by step. A figure passes where its magnitude is within the bound, which is the same for every engine and set for "
    "steps of 2 ms: what an engine of first order reaches, and what soft contacts give way. In `joint order`, `free "
    "flight` and `standing` the reference is MuJoCo, in the last two with finer steps: there MuJoCo's own figures say "
    "what its step makes, and no more."
)

HOW_WALKS = (
    "The robot of the data sheet on flat ground: no sensor noise, no delay, Coulomb friction of the same share of the "
    "torque limit in every joint. Simulators: `training`, the batched MuJoCo that the policies were trained in, at its "
    "own step and at 1 ms; the engines with one robot, its controllers outside of them, at 2 ms; MuJoCo again at the "
    "training's step, and with contacts that give way in 4 ms in place of 20 ms. An interval is over episodes, which "
    "differ by their first joint angles: it says how sure a number is for this policy, and nothing of other trainings."
)

COLUMNS = (
    "In a cell: mean speed over the commanded speed with its 95 % t-interval over episodes, then that speed over the "
    "one in `training` with its 95 % interval."
)


@dataclass(frozen=True)
class EnginesResult:
    """All that a study of engines found."""

    figures: tuple[FigureRow, ...]
    """Of the conformance suite."""
    paces: tuple[PaceRow, ...]
    """How fast the engines step."""
    motions: Traces
    """To be drawn."""
    walks: tuple[WalkRow, ...]
    """How policies walked; none where they were left out."""
    episodes: tuple[EpisodeRow, ...]
    """Each of their walks."""
    missing: dict[str, str]
    """Engines that cannot be had here -> why, and how to get them."""


def failures(result: EnginesResult) -> int:
    """Return how many figures are out of bounds."""
    return sum(not row.passed for row in result.figures)


def answers(result: EnginesResult) -> list[str]:
    """Return what was found, a sentence each: who passes, who is missing, and what the walks say."""
    left_out = [f"{name} was not tested: {line}." for name, line in result.missing.items()]
    return [*conformance_words(result.figures), *left_out, *walk_words(result.walks)]


def lead(result: EnginesResult) -> str:
    """Return the answer: who passes, and how many walks reach the commanded speed."""
    return " ".join([*conformance_words(result.figures), *walk_words(result.walks)[:1]])


def as_summary(result: EnginesResult) -> dict[str, Any]:
    """Return what was found as plain data: every row but those of single episodes, which episodes.csv has."""
    lists: dict[str, tuple[Any, ...]] = {"conformance": result.figures, "pace": result.paces, "walks": result.walks}
    found = {name: [asdict(row) for row in rows] for name, rows in lists.items()}
    return {"failures": failures(result), "answers": answers(result), "missing": result.missing, **found}


def report(result: EnginesResult, settings: dict[str, Any]) -> Report:
    """Return the report of the study. settings: `robot`, `engines`, `evaluation`, `policies` and `seconds`."""
    walks = draw_walks(result.walks, result.episodes) if result.walks else None
    drawn = {"motions": draw_motions(result.motions), "walks": walks}
    return Report(
        title="Physics engines",
        lead=lead(result),
        tables={
            "conformance": result.figures,
            "pace": result.paces,
            "walks": result.walks,
            "episodes": result.episodes,
        },
        sections=sections(
            result, {name: figure_uri(figure) for name, figure in drawn.items() if figure}, settings["robot"]
        ),
        run=run_blocks(settings),
        summary=settings | as_summary(result),
        notes=warnings(result),
        figures=drawn,
        answer=(*printed_tables(result.figures), *answers(result)),
        status=1 if failures(result) else 0,
    )


def printed_tables(rows: Sequence[FigureRow]) -> list[rich.table.Table]:
    """Return the figures for the terminal, a table a timestep."""
    tables = []
    for timestep in dict.fromkeys(row.timestep for row in rows):
        header, lines = figure_table(rows, timestep)
        shown = rich.table.Table(title=f"steps of {1000 * timestep:g} ms")
        for number, name in enumerate(header):
            shown.add_column(name, justify="left" if number < 2 else "right", overflow="fold")
        for line in lines:
            shown.add_row(*line)
        tables.append(shown)
    return tables


def warnings(result: EnginesResult) -> list[str]:
    """Return a line for every figure out of bounds, and for every engine that is missing."""
    lost = [
        f"{row.engine} at {1000 * row.timestep:g} ms fails {row.check}: {row.figure} is {value(row)}{unit(row)}, "
        f"within {row.bound:g} expected"
        for row in result.figures
        if not row.passed
    ]
    return [*lost, *(f"{name} was not tested: {line}" for name, line in result.missing.items())]


def sections(result: EnginesResult, pictures: dict[str, str], robot: str) -> list[Section]:
    """Return the sections of the page; `pictures`: name of a figure -> its data URI."""
    timesteps = list(dict.fromkeys(row.timestep for row in result.figures))
    drawn = (
        f"Steps of {1000 * timesteps[0]:g} ms. A shank with dry friction under a torque that holds it, breaks it away "
        "and lets it go, against its exact motion; and a flight under torques at all joints, against MuJoCo at steps "
        "of 0.1 ms."
    )
    figures = [table(*figure_table(result.figures, step), f"Steps of {1000 * step:g} ms.") for step in timesteps]
    found = [
        Section("One joint and a free flight", (picture(pictures["motions"], drawn),)),
        Section("Conformance", (paragraph(f"The robot is {robot}. {HOW_FIGURES}"), *figures)),
        Section("Pace", (paragraph(PACE), row_table(result.paces))),
    ]
    if result.walks:
        caption = f"Bars: means; points: episodes; grey: the commanded speed ±{CLOSE:.0%}."
        blocks = (picture(pictures["walks"], caption), bullets(walk_words(result.walks)), paragraph(HOW_WALKS))
        tables = (paragraph(COLUMNS), walk_table(result.walks), verdict_table(result.walks))
        found.append(Section("The same policies in every simulator", (*blocks, *tables)))
    return found


PACE = (
    "Physics steps per second of processor time, of a robot that stands under its controllers with dry friction and "
    "whose motion is read at every step; all engines in turn in the same run, the median of three rounds. What else a "
    "machine does changes the number more than the share, which is over the first engine's."
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
