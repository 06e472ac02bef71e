"""The page of the loop f0 -> log -> f_motor -> f1: what each policy reached on the virtual robots."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from stiction.files.results import ResultRow
from stiction.report.following import shade_following
from stiction.report.page import Section, figure_block, fold, legend, mark_look, new_figure, paragraph, table
from stiction_experiments.actuator.config import VARIANTS
from stiction_experiments.actuator.robots import FACTORS, FRICTION_FACTORS
from stiction_experiments.lab.files import row_of
from stiction_experiments.lab.study import Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NO_VERDICT = (
    "Mean speed over the commanded speed, over the commands that ask to move; falls: the largest rate of a command. "
    "The paper's f0 walked backward and fell forward, and its f1 failed in another simulator; it puts the limits of f1 "
    "down to data of backward walking, and of a single robot. One training seed a policy: these numbers describe these "
    "policies, and are no verdict on the method."
)

Row = dict[str, Any]


def report(result: dict[str, Any]) -> Report:
    """Return the report of the study, from what summary.json has of it."""
    rows, figure = result["rows"], draw(result["rows"])
    header, means = mean_table(rows, [robot["name"] for robot in result["robots"][1:]])
    lines = [f"{name}: {', '.join(map(' '.join, zip(header[1:], line, strict=True)))}" for name, *line in means]
    return Report(
        title="What does an Actuator Net learn from a walk?",
        lead="\n".join(lead(means)),
        tables={"results": [_named_by_robot(row) for row in rows]},
        sections=(
            Section("What was found", (table([header[0], *units(header[1:])], means), paragraph(NO_VERDICT))),
            Section("Speed reached", (figure_block(figure, CAPTION), fold(EVERY, [speed_table(rows)]))),
            Section("The Actuator Nets", (net_table(result["nets"]), cross_table(result["cross"]))),
            Section("The virtual robots", (paragraph(ROBOTS), robot_table(result["robots"]))),
        ),
        run=run_blocks(result),
        summary=result,
        figures={"speed": figure},
        answer=lines,
    )


def lead(means: Sequence[Sequence[str]]) -> list[str]:
    """Return what the first policy reaches, and what those trained through a net do. means: lines of `mean_table`."""
    (first, own, _, drawn, _, free, _), *others = means
    sentences = [
        f"A policy that was trained without joint friction ({first}) reaches {own} of the commanded speed on the robot "
        f"that was logged, {drawn} on other robots with friction, and {free} on one without."
    ]
    sentences += [
        f"Trained through an Actuator Net of {VARIANTS.get(name.partition('-')[2], 'its walks')} ({name}), it reaches "
        f"{own}, {drawn} and {free}."
        for name, own, _, drawn, _, free, _ in others
    ]
    return sentences


def _named_by_robot(row: Row) -> ResultRow:
    """Return the columns of results.csv, the robot in the name of the policy."""
    return row_of(row | {"policy": f"{row['policy']} on {row['robot']}"})


CAPTION = "Mean speed along the command over the commanded speed; after a fall the speed counts as zero."

EVERY = "Speed, error, falls and jitter, robot by robot"

ROBOTS = (
    "No robot was involved: virtual ones, in the evaluation's simulator, play the real one. robot-0 has the nominal "
    "joints and the study's dry friction; the others are drawn, motor strength, viscous friction and inertia within "
    f"{FACTORS[0]:g} to {FACTORS[1]:g} of nominal, dry friction within {FRICTION_FACTORS[0]:g} to "
    f"{FRICTION_FACTORS[1]:g} of robot-0's. None of it is in policies, logs and training."
)


def mean_table(rows: Sequence[Row], drawn: Sequence[str]) -> tuple[tuple[str, ...], list[list[str]]]:
    """Return header and lines of what each policy reached. drawn: names of the robots beside `robot-0`."""
    places = {
        "on robot-0": lambda row: row["robot"] == "robot-0" and row["friction_level"],
        "on the drawn robots": lambda row: row["robot"] in drawn and row["friction_level"],
        "without joint friction": lambda row: not row["friction_level"],
    }
    lines = []
    for policy in dict.fromkeys(row["policy"] for row in rows):
        line = [policy]
        for holds in places.values():
            own = [row for row in rows if row["policy"] == policy and holds(row)]
            ratios = [row["speed_ratio"] for row in own if row["speed_ratio"] is not None]
            speed = f"{sum(ratios) / len(ratios):.2f}" if ratios else "–"
            line += [speed, f"{max(row['fall_rate'] for row in own):.0%}" if own else "–"]
        lines.append(line)
    return ("policy", *(name for place in places for name in (place, "falls"))), lines


def units(places: Sequence[str]) -> list[str]:
    """Return names of columns with their units: of speeds over the commanded ones, and of falls."""
    return [f"{name} [{'% of walks' if name == 'falls' else '1'}]" for name in places]


def speed_table(rows: Sequence[Row]) -> Any:
    """Return every row."""
    cells = [
        [
            *(row["policy"], row["robot"], f"{100 * row['friction_level']:.3g} %", row["command"]),
            "–" if row["speed_ratio"] is None else f"{row['speed_ratio']:.2f}",
            *(f"{row['tracking_error']:.3f}", f"{row['fall_rate']:.0%}", f"{row['joint_jitter']:.0f}"),
            str(row["episodes"]),
        ]
        for row in rows
    ]
    header = ["policy", "robot", "friction [of τ_max]", "command", "speed ratio [1]", "error [m/s]"]
    header += ["falls [% of walks]", "jitter [rad/s²]", "episodes"]
    return table(header, cells, grouped=True)


def net_table(nets: dict[str, Any]) -> Any:
    """Return the errors of the nets beside the analytic law."""
    cells = []
    for name, net in nets.items():
        rmse = net["rmse"]
        values = [rmse[part][law] for law in ("net", "baseline") for part in ("training", "validation")]
        cells.append([name, *(f"{100 * value:.2f}" for value in values), str(net["samples"]["training"])])
    errors = [f"{name} [% of τ_max]" for name in ("net, fitted", "net, left out", "law, fitted", "law, left out")]
    return table(["data and inputs", *errors, "fitted [samples]"], cells, "Root mean square error of the torque.")


def cross_table(cross: dict[str, dict[str, float]]) -> Any:
    """Return how each net does on data of the others."""
    names = list(cross)
    cells = [[f"net of {name}", *(f"{100 * cross[name][other]:.2f}" for other in names)] for name in names]
    return table(
        ["", *(f"on {name} [% of τ_max]" for name in names)],
        cells,
        "The same error, on runs that a net was not fitted to.",
    )


def robot_table(robots: Sequence[dict[str, Any]]) -> Any:
    """Return the joints of the robots."""
    names = ("level", "strength", "damping", "armature")
    cells = [[robot["name"], *(f"{robot[name]:.3f}" for name in names)] for robot in robots]
    return table(
        [
            "robot",
            "friction [of τ_max]",
            *(f"{name} [of nominal]" for name in ("motor strength", "B", "rotor inertia")),
        ],
        cells,
    )


def run_blocks(result: dict[str, Any]) -> tuple[Any, ...]:
    """Return what was measured, and the policies with the nets that they were trained with."""
    rows = []
    for name, policy in result["policies"].items():
        net = policy["actuator"]
        used = f"{net['name']}, {net['sha256'][:16]}" if net else "none"
        rows.append((name, str(policy["seed"]), policy["revision"], policy["digest"][:16], used))
    return (
        paragraph(f"Torque was measured on the {result['options']['torque'].replace('_', ' ')}."),
        table(["policy", "seed", "revision", "digest", "Actuator Net"], rows),
    )


def draw(rows: Sequence[Row]) -> Figure:
    """Draw the speed ratio by robot, a panel for each command, a line for each policy."""
    commands = list(dict.fromkeys(row["command"] for row in rows if row["speed_ratio"] is not None))
    figure, axes = new_figure(1, max(1, len(commands)), size=(4.8 * max(1, len(commands)), 3.4))
    robots, policies = list(dict.fromkeys(map(_robot_label, rows))), list(dict.fromkeys(row["policy"] for row in rows))
    for axis, command in zip(axes, commands, strict=False):
        shade_following(axis)
        for policy in policies:
            points = [row for row in rows if (row["policy"], row["command"]) == (policy, command)]
            at = [robots.index(_robot_label(row)) for row in points]
            axis.plot(
                at, [row["speed_ratio"] for row in points], mark_look(policy, policies), markersize=5, label=policy
            )
        axis.set(title=f"commanded {command}", xticks=range(len(robots)))
        axis.set_xticklabels(robots, rotation=20, ha="right")
    if commands:
        axes[0].set_ylabel("speed reached / commanded")
        legend(axes[0])
    return figure


def _robot_label(row: Row) -> str:
    """Return the robot of a row, and its friction."""
    return f"{row['robot']}, {100 * row['friction_level']:.3g} %"
