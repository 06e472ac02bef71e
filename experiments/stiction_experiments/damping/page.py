"""The page of the study of damping: where B and k kd are one number to a joint's motion, and where not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from stiction.report.page import (
    COLORS,
    Section,
    figure_block,
    fold,
    legend,
    new_figure,
    paragraph,
    row_table,
    table,
)
from stiction_experiments.damping.joint import (
    ALL,
    EFFORT,
    FILTERED,
    FRICTION,
    HALF,
    LATE,
    LEVELS,
    LIMIT,
    MORE_VISCOUS,
    SHARP,
    DrawRow,
    NetRow,
    RobotRow,
    SwapRow,
    angle_text,
)
from stiction_experiments.damping.robot import FIRST, LIFTED, MOVED, TWIN
from stiction_experiments.lab.study import Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def swap_table(rows: Sequence[SwapRow]) -> Markup:
    """Return the differences as a table: robot, case and level down, swaps across."""
    names = [f"{name} [rad]" for name in dict.fromkeys(row.swap for row in rows)]
    cells: dict[tuple[str, str, float], list[str]] = {}
    for row in rows:
        cells.setdefault((row.robot, row.case, row.level), []).append(angle_text(row.position_difference))
    lines = [[f"{robot}, {case}", f"{level:g}", *sizes] for (robot, case, level), sizes in cells.items()]
    caption = f"Largest difference of the angle. Levels: {'; '.join(f'{k}: {v}' for k, v in LEVELS.items())}."
    return table(["joint and case", "level [of its case]", *names], lines, caption)


def stability_table(rows: Sequence[SwapRow]) -> Markup:
    """Return how the sampled loops grow, before and after all of k kd went to B."""
    lines = [
        [f"{row.robot}, {row.case}", f"{row.level:g}", f"{row.growth:.3f}", f"{row.growth_swapped:.3f}"]
        for row in rows
        if row.growth is not None and row.growth_swapped is not None and row.swap == ALL
    ]
    return table(["joint and case", "period [s]", "with kd [1]", "with B [1]"], lines)


FLOOR = 1e-16
"""Where a difference of exactly zero is drawn [rad]."""

PANELS = (
    ((FRICTION, EFFORT), "dry friction, over torque limit or drive torque"),
    ((LIMIT,), "torque limit, over largest torque asked for"),
    ((SHARP, LATE, FILTERED), "control period [s]"),
)
"""Cases and horizontal axis of each panel."""


TABLES: dict[str, Any] = {"swaps": SwapRow, "nets": NetRow, "draws": DrawRow, "robots": RobotRow}
"""Name of a CSV -> its rows."""


@dataclass(frozen=True)
class DampingResult:
    """All that the study found."""

    swaps: tuple[SwapRow, ...]
    nets: tuple[NetRow, ...]
    draws: tuple[DrawRow, ...]
    robots: tuple[RobotRow, ...]


def report(result: DampingResult, settings: dict[str, Any]) -> Report:
    """Return the report of the study. settings: `study`, `walk`, `seconds`."""
    figure, answer, study = draw_swaps(result.swaps), lead(result), settings["study"]
    return Report(
        title="Are viscous friction and derivative gain one number?",
        lead=answer,
        tables=vars(result),
        sections=sections(result, figure, study),
        run=(paragraph(JOINTS.format(**study)),),
        summary=settings | {"lead": answer} | {name: list(map(asdict, rows)) for name, rows in vars(result).items()},
        figures={"damping": figure},
    )


def draw_swaps(rows: Sequence[SwapRow]) -> Figure:
    """Return the largest difference of the angle over each case's level; with more viscous friction dashed."""
    robots = list(dict.fromkeys(row.robot for row in rows))
    figure, axes = new_figure(len(robots), len(PANELS), size=(4.2 * len(PANELS), 3.1 * len(robots)))
    for index, axis in enumerate(axes):
        robot, (cases, label) = robots[index // len(PANELS)], PANELS[index % len(PANELS)]
        for case, color in zip(cases, COLORS, strict=False):
            for swap, style in ((HALF, "-"), (MORE_VISCOUS, "--")):
                chosen = [row for row in rows if (row.robot, row.case, row.swap) == (robot, case, swap)]
                heights = [max(row.position_difference, FLOOR) for row in chosen]
                name = case if style == "-" else None
                axis.plot([r.level for r in chosen], heights, style, color=color, marker="o", markersize=3, label=name)
        axis.set(title=robot, xlabel=label, yscale="log", ylim=(FLOOR / 3, 30.0))
        if cases == (LIMIT,):
            axis.invert_xaxis()
        if SHARP in cases:
            axis.set_xscale("log")
        legend(axis)
        if index % len(PANELS) == 0:
            axis.set_ylabel("largest difference of the angle [rad]")
    return figure


def lead(result: DampingResult) -> str:
    """Return the largest differences of the angle with dry friction, without a saturated motor, and with one."""
    friction = [row for row in result.swaps if row.case == FRICTION]
    differences = (
        max(row.position_difference for row in friction),
        max(row.free_difference for row in result.robots if row.free_difference is not None),
        max((row.limited_difference for row in result.robots if row.limited_difference is not None), default=0.0),
    )
    joint, free, limited = map(angle_text, differences)
    one_number = max(differences[:2]) < ROUNDING < differences[2]
    return (
        f"{ONE_NUMBER if one_number else ''}Damping moved from the derivative gain kd to the viscous friction B, at "
        f"the same B + k·kd, changes an angle by at most {joint} rad in one exactly simulated joint with dry friction "
        f"up to {100 * max(row.level for row in friction):g} % of the torque limit, {free} rad in whole robots whose "
        f"motors stay under their limits, and {limited} rad in those that reach one."
    )


ROUNDING = 1e-9
"""Differences of an angle under it are those of rounding [rad]."""

ONE_NUMBER = "They are one number while the motor stays under its torque limit, and two where it reaches it.\n"


def sections(result: DampingResult, figure: Figure, study: dict[str, Any]) -> list[Section]:
    """Return the sections of the page. study: settings of the joint's study."""
    shown = figure_block(figure, CAPTION.format(sampled=1000 * study["step"]))
    folds = (
        fold("Every difference", [swap_table(result.swaps)]),
        fold("Stability of the loops", [stability_table(result.swaps)]),
    )
    draws = DRAWS.format(low=1 - study["spread"], high=1 + study["spread"])
    return [
        Section("One joint", (paragraph(JOINT), shown)),
        Section("Why", (paragraph(READING), *folds)),
        Section("Whole robots, in the simulator of the training", (paragraph(ROBOTS), row_table(result.robots))),
        Section("What it means for randomisation", (paragraph(draws), row_table(result.draws))),
        Section("What it means for an Actuator Net", (paragraph(NETS), row_table(result.nets))),
    ]


JOINT = (
    "I θ'' + B θ' = k (kp (a − θ) − kd θ') + f has B and kd in it as B + k·kd alone, whatever f(θ') is. Each point "
    "is the same joint simulated twice, before and after damping was moved from kd to B: half of k·kd (solid), or as "
    f"much as the paper's randomisation adds at most, {MORE_VISCOUS} (dashed). The exact simulation adds the two "
    "numbers before it computes, so its difference under dry friction is zero by construction; the checks from outside "
    "are the sampled controller, whose difference falls with its period, and the robots further down."
)
CAPTION = (
    f"Largest difference of the angle within the motion; {FLOOR:g} stands for exactly zero. Differences of the size of "
    "the motion itself, at long periods, are unstable controllers. Friction by effort is simulated with a controller "
    "sampled every {sampled:g} ms."
)
READING = (
    "A torque limit cuts kp (a − θ) − kd θ' as a whole and leaves B alone; a swap towards B also asks for more torque, "
    "and so reaches the limit first. A sampled controller holds its torque: it acts half a period late, and later with "
    "a late or filtered velocity, which to first order takes k·kd times the delay off the inertia. B is never late. "
    "With long periods kd makes the loop unstable and B cannot. Friction that grows with the drive torque (c |τ|) "
    "depends on kd, which is in τ, and not on B. Folded: all numbers, and the factor by which the sampled loop grows "
    "in a period (above 1 it is unstable), as it is and with all of k·kd moved to B."
)
ROBOTS = (
    "MuJoCo with the training's physics step and implicit integration, which treats joint damping and controller "
    f"damping as two things. {MOVED:.0%} of kd was moved to B in every joint. Robots that reached no torque limit "
    f"within the first {FIRST:g} s (under) are counted apart from those that did (at limit); lifted limits are "
    f"{LIFTED:g} times as high. Twins start {TWIN:g} rad apart and have no swap: what contacts do to rounding."
)
DRAWS = (
    "B and kd both drawn (multipliers of {low:g} to {high:g}), kd alone drawn so that B + k·kd is the same number "
    "joint by joint, and B alone drawn over its own {low:g} to {high:g}. Spread is what a policy would meet: the "
    "standard deviation of the angle. Pairs is the largest difference between joints of the same sum."
)
NETS = (
    "A linear net, torque = w1 (a − θ) − w2 θ', fitted by least squares to the torque of a logged joint, then put into "
    "a simulated joint in place of the PD law. Motor side: the torque before B and friction take their share, the "
    "simulation keeps dry friction; Output side: what is left after them, the simulation has none. B of the "
    "simulation is the logged joint's own, one with half of k·kd more (a swapped partner's, whose motion was the "
    "same), or none."
)
JOINTS = (
    "Joints: those of the robots' specifications, without links, at their measured dry friction unless said otherwise; "
    "target: {amplitude:g} rad at {frequency:g} Hz, held for {hold:g} s. Everything here is simulation."
)
