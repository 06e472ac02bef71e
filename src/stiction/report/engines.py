"""The page of the study of engines: what each did in the conformance suite, and how the same policies walk in each."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from stiction.formats.engines import EpisodeRow, FigureRow, PaceRow, Traces, WalkRow
from stiction.formats.errors import StictionError
from stiction.formats.results import write_summary
from stiction.formats.rows import write_rows
from stiction.report.engine_figures import draw_motions, draw_walks
from stiction.report.engine_tables import figure_table, pace_cells, unit, value, verdict_table, walk_table
from stiction.report.engine_words import CLOSE, conformance_words, walk_words
from stiction.report.page import Section, bullets, figure_uri, paragraph, picture, render_page, table

HOW_FIGURES = (
    "Every engine has the same robot, Saturn Lite, and is told torques and bounds of dry friction from outside, step "
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


def write_engines(out: Path, result: EnginesResult, summary: dict[str, Any]) -> Path:
    """Write conformance.csv, pace.csv, walks.csv, episodes.csv, figures, summary.json and report.html into `out`.

    Returns the path of the page. What there are no rows of is not written, and what an earlier study left of it goes.

    Raises:
        StictionError: something cannot be written.

    """
    tables: dict[str, tuple[Any, ...]] = {
        "conformance": result.figures,
        "pace": result.paces,
        "walks": result.walks,
        "episodes": result.episodes,
    }
    drawn = {"motions": draw_motions(result.motions)}
    if result.walks:
        drawn["walks"] = draw_walks(result.walks, result.episodes)
    try:
        for name, rows in tables.items():
            (out / f"{name}.csv").unlink(missing_ok=True)
            if rows:
                write_rows(out / f"{name}.csv", rows)
        (out / "walks.png").unlink(missing_ok=True)
        for name, figure in drawn.items():
            figure.savefig(out / f"{name}.png", dpi=110, facecolor="white")
        write_summary(out / "summary.json", summary)
        pictures = {name: figure_uri(figure) for name, figure in drawn.items()}
        page, told = out / "report.html", [*summary["warnings"], *warnings(result)]
        text = render_page("Physics engines", sections(result, pictures, summary), lead(result), told)
        page.write_text(text, encoding="utf-8")
    except OSError as error:
        raise StictionError(f"the study cannot be written to {out}: {error}; choose another --out") from error
    return page


def warnings(result: EnginesResult) -> list[str]:
    """Return a line for every figure out of bounds, and for every engine that is missing."""
    lost = [
        f"{row.engine} at {1000 * row.timestep:g} ms fails {row.check}: {row.figure} is {value(row)}{unit(row)}, "
        f"within {row.bound:g} expected"
        for row in result.figures
        if not row.passed
    ]
    return [*lost, *(f"{name} was not tested: {line}" for name, line in result.missing.items())]


def sections(result: EnginesResult, pictures: dict[str, str], summary: dict[str, Any]) -> list[Section]:
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
        Section("Conformance", (paragraph(HOW_FIGURES), *figures)),
        Section(
            "Pace", (paragraph(PACE), table(["engine", "step", "steps/s", "share"], map(pace_cells, result.paces)))
        ),
    ]
    if result.walks:
        caption = f"Bars: means; points: episodes; grey: the commanded speed ±{CLOSE:.0%}."
        blocks = (picture(pictures["walks"], caption), bullets(walk_words(result.walks)), paragraph(HOW_WALKS))
        tables = (paragraph(COLUMNS), walk_table(result.walks), verdict_table(result.walks))
        found.append(Section("The same policies in every simulator", (*blocks, *tables)))
    return [*found, Section("What was run", run_blocks(summary))]


PACE = (
    "Physics steps per second of processor time, of a robot that stands under its controllers with dry friction and "
    "whose motion is read at every step; all engines in turn in the same run, the median of three rounds. What else a "
    "machine does changes the number more than the share, which is over the first engine's."
)


def run_blocks(summary: dict[str, Any]) -> tuple[Markup, ...]:
    """Return what was run, on what."""
    blocks = [paragraph(f"Command: {summary['command']}")]
    if summary["policies"]:
        cfg = summary["evaluation"]
        policies = [(name, p["method"], str(p["seed"]), p["revision"]) for name, p in summary["policies"].items()]
        blocks += [
            paragraph(
                f"{cfg['episodes']} episodes of {cfg['seconds']:g} s a walk, the first {cfg['settle']:g} s left out, "
                f"seed {cfg['seed']}."
            ),
            table(["policy", "method", "seed", "revision"], policies),
        ]
    machine = f"{summary['machine']['cores']} cores, {summary['machine']['cpu']}"
    return (
        *blocks,
        paragraph(f"Revision {summary['revision']}, {summary['seconds']:.0f} s on a machine with {machine}."),
        paragraph("Everything here is simulation."),
    )
