"""The page of the paper's comparison: verdicts, the friction budget, every method in every engine, and clips."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from stiction.evaluation.policies import BEHIND_GEAR, FED, FED_BY
from stiction.evaluation.table import BOTH, Sample
from stiction.joints.friction import has_coefficient, level_axis, level_number, level_text
from stiction.joints.pd import COMPENSATION_WIDTH
from stiction.report.evaluation import sample_text
from stiction.report.following import friction_text, shade_following
from stiction.report.page import (
    COLORS,
    INK,
    Section,
    Sheet,
    Spread,
    draw_seeds,
    figure_block,
    fold,
    label_ends,
    labelled,
    legend,
    new_figure,
    paragraph,
    settings_table,
    table,
)
from stiction.robots.terrain import STEPS, TREAD
from stiction_experiments.lab import study
from stiction_experiments.lab.claims import JUDGED, said_of
from stiction_experiments.lab.following import changes_sheet, places_sheet, recommended_sentence, recommended_sheet
from stiction_experiments.lab.straight import BAND, FAST, SLOW, Following
from stiction_experiments.replication.plan import STAIRS_COMMAND
from stiction_experiments.replication.records import (
    FEWEST_LEVELS,
    BudgetPoint,
    EvidenceRow,
    ForwardPoint,
    Onset,
    Replication,
)

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.figure import Figure


def curves(points: Sequence[BudgetPoint]) -> dict[tuple[str, str], list[BudgetPoint]]:
    """Return the points of each engine and law that have levels enough for a curve."""
    groups: dict[tuple[str, str], list[BudgetPoint]] = {}
    for point in points:
        groups.setdefault((point.engine, point.friction_law), []).append(point)
    return {key: some for key, some in groups.items() if len({p.friction_level for p in some}) >= FEWEST_LEVELS}


def draw_budget(points: Sequence[BudgetPoint], methods: Sequence[str], band: float) -> Figure:
    """Return speed ratio of the slower direction over friction, a panel for each of `curves`, at least one.

    band: dead band f/kp of the shank at a friction of the whole torque limit [rad], for the axis on top.
    """
    shown = curves(points)
    unit = 10 * band  # mrad per per cent
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    figure, axes = new_figure(rows, columns, size=(max(6.7, 4.7 * columns), 3.7 * rows))
    for axis, ((engine, law), some) in zip(axes, shown.items(), strict=False):
        shade_following(axis)
        axis.axhline(0.0, color=INK, linewidth=0.8)
        for method in methods:
            own = sorted((p for p in some if p.method == method), key=lambda p: p.friction_level)
            if own:
                spreads = [Spread(level_number(law, p.friction_level), p.ratio, p.low, p.high, p.each) for p in own]
                draw_seeds(axis, spreads, method, methods)
        axis.set(title=engine, xlabel=level_axis(law), ylim=(-0.2, 1.9))
        label_ends(axis)
        if not has_coefficient(law):
            top = axis.secondary_xaxis("top", functions=(lambda level: level * unit, lambda angle: angle / unit))
            top.set_xlabel("dead band f/kp of the shank [mrad]", color=INK)
            top.tick_params(colors=INK)
    for axis in axes[len(shown) :]:
        axis.set_visible(False)
    axes[0].set_ylabel("speed reached / commanded")
    lines = {label: line for axis in axes for label, line in labelled(axis).items()}
    drawn = {method: lines[method] for method in methods if method in lines}
    legend(figure, drawn, loc="outside lower center", ncols=5)
    return figure


def draw_needs(cells: Sequence[Following], methods: Sequence[str]) -> Figure:
    """Return how many seeds of each method follow at each tested level, a panel for each engine; at least one cell.

    The greener, the more seeds; ▼ so many are too slow, ▲ so many too fast, × so many fell.
    """
    engines = list(dict.fromkeys(cell.engine for cell in cells))
    levels = sorted({cell.friction_level for cell in cells})
    shown = [method for method in methods if any(cell.method == method for cell in cells)]
    columns = min(2, len(engines))
    height = -(-len(engines) // columns)
    figure, axes = new_figure(height, columns, size=(5.4 * columns, (0.62 * len(shown) + 1.1) * height))
    for axis, engine in zip(axes, engines, strict=False):
        for cell in (cell for cell in cells if cell.engine == engine and cell.method in shown):
            at, row = levels.index(cell.friction_level), shown.index(cell.method)
            share = cell.follow / cell.seeds
            axis.barh(row, 0.94, 0.9, at - 0.47, color=COLORS[2], alpha=0.02 + 0.23 * share, linewidth=0)
            wrong = (("▼", cell.too_slow), ("▲", cell.too_fast), ("×", cell.fell))
            text = " ".join(f"{mark}{number}" for mark, number in wrong if number)
            label = f"{cell.follow} of {cell.seeds}" + (f"\n{text}" if text else "")
            axis.text(at, row, label, ha="center", va="center", color=INK)
        axis.set_xticks(range(len(levels)), [level_text("coulomb", level) for level in levels])
        axis.set_yticks(range(len(shown)), shown)
        axis.grid(False)
        axis.set(title=engine, xlim=(-0.5, len(levels) - 0.5), ylim=(len(shown) - 0.5, -0.5))
    for axis in axes[len(engines) :]:
        axis.set_visible(False)
    figure.supxlabel("dry friction over each joint's torque limit", color=INK)
    return figure


ENGINES = {
    "mujoco": "MuJoCo, the simulator of the training",
    "mujoco-alone": "Sim2Sim: MuJoCo with one robot in it, motors and friction by us",
    "physx": "Sim2Sim: PhysX",
    "ode-webots": "Sim2Sim: ODE as Webots sets it up; not run in Webots",
    "ode": "Sim2Sim: ODE",
    "physx+all": "The virtual robot",
    "physx+friction": "The virtual robot's friction alone",
    "physx+rest": "All of the virtual robot but friction",
    "physx+nominal": "The virtual robot with nothing hidden",
}
"""Engine -> title of its table."""

COLUMNS = (
    ("vx=0.5", "speed_ratio", "forward [1]", ".2f"),
    ("vx=-0.5", "speed_ratio", "backward [1]", ".2f"),
    ("vy=0.3", "speed_ratio", "sideways [1]", ".2f"),
    ("wz=0.5", "speed_ratio", "turn [1]", ".2f"),
    (BOTH, "fall_rate", "falls [% of walks]", ".0%"),
    (BOTH, "joint_jitter", "jitter [rad/s²]", ".0f"),
    (BOTH, "flight_share", "flight [% of moving steps]", ".0%"),
    (BOTH, "tripod_share", "tripod [% of moving steps]", ".0%"),
    ("stand", "tracking_error", "standing [m/s]", ".3f"),
)
"""Command, column, heading, format."""

NOTE = (
    "Mean ± 95 % t-interval over training seeds; one seed has none. Forward to turn: speed reached over commanded. "
    "Falls to tripod: forward and backward together. Jitter: root mean square joint acceleration. In brackets behind a "
    "share of walks: Wilson's 95 % interval over trials, which are walks, and of virtual robots pairs of policy and "
    "robot: all policies share the robots, so it is too narrow for other robots. Every seed's number is in methods.csv."
)
"""Note for readers of these tables."""


def engine_sheets(samples: Sequence[Sample]) -> list[Sheet]:
    """Return a table of all methods at all levels for every engine and law on flat ground, known engines first.

    The laws of a virtual robot share one: they are its friction alone, of the bench, and with load.
    """
    groups: dict[tuple[str, str], list[Sample]] = {}
    for sample in samples:
        if sample.terrain == "flat":
            law = "" if "+" in sample.engine else sample.friction_law
            groups.setdefault((sample.engine, law), []).append(sample)
    rank = {engine: number for number, engine in enumerate(ENGINES)}
    sheets = []
    for engine, law in sorted(groups, key=lambda key: rank.get(key[0], len(rank))):
        title = ENGINES.get(engine, engine) + (f", friction by the law {law}" if law not in ("", "coulomb") else "")
        sheets.append(_engine_sheet(title, groups[engine, law]))
    return sheets


def _engine_sheet(title: str, own: Sequence[Sample]) -> Sheet:
    """Return one engine: a row for every friction and method, the columns that somebody has."""
    cells = {(s.friction_law, s.friction_level, s.method, s.command, s.column): s for s in own}
    frictions = sorted({key[:2] for key in cells}, key=lambda one: (len(one[0]), one))
    methods = list(dict.fromkeys(s.method for s in own))
    columns = [one for one in COLUMNS if any((s.command, s.column) == one[:2] for s in own)]
    rows = []
    for law, level in frictions:
        for method in methods:
            shown = [cells.get((law, level, method, *column[:2])) for column in columns]
            if any(shown):
                texts = (sample_text(one, column[-1]) for one, column in zip(shown, columns, strict=True))
                rows.append((friction_text(law, level), method, seeds_text(shown), *texts))
    header = ("friction", "method", "seeds", *(heading for *_, heading, _ in columns))
    return Sheet(title, header, tuple(rows), NOTE)


def seeds_text(samples: Iterable[Sample | None]) -> str:
    """Return the number of training seeds behind samples."""
    counts = sorted({len(sample.seeds.split()) for sample in samples if sample is not None})
    return " or ".join("one" if count == 1 else str(count) for count in counts)


def stairs_sheet(samples: Sequence[Sample]) -> Sheet | None:
    """Return the crossings of every training method; None where none was walked."""
    cells = {(s.method, s.engine, s.friction_law, s.friction_level, s.terrain, s.column): s for s in samples}
    rows = []
    for (method, engine, law, level, terrain, column), sample in cells.items():
        if column == "crossed":
            steps = cells.get((method, engine, law, level, terrain, "steps_climbed"))
            where = method, engine, friction_text(law, level), terrain, seeds_text([sample]), str(sample.trials)
            rows.append((*where, sample_text(sample, ".0%"), sample_text(steps, ".1f")))
    header = ("method", "engine", "friction", "ground", "seeds", "trials", "crossed [% of walks]", "passed [steps]")
    speed = STAIRS_COMMAND.removeprefix("vx=")
    note = f"Blind, {TREAD:.2f} m treads, {STEPS} up, landing, {STEPS} down, {speed} m/s. {NOTE}"
    return Sheet("Stairs", header, tuple(rows), note) if rows else None


VERDICT_NOTE = (
    f"{JUDGED} Shares of the torque limit and of the load are axes of their own: "
    "the evidence says on which one x is, and on the others the sentence holds throughout, or nowhere. A rate "
    "(falls, crossings) also has Wilson's interval, over trials, and is decided where both agree: the one knows "
    "how trainings differ, the other how many walks there were. A trial is a walk; of virtual robots it is a pair "
    "of policy and robot, since the walks of one robot are not independent. All policies walk on the same virtual "
    "robots: there, rates and speeds have one more interval with the robots as the sample, which must agree; joint "
    "accelerations are compared over seeds alone, of those that walk. In verdicts.csv and evidence.csv sentences have "
    "numbers, whose letters say where they are from: E, the paper's comparison; V, its section on training with "
    "friction; T, what it concludes from its motors; X, explanations for what it saw."
)
"""Note for readers of the verdicts."""


UNITS = {"joint_jitter": "rad/s²", "tracking_error": "m/s", "steps_climbed": "steps"}
"""Column of the evidence -> its unit; all others are ratios and shares, of the unit 1."""


def evidence_sheet(claim: str, evidence: Sequence[EvidenceRow]) -> Sheet:
    """Return the rows that one sentence was judged by."""
    rows = []
    for row in evidence:
        if row.claim == claim:
            friction = friction_text(row.friction_law, row.friction_level)
            where = row.method, row.engine, friction, row.terrain, row.command
            rows.append((*where, f"{row.column} [{UNITS.get(row.column, '1')}]", row.seeds, row.each))
    header = ("method", "engine", "friction", "ground", "command", "column [its unit]", "seeds", "each seed")
    return Sheet("The rows that this was judged by", header, tuple(rows))


def onset_sheet(onsets: Sequence[Onset]) -> Sheet:
    """Return where each method becomes too slow, in every engine, with every seed."""
    rows = []
    for one in onsets:
        law = one.friction_law
        if one.level is None:
            text = f"not up to {level_text(law, one.tested)}"
        else:
            text = "from the start" if one.level == 0 else level_text(law, round(one.level, 4))
        interval = "–"
        if one.low is not None and one.high is not None:
            interval = " to ".join(level_text(law, round(max(0.0, end), 4)) for end in (one.low, one.high))
        band = "–" if one.dead_band is None else f"{1000 * one.dead_band:.0f}"
        each = ", ".join(
            f"{'over ' * word.startswith('>')}{level_text(law, round(float(word.lstrip('>')), 4))}"
            for word in one.each.split()
        )
        rows.append((one.method, one.engine, law, text, interval, band, each))
    header = ("method", "engine", "law", f"slows under {SLOW}", "95 % over seeds", "dead band [mrad]", "each seed")
    note = f"The slower of forward and backward. What is above {SLOW} may be over {FAST}, and then follows no more."
    return Sheet(f"Where each training method slows under {SLOW} of the command", header, tuple(rows), note)


def forward_sheet(points: Sequence[ForwardPoint], virtual: bool) -> Sheet | None:
    """Return the conventional policy alone, with friction fed forward, and friction-aware training beside it.

    virtual: on virtual robots, or on the robot of the data sheet. None where no friction was fed forward there.
    """
    cells = {(p.method, p.engine, p.friction_law, p.friction_level): p for p in points}
    fed = {FED} | {p.method for p in points}
    methods = ("none", *(method for method in FED_BY.values() if method in fed), "deception")
    rows = []
    for one in points:
        if one.method == FED and ("+" in one.engine) == virtual:
            where = one.engine, one.friction_law, one.friction_level
            each = (cells.get((method, *where)) for method in methods)
            counts = (f"{one.robots} of {one.robots + one.left_out}",) if virtual else ()
            rows.append((one.engine, friction_text(*where[1:]), *counts, *map(_ratio_text, each)))
    header = ("engine", "friction", *(("robots",) if virtual else ()), *(f"{method} [1]" for method in methods))
    where_text = "on the virtual robot" if virtual else "on the robot of the data sheet"
    source = "what was identified from the log of each robot's own bench" if virtual else "the friction itself"
    left_out = " Robots whose bench does not tell it are left out, of the methods beside it too." if virtual else ""
    note = (
        "Speed reached over commanded in the slower direction, mean ± 95 % t-interval over training seeds, in brackets "
        f"their number. +forward: f sat((a − θ)/{COMPENSATION_WIDTH:g} rad) in the joint controllers; +reference, "
        f"+measured: a share of f in the direction of the target's or the joint's speed. f is {source}."
        f"{left_out}"
    )
    return Sheet(f"Friction fed forward, {where_text}", header, tuple(rows), note) if rows else None


def _ratio_text(point: BudgetPoint | None) -> str:
    if point is None:
        return "–"
    spread = "" if point.high is None else f" ± {point.high - point.ratio:.2f}"
    return f"{point.ratio:.2f}{spread} ({point.seeds})"


TITLE = "Does it transfer? The paper's comparison"

NAMED_LEVEL = 0.2
"""Friction of which the first sentence says who follows [-]: that of the training."""

REMEDY = (
    "A verdict takes several training seeds of every method that a sentence compares: give those of each seed "
    "with --policies, or train them with --preset full. It has three seeds or more of every method "
    "on flat ground, and of `none` and `deception` over stairs. It has no policy of an Actuator Net for stairs: the "
    "sentence on that is judged only where such policies are given."
)
"""Remedy for a single seed."""


def report(result: Replication) -> study.Report:
    """Return the report of the comparison."""
    figures, sheets = draw_figures(result), sheets_of(result)
    return study.Report(
        title=TITLE,
        lead=lead(result),
        tables=result.tables,
        sections=sections(result, figures, sheets),
        run=run_blocks(result),
        summary=result.plain,
        notes=warnings(result),
        figures=figures,
        sheets=tuple(sheets.values()),
        json={verdict.id: verdict.outcome for verdict in result.verdicts},
    )


def draw_figures(result: Replication) -> dict[str, Figure]:
    """Return the friction budget and who follows where."""
    methods = list(dict.fromkeys(point.method for point in result.budget))
    figures = {}
    if curves(result.budget):
        figures["budget"] = draw_budget(result.budget, methods, result.summary["dead_band"])
    if result.needs:
        figures["needs"] = draw_needs(result.needs, list(result.methods))
    return figures


def sheets_of(result: Replication) -> dict[str, Sheet]:
    """Return the tables that a README can take, by name."""
    named = {
        "needs": recommended_sheet(result.needs) if result.needs else None,
        "places": places_sheet(result.needs) if result.needs else None,
        "onsets": onset_sheet(result.onsets),
        "verdicts": study.verdict_sheet(result.verdicts, VERDICT_NOTE, "The paper's sentences"),
        "changes": changes_sheet(result.summary, {one.id: one.sentence for one in result.verdicts}),
        "forward": forward_sheet(result.forward, virtual=True),
        "forward-exact": forward_sheet(result.forward, virtual=False),
        "stairs": stairs_sheet(result.samples),
    }
    engines = {f"engine-{number}": sheet for number, sheet in enumerate(engine_sheets(result.samples))}
    return {name: sheet for name, sheet in (named | engines).items() if sheet is not None}


def sections(result: Replication, figures: Mapping[str, Figure], sheets: Mapping[str, Sheet]) -> list[Section]:
    """Return the sections of the page: what a robot builder needs, the verdicts, then all the rest folded."""

    def shown(name: str) -> tuple[Markup, ...]:
        return sheets[name].blocks() if name in sheets else ()

    def folded(name: str, title: str = "") -> tuple[Markup, ...]:
        return (fold(title or sheets[name].title, shown(name)),) if name in sheets else ()

    needs: tuple[Markup, ...] = ()
    if "needs" in figures:
        caption = (
            "Training seeds that follow. ▼ too slow, ▲ too fast, × fell; a seed can be too slow in one direction, too "
            "fast in the other."
        )
        image = figure_block(figures["needs"], caption)
        needs = *shown("needs"), image, *folded("places", "The same place by place, in numbers")
    levels: tuple[Markup, ...] = ()
    if "budget" in figures:
        caption = f"Slower of forward and backward. Points: training seeds; band: 95 % t-interval; green: {BAND}."
        image = figure_block(figures["budget"], caption)
        levels = image, *folded("onsets", f"Where each method slows under {SLOW}, in numbers")
    page = [
        Section("Which training does my joint need?", needs),
        Section("The friction budget", levels),
        Section("Is it enough to feed friction forward?", (*shown("forward"), *folded("forward-exact"))),
        Section(
            "What became of the paper's sentences",
            (*_brief(sheets["verdicts"]).blocks(), *folded("changes"), evidence_fold(result)),
        ),
        Section("Stairs", shown("stairs")),
        Section("Every method, place by place", tuple(f for n in sheets if n.startswith("engine-") for f in folded(n))),
    ]
    return [section for section in page if section.blocks]


def _brief(verdicts: Sheet) -> Sheet:
    keep = [index for index, title in enumerate(verdicts.header) if title != "evidence"]
    rows = tuple(tuple(cells[index] for index in keep) for cells in verdicts.rows)
    return replace(verdicts, header=tuple(verdicts.header[index] for index in keep), rows=rows)


def evidence_fold(result: Replication) -> Markup:
    """Return, for each verdict, its numbers, their intervals and the rows that it read."""
    folds = []
    for verdict in result.verdicts:
        rows = evidence_sheet(verdict.id, result.evidence)
        blocks = [paragraph(verdict.evidence), *(rows.blocks() if rows.rows else ())]
        folds.append(fold(f"“{verdict.sentence}” ({study.filled(verdict)})", blocks, verdict.id))
    return fold("Numbers, intervals and the rows behind each sentence (evidence.csv)", folds)


def run_blocks(result: Replication) -> tuple[Markup, ...]:
    """Return methods, policies and grids."""
    summary = result.summary
    policies = [
        (name, p["way"], str(p["seed"]), p["revision"], p["digest"][:16], p["command"])
        for name, p in summary["policies"].items()
    ]
    grids = [
        fold(
            grid["title"],
            [settings_table({key: value for key, value in grid.items() if key not in ("title", "warnings")})],
        )
        for grid in summary["grids"].values()
    ]
    return (
        table(("method", "what it is"), list(result.methods.items())),
        fold("Policies", [table(("policy", "method", "seed", "revision", "digest", "made by"), policies)]),
        fold("Grids", grids),
        *((paragraph(summary["told"]),) if "told" in summary else ()),
        paragraph("Everything here is simulation. The virtual robot plays the real one; no robot was involved."),
    )


def lead(result: Replication) -> str:
    """Return the outcome in a sentence or two; where each method has one seed, first that nothing is judged."""
    single, several = single_and_several(result)
    outcomes = ""
    if several:
        outcomes = said_of(result.verdicts, "sentences and explanations of the paper") if result.verdicts else ""
    elif single:
        outcomes = f"One training seed a method: numbers, no verdicts. {REMEDY}"
    needs = recommended_sentence(result.needs, NAMED_LEVEL)
    return "\n".join(filter(None, (needs, outcomes) if several else (outcomes, needs)))


def single_and_several(result: Replication) -> tuple[list[str], list[str]]:
    """Return the training methods of which one seed walked, and those of several; on stairs apart from flat ground."""
    seeds: dict[str, set[str]] = {}
    for sample in result.samples:
        where = sample.method if sample.terrain == "flat" else f"{sample.method} on stairs"
        seeds.setdefault(where, set()).update(sample.seeds.split())
    single = [method for method, own in seeds.items() if len(own) == 1]
    return single, [method for method in seeds if method not in single]


def warnings(result: Replication) -> list[str]:
    """Return what a reader must know before the numbers."""
    failed: Mapping[str, str] = result.summary.get("failed", {})
    sentences = [f"Not trained, and left out: {name}. {reason}" for name, reason in failed.items()]
    single, several = single_and_several(result)
    if single and several:
        sentences.append(f"One training seed, a number and no verdict: {', '.join(single)}. {REMEDY}")
    sentences += [f"{part.title}. {warning}" for part in result.parts for warning in part.warnings]
    if missing := [method for method in ("none", BEHIND_GEAR, "deception") if method not in result.methods]:
        sentences.append(f"Of the paper's three methods there is no policy here for: {', '.join(missing)}.")
    return sentences
