"""The results of an evaluation as files: results.csv, summary.json, the friction budget, and a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from stiction.core.files import write_text
from stiction.core.records import make_folder, write_rows
from stiction.engines.catalog import TIMESTEP
from stiction.evaluation.metrics import WINDOW
from stiction.evaluation.table import BOTH, Sample
from stiction.files.following import DEFINITION, count_commands
from stiction.files.results import DIRECTIONS, ResultRow, tell_slowest_walk, write_results, write_summary
from stiction.joints.friction import LAWS, has_coefficient, level_axis, level_number, level_text
from stiction.joints.pd import COMPENSATION_WIDTH
from stiction.report.evaluated import evaluation_glance
from stiction.report.following import (
    SLOWEST_WALK,
    command_map,
    counts_sheet,
    followed_text,
    judged_text,
    onset_lines,
    pace_text,
    result_cells,
    shade_following,
)
from stiction.report.glance import card
from stiction.report.page import (
    INK,
    Section,
    Spread,
    draw_seeds,
    figure_block,
    fold,
    label_ends,
    labelled,
    legend,
    line_look,
    mark_look,
    new_figure,
    paragraph,
    render_page,
    same_scale,
    save_figure,
    settings_table,
    table,
)
from stiction.robots.model import GAITS

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def sample_text(sample: Sample | None, form: str) -> str:
    """Return a mean with its intervals, a dash where there is none."""
    if sample is None:
        return "–"
    text = format(sample.mean, form)
    if sample.high is not None:
        text += f" ± {format(sample.high - sample.mean, form)}"
    if sample.trials_low is not None and sample.trials_high is not None:
        text += f" ({sample.trials_low:.0%} to {sample.trials_high:.0%})"
    return text


Scene = tuple[str, str]
"""Engine and ground of a row."""

DEFAULT: Scene = ("mujoco", "flat")
"""Default engine and ground of an evaluation."""


def _scene(row: ResultRow | Sample) -> Scene:
    """Return where a row was walked."""
    return row.engine, row.terrain


def _scenes(rows: Sequence[ResultRow]) -> list[Scene]:
    """Return every scene once."""
    return list(dict.fromkeys(map(_scene, rows)))


def _scene_text(scene: Scene) -> str:
    """Return a scene as people read it: `physx`, `physx on stairs=0.1`."""
    engine, terrain = scene
    return engine if terrain == "flat" else f"{engine} on {terrain}"


MOST_PANELS = 4
"""Commands that the figure shows."""

LONGEST_END = 24
"""Letters of a name that stands at the end of its line too; a longer one takes the room of the lines."""


def draw_budget(rows: Sequence[ResultRow], samples: Sequence[Sample] = (), methods: Mapping[str, str] = {}) -> Figure:
    """Return the friction budget: speed ratio over friction level, a line for each policy or training method.

    A panel for each command, two side by side, for each scene and law there: levels of two laws have other units.
    samples: the training methods over their seeds; methods: policy -> its method. Of one with several seeds there is
    their mean with its interval and every seed; of any other a line for each policy.
    """
    moving = [row for row in rows if row.speed_ratio is not None]
    lines = list(dict.fromkeys((_scene(row), row.friction_law) for row in moving))
    columns = list(dict.fromkeys(row.command for row in moving))
    if len(columns) > MOST_PANELS:
        # The map of commands has the others.
        columns = [command for command in columns if command in DIRECTIONS] or columns[:MOST_PANELS]
    width = min(2, max(1, len(columns)))
    columns += [""] * (-len(columns) % width)
    height = max(1, len(lines) * len(columns) // width)
    figure, axes = new_figure(height, width, size=(4.6 * width, 3.4 * height))
    speeds = [sample for sample in samples if sample.column == "speed_ratio"]
    several = {sample.method for sample in speeds if sample.low is not None}
    drawn = {row.policy: methods[row.policy] if methods.get(row.policy) in several else row.policy for row in rows}
    names = list(dict.fromkeys(drawn.values()))
    panels = [(scene, law, command) for scene, law in lines for command in columns]
    for axis, panel in zip(axes, panels, strict=False):
        scene, law, command = panel
        shown = [row for row in moving if (_scene(row), row.friction_law, row.command) == panel]
        own = [one for one in speeds if (_scene(one), one.friction_law, one.command) == panel]
        axis.set_visible(bool(shown))
        shade_following(axis)
        axis.axhline(0.0, color=INK, linewidth=0.8)
        for name in names:
            if name in several:
                mine = sorted((one for one in own if one.method == name), key=lambda one: one.friction_level)
                spreads = [Spread(level_number(law, s.friction_level), s.mean, s.low, s.high, s.each) for s in mine]
                draw_seeds(axis, spreads, name, names)
                continue
            points = sorted((level_number(law, r.friction_level), r.speed_ratio) for r in shown if r.policy == name)
            levels, ratios = ([point[k] for point in points] for k in (0, 1))
            look = line_look(name, names) | {"marker": mark_look(name, names), "markersize": 4}
            axis.plot(levels, ratios, label=name, **look)
        where = f"{_scene_text(scene)}, " if _scenes(moving) != [DEFAULT] else ""
        axis.set(title=f"{where}commanded {command}", xlabel=level_axis(law))
    if moving:
        for axis in axes[::width]:
            axis.set_ylabel("speed reached / commanded")
        # Before the names at the ends of lines, which are placed by the final scale.
        same_scale([axis for axis in axes if axis.get_visible()])
        for axis in axes[width - 1 :: width] if max(map(len, names)) <= LONGEST_END else ():
            label_ends(axis)
        # Under the panels: within, names of thirty letters lie on lines.
        legend(figure, labelled(axes[0]), loc="outside lower center", ncols=min(2, width))
    return figure


TITLE = "Speed over joint friction"
"""Title of the page."""

MOVING = "moving"
"""Column that results.csv does not have; it comes from summary.json."""

TRIPOD = GAITS[6]
"""Column of one contact group on the ground, by its name for six feet."""

UNITS = {
    "friction": "of τ_max",
    "command": "m/s, wz rad/s",
    "speed ratio": "1",
    SLOWEST_WALK: "1",
    "error": "m/s, of wz rad/s",
    "falls": "% of episodes",
    "jitter": "rad/s²",
    "cost of transport": "1",
    TRIPOD: "% of moving steps",
    "flight": "% of moving steps",
    MOVING: "% of steps",
    "steps passed": "steps",
    "crossed": "% of walks",
}
"""Column -> its unit."""

DEFINITIONS = (
    (
        "speed ratio",
        "mean speed along the command over the commanded speed; after a fall the speed counts as zero; in brackets the "
        "slowest and the fastest virtual robot",
    ),
    (
        SLOWEST_WALK,
        "the same of the slowest single walk, on whatever robot: the pace is that of means over walks, which hide a "
        "walk that stalls",
    ),
    (
        "pace",
        "follows, or what is wrong: falls, too slow, too fast, drifts, stalls; of virtual robots the slowest and the "
        "fastest count too; a dash: an older row, without mean velocities",
    ),
    ("error", f"mean distance of velocity and command, over windows of {WINDOW:g} s, in m/s (rad/s for a pure turn)"),
    ("falls", "share of episodes with a fall; a simulation that became unstable counts as one"),
    (
        "jitter",
        "root mean square change of joint velocity over a control period, divided by it, in rad/s²; of motion faster "
        "than half the control rate it sees what aliasing leaves",
    ),
    ("cost of transport", "mechanical energy over weight times distance; a dash where the robot does not get away"),
    (
        TRIPOD,
        "share of moving steps in which the feet on the ground are exactly one contact group, no foot more or less",
    ),
    ("flight", "share of moving steps with no foot on the ground; a dash where the robot does not move"),
    (MOVING, "share of all steps in which the robot moves; none after a fall"),
)
"""Meaning of the columns, in the order of the table."""


CONDITIONS = (
    "Dry friction in every joint ({}), sensor noise as in training. The joints' inertia, viscous friction and gains "
    "are the nominal ones of the policy's training, masses those of the robot's specification. All of these are held "
    "fixed here, while training randomises them; so are:"
)
"""Quantities not varied, on the robot of the data sheet."""

VIRTUAL = (
    "A name behind a + is a virtual robot in that engine: what of it is real differs from the data sheet by numbers "
    "that nobody who trained or drives a policy has read. Robots with the seeds {}; each walks every episode."
)
"""Definition of a virtual robot."""

FED_FORWARD = (
    "Policies called +forward are those of that name with dry friction fed forward in the joint controllers: f sat((a "
    f"− θ)/{COMPENSATION_WIDTH:g} rad) is added to the motor's torque every {1000 * TIMESTEP:g} ms, in mujoco at its "
    "physics step. Those called +reference or +measured get a share of f in the direction of the target's or the "
    "joint's speed, and while a joint is stuck in that of the error; -motor: in the motors' own controllers. f is the "
    "law's own level on the robot of the data sheet, and on a virtual robot what was identified from the log of that "
    "robot's own bench."
)
"""Definition of a policy with friction fed forward."""

INTERVALS = "In brackets: Wilson's 95 % intervals, over episodes; over robots where those are virtual."
"""Meaning of the brackets after a rate."""

MEASURES = ("speed_ratio", "tracking_error", "fall_rate", "joint_jitter")
"""Columns of results.csv that the table of training methods shows."""

SAMPLES = (
    "Mean ± 95 % t-interval over training seeds: a seed is one sample, however many episodes it walked; one seed has "
    "none. In brackets behind falls: Wilson's 95 % interval over trials, which are walks, and of virtual robots pairs "
    "of policy and robot. More columns, and every seed's numbers, are in methods.csv."
)
"""Meaning of the numbers after a training method."""

OVER_SEEDS = (
    "A training method with several seeds: a point is a seed's mean over episodes, the line the mean over seeds, the "
    "band its 95 % t-interval; circles on a line: one policy, its mean over episodes."
)
COMMAND_MAP = "Reached share of each commanded axis, mean over walks; behind it what is wrong where it is not followed."
"""Explanation of the map of commands."""

FIXED = {
    "action_delay": "action delay {:g} s",
    "encoder_offset": "encoder offset {:g} rad",
    "ground_friction": "ground friction {:g}",
    "push_velocity": "pushes of {:g} m/s",
    "payload": "payload {:g} kg",
}
"""Words for the entries of the summary's `conditions`."""


FILES = ("results.csv", "methods.csv", "summary.json", "friction_budget.svg", "friction_budget.png", "report.html")
"""Files that `write_evaluation` writes."""


def write_evaluation(
    out: Path, rows: Sequence[ResultRow], summary: dict[str, Any], samples: Sequence[Sample] = ()
) -> Path:
    """Write every file of an evaluation into `out`; return the path of the page.

    samples: the training methods over their seeds, for methods.csv, its table and the figure.

    Raises:
        StictionError: the directory cannot be made or written.

    """
    figure = draw_budget(rows, samples, summary["ways"])
    make_folder(out)
    write_results(out / "results.csv", rows)
    write_summary(out / "summary.json", summary)
    if samples:
        write_rows(out / "methods.csv", samples)
    for kind in ("svg", "png"):
        save_figure(figure, out / f"friction_budget.{kind}")
    page, shown = out / "report.html", sections(rows, summary, samples)
    first = [*lead(rows).split("\n"), *onset_lines(summary.get("onset", {}))]
    at_a_glance = card(replace(evaluation_glance(rows, summary), notes=()))
    picture = budget_picture(figure, samples)
    text = render_page(TITLE, shown, first, summary["warnings"], summary["command"], figure=picture, card=at_a_glance)
    write_text(page, text)
    return page


def lead(rows: Sequence[ResultRow]) -> str:
    """Return the answer: the commands that each policy follows at each friction, a line a policy and place."""
    lines = [f"{title} {followed_text(own)}." for title, own in _walkers(rows)]
    return "\n".join((*lines, f"A policy is one training seed. {DEFINITION}"))


def _walkers(rows: Sequence[ResultRow]) -> list[tuple[str, list[ResultRow]]]:
    """Return the rows of every policy in every place, with its name and, where there are several places, the place."""
    several = len(_scenes(rows)) > 1
    groups: dict[tuple[str, Scene], list[ResultRow]] = {}
    for row in rows:
        groups.setdefault((row.policy, _scene(row)), []).append(row)
    return [(f"{who}, {_scene_text(scene)}," if several else who, own) for (who, scene), own in groups.items()]


def sections(rows: Sequence[ResultRow], summary: dict[str, Any], samples: Sequence[Sample] = ()) -> list[Section]:
    """Return the sections of the page: commands, training methods, table, definitions, what was run."""
    feet = {policy.get("feet", 6) for policy in summary["policies"].values()}
    gait = " or ".join(GAITS[count] for count in sorted(feet) if count in GAITS)
    maps = [block for title, own in _walkers(rows) for block in command_map(own, title.rstrip(",")).blocks()]
    leading = [Section("Commands by friction", (paragraph(COMMAND_MAP), *maps))]
    if any(sample.low is not None for sample in samples):
        counts = count_commands(rows, lambda row: summary["ways"][row.policy])
        leading.append(Section("How many training seeds follow", counts_sheet(counts).blocks()))
        leading.append(Section("Training methods, over their seeds", (methods_table(samples, rows, summary["ways"]),)))
    return [
        *leading,
        Section("Every row", (results_table(rows, summary["rows"], gait), definitions_table(rows, gait))),
        Section("What was run", run_blocks(summary)),
    ]


def methods_table(samples: Sequence[Sample], walked: Sequence[ResultRow], methods: Mapping[str, str]) -> Markup:
    """Return what every training method reached, with intervals, and the pace and the speed ratio of every seed.

    walked: the rows behind the samples; methods: policy -> its method.
    """
    paced: dict[tuple[str, ...], list[str]] = {}
    for row in walked:
        level = _level(row.friction_law, row.friction_level)
        own_cell = methods[row.policy], row.engine, row.terrain, level, row.command
        paced.setdefault(own_cell, []).append(pace_text(row))
    cells: dict[tuple[str, ...], dict[str, Sample]] = {}
    for one in samples:
        if one.command != BOTH:
            level = _level(one.friction_law, one.friction_level)
            cells.setdefault((one.method, one.engine, one.terrain, level, one.command), {})[one.column] = one
    rows = []
    look = {item.name: item.metadata for item in fields(ResultRow)}
    for cell, own in cells.items():
        speed = own.get("speed_ratio")
        points = [] if speed is None else [float(point) for point in speed.each.split()]
        each = ", ".join(f"{point:.2f}" for point in points) or "–"
        numbers = (sample_text(own.get(name), look[name]["form"]) for name in MEASURES)
        rows.append([*cell, *numbers, _paces(paced.get(cell, ())), each])
    header = ["method", "engine", "ground", "friction", "command", *(look[name]["label"] for name in MEASURES)]
    header = [f"{name} [{UNITS[name]}]" if name in UNITS else name for name in header]
    return table([*header, "pace of the seeds", "speed ratio of each seed [1]"], rows, SAMPLES, grouped=True)


def _paces(seeds: Sequence[str]) -> str:
    """Return how many seeds have which pace under one command: `4 follow, 1 too fast`. seeds: the pace of each."""
    paces = [one.replace("follows", "follow") for one in seeds if one != "–"]
    return ", ".join(f"{paces.count(one)} {one}" for one in dict.fromkeys(paces)) or "–"


def budget_picture(figure: Figure, samples: Sequence[Sample] = ()) -> Markup:
    """Return the friction budget as a block; figure: as `draw_budget` drew it with these samples."""
    seeds = any(sample.low is not None for sample in samples)
    return figure_block(figure, f"{OVER_SEEDS if seeds else 'Mean over episodes.'} Below zero is the wrong way.")


def results_table(rows: Sequence[ResultRow], details: Sequence[dict[str, Any]] = (), gait: str | None = None) -> Markup:
    """Return every row as a table.

    `details`: the same rows as in summary.json, for the share of moving steps and for the friction that a coefficient
    came to; without them that column and those torques are left out. gait: heading of `TRIPOD`, see `_defined`.
    """
    lines = []
    for row, detail in zip(rows, details or [{}] * len(rows), strict=True):
        line = result_cells(row) | {"policy": row.policy, "engine": row.engine, "ground": row.terrain}
        line["friction"] = _level(row.friction_law, row.friction_level)
        if has_coefficient(row.friction_law) and detail.get("mean_friction") is not None:
            line["friction"] += f", {detail['mean_friction']:.2f} N m"
        line["falls"] += _interval(detail.get("fall_interval"))
        line[MOVING] = _share(detail.get("moving_share"))
        line["crossed"] = _share(detail.get("crossed")) + _interval(detail.get("crossed_interval"))
        lines.append(line)
    where = ["engine", "ground"] if _scenes(rows) != [DEFAULT] else []
    course = ["steps passed", "crossed"] if any(row.terrain != "flat" for row in rows) else []
    measured = [name for name, _ in _defined(rows, gait) if details or name != MOVING]
    header = ["policy", *where, "friction", "command", *measured, *course, "episodes"]
    named = {TRIPOD: gait or TRIPOD}
    shown = [f"{named.get(name, name)} [{UNITS[name]}]" if name in UNITS else name for name in header]
    return table(shown, [[line[name] for name in header] for line in lines], INTERVALS if details else "", grouped=True)


def definitions_table(rows: Sequence[ResultRow], gait: str | None = None) -> Markup:
    """Return the meaning of the columns of every evaluation; rows: those of the table."""
    meanings = [(gait or name if name == TRIPOD else name, meaning) for name, meaning in _defined(rows, gait)]
    return table(["column", "meaning"], meanings)


def _defined(rows: Sequence[ResultRow], gait: str | None = None) -> list[tuple[str, str]]:
    """Return `DEFINITIONS`, without the slowest walk where no row knows it, and a gait that no robot has.

    gait: its name, empty where there is none; None: unknown, then it is left out where no row has its share.
    """
    has_gait = any(row.tripod_share is not None for row in rows) if gait is None else gait != ""
    left_out = {SLOWEST_WALK: not tell_slowest_walk(rows), TRIPOD: not has_gait}
    return [(name, meaning) for name, meaning in DEFINITIONS if not left_out.get(name, False)]


def run_blocks(summary: dict[str, Any]) -> tuple[Markup, ...]:
    """Return what was run, on which policies and which machine."""
    policies = [
        (name, policy["method"], str(policy["seed"]), policy["revision"], policy["digest"][:16], policy["command"])
        for name, policy in summary["policies"].items()
    ]
    name = summary["evaluation"].get("friction_law", "coulomb")
    law = f"law {name}: {LAWS[name].meaning}"
    evaluation = {name: value for name, value in summary["evaluation"].items() if name != "noise"}
    fixed = [FIXED[name].format(value) for name, value in summary["conditions"].items()]
    where = f"Engines: {', '.join(summary['engines'])}. Grounds: {', '.join(summary['terrains'])}."
    robots = (VIRTUAL.format(", ".join(map(str, summary["robots"]))),) if summary["robots"] else ()
    forward = (FED_FORWARD,) if summary.get("forward") else ()
    return (
        paragraph(f"Command: {summary['command']}"),
        *(paragraph(text) for text in (where, *robots, *forward)),
        paragraph(f"{CONDITIONS.format(law)} {', '.join(fixed)}."),
        fold("Settings", [settings_table(evaluation)]),
        table(["policy", "method", "seed", "revision", "digest", "made by"], policies),
        paragraph(f"Revision {summary['revision']}, {summary['seconds']:.0f} s on {summary['machine']['cpu']}."),
        *((paragraph(again),) if (again := judged_text(summary)) else ()),
        paragraph("Everything here is simulation; one training seed is one sample. No robot was involved."),
    )


def _share(value: float | None) -> str:
    """Return a share as text, a dash where there is none."""
    return "–" if value is None else f"{value:.0%}"


def _level(law: str, level: float) -> str:
    """Return a level as text, with the law's name where it is not Coulomb's."""
    return level_text(law, level) if law == "coulomb" else f"{law} {level_text(law, level)}"


def _interval(ends: Sequence[float] | None) -> str:
    """Return an interval of a share as text in brackets; nothing where there is none."""
    return "" if ends is None else f" ({ends[0]:.0%} to {ends[1]:.0%})"
