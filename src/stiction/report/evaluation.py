"""The results of an evaluation as files: results.csv, summary.json, the friction budget, and a page."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from stiction.formats.errors import StictionError
from stiction.formats.folder import make_folder
from stiction.formats.friction import LAWS, has_coefficient, level_axis, level_number, level_text
from stiction.formats.results import ResultRow, write_results, write_summary
from stiction.report.page import INK, Section, figure_uri, legend, new_figure, paragraph, picture, render_page, table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GOOD = (0.8, 1.2)
"""Speed ratios that count as following the command [-]."""

MOVING = "moving"
"""Column that results.csv does not have; it comes from summary.json."""

DEFINITIONS = (
    ("speed ratio", "mean speed along the command over the commanded speed; after a fall the speed counts as zero"),
    ("error", "mean distance of velocity and command, over windows of 1 s, in m/s (in rad/s for a pure turn)"),
    ("falls", "share of episodes with a fall; a simulation that became unstable counts as one"),
    ("jitter", "root mean square joint acceleration, from velocities at the control rate, in rad/s²"),
    ("cost of transport", "mechanical energy over weight times distance; a dash where the robot does not get away"),
    (
        "tripod",
        "share of moving steps in which the feet on the ground are exactly one contact group, no foot more or less",
    ),
    ("flight", "share of moving steps with no foot on the ground; a dash where the robot does not move"),
    (MOVING, "share of all steps in which the robot moves, what tripod and flight are shares of; none after a fall"),
)
"""What the columns mean, in the order of the table."""


CONDITIONS = (
    "MuJoCo, flat ground, dry friction in every joint ({}), sensor noise as in training. The joints' inertia, viscous "
    "friction and gains are the nominal ones of the policy's training, masses those of the robot's specification. "
    "All of these are held fixed here, while training randomises them; so are:"
)
"""What was not varied."""

FIXED = {
    "action_delay": "action delay {:g} s",
    "encoder_offset": "encoder offset {:g} rad",
    "ground_friction": "ground friction {:g}",
    "push_velocity": "pushes of {:g} m/s",
    "payload": "payload {:g} kg",
}
"""Words for the entries of the summary's `conditions`."""


def write_evaluation(out: Path, rows: Sequence[ResultRow], summary: dict[str, Any]) -> Path:
    """Write every file of an evaluation into `out`; return the path of the page.

    Raises:
        StictionError: the directory cannot be made or written.

    """
    figure = draw_budget(rows)
    make_folder(out)
    try:
        write_results(out / "results.csv", rows)
        write_summary(out / "summary.json", summary)
        for kind in ("svg", "png"):
            figure.savefig(out / f"friction_budget.{kind}", dpi=150, facecolor="white")
        page = out / "report.html"
        page.write_text(render_page("Speed over joint friction", sections(rows, summary), lead(rows)), encoding="utf-8")
    except OSError as error:
        raise StictionError(f"the results cannot be written to {out}: {error}; choose another --out") from error
    return page


def draw_budget(rows: Sequence[ResultRow]) -> Figure:
    """Return the friction budget: speed ratio over friction level, a line for each policy.

    There is a panel for each command, and for each law: their levels have different units.
    """
    panels = list(dict.fromkeys((row.friction_law, row.command) for row in rows if row.speed_ratio is not None))
    figure, axes = new_figure(1, max(1, len(panels)), size=(4.6 * max(1, len(panels)), 3.4))
    for axis, (law, command) in zip(axes, panels, strict=False):
        axis.axhspan(*GOOD, color="#4c9f70", alpha=0.12, linewidth=0)
        axis.axhline(0.0, color=INK, linewidth=0.8)
        for policy in _unique(row.policy for row in rows):
            points = [row for row in rows if (row.policy, row.friction_law, row.command) == (policy, law, command)]
            points.sort(key=lambda row: row.friction_level)
            levels = [level_number(law, row.friction_level) for row in points]
            axis.plot(levels, [row.speed_ratio for row in points], marker="o", markersize=4, label=policy)
        axis.set(title=f"commanded {command}", xlabel=level_axis(law))
    if panels:
        axes[0].set_ylabel("speed reached / commanded")
        legend(axes[0])
    return figure


def follows(row: ResultRow) -> bool:
    """Say whether a row's policy followed its command: within `GOOD`, and nobody fell."""
    return row.speed_ratio is not None and GOOD[0] <= row.speed_ratio <= GOOD[1] and row.fall_rate == 0.0


def lead(rows: Sequence[ResultRow]) -> str:
    """Return the answer in a sentence for each policy: up to which level it follows all linear and turn commands."""
    sentences = []
    for policy in _unique(row.policy for row in rows):
        levels: dict[tuple[str, float], bool] = {}
        for row in rows:
            if row.policy == policy and row.speed_ratio is not None:
                level = row.friction_law, row.friction_level
                levels[level] = levels.get(level, True) and follows(row)
        good = [_level(*level) for level, all_followed in sorted(levels.items()) if all_followed]
        tested = ", ".join(_level(*level) for level in sorted(levels))
        sentences.append(
            f"{policy} follows every command without a fall at {', '.join(good)}" if good else f"{policy} does at none"
        )
        sentences[-1] += f" of the tested levels {tested}." if levels else ": none asked it to move."
    return " ".join(sentences) + f" Following means {GOOD[0]:.0%} to {GOOD[1]:.0%} of the commanded speed."


def sections(rows: Sequence[ResultRow], summary: dict[str, Any]) -> list[Section]:
    """Return the sections of the page: figure, table, definitions, what was run."""
    return [
        Section("Friction budget", (budget_picture(rows),)),
        Section("Every row", (results_table(rows, summary["rows"]), definitions_table())),
        Section("What was run", run_blocks(summary)),
    ]


def budget_picture(rows: Sequence[ResultRow]) -> Markup:
    """Return the friction budget as a block."""
    caption = "Mean over episodes. The green band is 80 to 120 % of the commanded speed; below zero is the wrong way."
    return picture(figure_uri(draw_budget(rows)), caption)


def results_table(rows: Sequence[ResultRow], details: Sequence[dict[str, Any]] = ()) -> Markup:
    """Return every row as a table.

    `details`: the same rows as in summary.json, for the share of moving steps and for the friction that a coefficient
    came to; without them that column and those torques are left out.
    """
    names = [name for name, _ in DEFINITIONS if details or name != MOVING]
    cells = [_cells(row) for row in rows]
    for line, row, detail in zip(cells, rows, details, strict=bool(details)):
        line.insert(-1, _number(detail["moving_share"], ".0%"))
        if has_coefficient(row.friction_law) and detail.get("mean_friction") is not None:
            line[1] += f", {detail['mean_friction']:.2f} N m"
    return table(["policy", "friction", "command", *names, "episodes"], cells)


def definitions_table() -> Markup:
    """Return the meaning of every column."""
    return table(["column", "meaning"], DEFINITIONS)


def run_blocks(summary: dict[str, Any]) -> tuple[Markup, ...]:
    """Return what was run, on which policies and which machine."""
    policies = [
        (name, policy["method"], str(policy["seed"]), policy["revision"], policy["digest"][:16], policy["command"])
        for name, policy in summary["policies"].items()
    ]
    name = summary["evaluation"].get("friction_law", "coulomb")
    law = f"law {name}: {LAWS[name]}"
    evaluation = {name: value for name, value in summary["evaluation"].items() if name != "noise"}
    fixed = [FIXED[name].format(value) for name, value in summary["conditions"].items()]
    return (
        paragraph(f"Command: {summary['command']}"),
        paragraph(f"{CONDITIONS.format(law)} {', '.join(fixed)}."),
        paragraph(f"Settings: {json.dumps(evaluation)}"),
        table(["policy", "method", "seed", "revision", "digest", "made by"], policies),
        paragraph(f"Revision {summary['revision']}, {summary['seconds']:.0f} s on {summary['machine']['cpu']}."),
        paragraph("Everything here is simulation; one training seed is one sample. No robot was involved."),
    )


def _cells(row: ResultRow) -> list[str]:
    """Return one row as text."""
    return [
        row.policy,
        _level(row.friction_law, row.friction_level),
        row.command,
        _number(row.speed_ratio, ".2f"),
        _number(row.tracking_error, ".3f"),
        _number(row.fall_rate, ".0%"),
        _number(row.joint_jitter, ".0f"),
        _number(row.cost_of_transport, ".2f"),
        _number(row.tripod_share, ".0%"),
        _number(row.flight_share, ".0%"),
        str(row.episodes),
    ]


def _number(value: float | None, form: str) -> str:
    """Return a number as text, a dash where there is none."""
    return "–" if value is None else format(value, form)


def _level(law: str, level: float) -> str:
    """Return a level as text, with the law's name where it is not Coulomb's."""
    return level_text(law, level) if law == "coulomb" else f"{law} {level_text(law, level)}"


def _unique(values: Iterable[str]) -> list[str]:
    """Return each value once, in the order of first appearance."""
    return list(dict.fromkeys(values))
