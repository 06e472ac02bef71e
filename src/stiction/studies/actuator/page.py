"""The page of the loop f0 -> log -> f_motor -> f1: what each policy reached on the virtual robots, and what follows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from stiction.formats.results import FOLLOWS, ResultRow
from stiction.report.page import (
    COLORS,
    Section,
    bullets,
    figure_uri,
    legend,
    new_figure,
    paragraph,
    picture,
    table,
)
from stiction.studies.actuator.robots import FACTORS, FRICTION_FACTORS
from stiction.studies.study import Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CLOSE = 0.1
"""Speed ratios within this of each other are not called different [-]."""

NO_VERDICT = (
    "One training seed a policy: these sentences describe these policies, and are no verdict on the method. A "
    "difference that another seed could make is not told from one that the data made."
)

Row = dict[str, Any]


def report(found: dict[str, Any]) -> Report:
    """Return the report of the study, from what summary.json has of it."""
    rows, said = found["rows"], findings(found)
    figure = draw(rows)
    return Report(
        title="Actuator Net: f0, log, f_motor, f1",
        lead=said[0],
        tables={"results": [result_row(row) for row in rows]},
        sections=(
            Section("What was found", (bullets(said), paragraph(NO_VERDICT))),
            Section("Speed reached", (picture(figure_uri(figure), CAPTION), speed_table(rows))),
            Section("The Actuator Nets", (net_table(found["nets"]), cross_table(found["cross"]))),
            Section("The virtual robots", (paragraph(ROBOTS), robot_table(found["robots"]))),
        ),
        run=run_blocks(found),
        summary=found,
        figures={"speed": figure},
    )


def result_row(row: Row) -> ResultRow:
    """Return a row of results.csv: the robot is in the name of the policy."""
    own = {key: value for key, value in row.items() if key != "robot"}
    return ResultRow(**own | {"policy": f"{row['policy']} on {row['robot']}"})


CAPTION = "Mean speed along the command over the commanded speed; after a fall the speed counts as zero."

ROBOTS = (
    "No robot was involved: virtual ones, in the evaluation's simulator, play the real one. robot-0 has the nominal "
    "joints and the study's dry friction; the others are drawn, motor strength, viscous friction and inertia within "
    f"{FACTORS[0]:g} to {FACTORS[1]:g} of nominal, dry friction within {FRICTION_FACTORS[0]:g} to "
    f"{FRICTION_FACTORS[1]:g} of robot-0's. Policies, logs and training know none of it."
)


def pick(rows: Sequence[Row], policy: str, robot: str, friction: bool, command: str) -> Row | None:
    """Return the row of a policy on a robot, with its friction or without, under a command."""
    for row in rows:
        if (row["policy"], row["robot"], row["command"]) == (policy, robot, command) and friction == bool(
            row["friction_level"]
        ):
            return row
    return None


def mean_ratio(rows: Sequence[Row], policy: str, robots: Sequence[str], friction: bool = True) -> float:
    """Return the mean speed ratio over robots and commands that ask to move; NaN where there is no such row."""
    values = [
        row["speed_ratio"]
        for row in rows
        if row["policy"] == policy
        and row["robot"] in robots
        and bool(row["friction_level"]) == friction
        and row["speed_ratio"] is not None
    ]
    return sum(values) / len(values) if values else float("nan")


def compared(first: float, second: float) -> str:
    """Say how the first number stands to the second."""
    if abs(first - second) <= CLOSE:
        return "about as much as"
    return "more than" if first > second else "less than"


def findings(summary: dict[str, Any]) -> list[str]:
    """Return sentences that follow from the numbers, on each thing that the paper says of the loop."""
    rows = summary["rows"]
    policies, commands = (
        list(dict.fromkeys(row["policy"] for row in rows)),
        list(dict.fromkeys(row["command"] for row in rows)),
    )
    drawn = [robot["name"] for robot in summary["robots"][1:]]
    said = [f"f0 on robot-0: {_reached(rows, 'f0', commands)}; the paper's walked backward and fell forward."]
    for policy in policies[1:]:
        before, after = mean_ratio(rows, "f0", ["robot-0"]), mean_ratio(rows, policy, ["robot-0"])
        said.append(
            f"{policy} on robot-0: {_reached(rows, policy, commands)}; on average {after:.2f} of the commanded speed, "
            f"{compared(after, before)} f0's {before:.2f}."
        )
    pairs = (("f1-everywhere", ["robot-0"], "robot-0"), ("f1-three-robots", drawn, "the drawn robots"))
    for policy, robots, where in pairs:
        if {policy, "f1-backward"} <= set(policies):
            ours, paper = mean_ratio(rows, policy, robots), mean_ratio(rows, "f1-backward", robots)
            said.append(
                f"On {where}, {policy} reaches {ours:.2f}, {compared(ours, paper)} f1-backward's {paper:.2f}; the "
                f"paper blames its limits on {'backward data' if where == 'robot-0' else 'data of a single robot'}."
            )
    for policy in policies:
        ratio = mean_ratio(rows, policy, ["robot-0"], friction=False)
        falls = [r["fall_rate"] for r in rows if r["policy"] == policy and not r["friction_level"]]
        said.append(
            f"Without joint friction {policy} reaches {ratio:.2f} and falls in {max(falls):.0%} of episodes at worst; "
            "the paper's f1 failed in its other simulator."
            if policy != "f0"
            else f"Without joint friction f0 reaches {ratio:.2f}."
        )
    said.append(_nets_sentence(summary["nets"]))
    return said


def _reached(rows: Sequence[Row], policy: str, commands: Sequence[str]) -> str:
    """Say what a policy reached on the study's robot, command by command."""
    parts = []
    for command in commands:
        row = pick(rows, policy, "robot-0", True, command)
        if row is not None:
            reached = "stands" if row["speed_ratio"] is None else f"{row['speed_ratio']:.2f} of the speed"
            parts.append(f"{reached} at {command}, falls in {row['fall_rate']:.0%} of episodes")
    return "; ".join(parts)


def _nets_sentence(nets: dict[str, Any]) -> str:
    """Say how the two sets of inputs compare with the analytic law on runs that were kept out."""
    parts = []
    for name, net in nets.items():
        error, law = (100 * net["rmse"]["validation"][key] for key in ("net", "baseline"))
        parts.append(f"{name} {error:.1f} %, law {law:.1f} %")
    return "Error of the nets on runs kept out, of the torque limit, beside PD with fitted friction: " + "; ".join(
        parts
    )


def speed_table(rows: Sequence[Row]) -> Any:
    """Return every row."""
    cells = [
        [
            row["policy"],
            row["robot"],
            f"{100 * row['friction_level']:.3g} %",
            row["command"],
            "–" if row["speed_ratio"] is None else f"{row['speed_ratio']:.2f}",
            f"{row['tracking_error']:.3f}",
            f"{row['fall_rate']:.0%}",
            f"{row['joint_jitter']:.0f}",
            str(row["episodes"]),
        ]
        for row in rows
    ]
    header = ["policy", "robot", "friction", "command", "speed ratio", "error [m/s]", "falls", "jitter", "episodes"]
    return table(header, cells)


def net_table(nets: dict[str, Any]) -> Any:
    """Return the errors of the nets beside the analytic law."""
    cells = []
    for name, net in nets.items():
        rmse = net["rmse"]
        values = [rmse[part][law] for law in ("net", "baseline") for part in ("training", "validation")]
        cells.append([name, *(f"{100 * value:.2f}" for value in values), str(net["samples"]["training"])])
    header = ["data and inputs", "net, fitted", "net, kept out", "law, fitted", "law, kept out", "samples fitted"]
    return table(header, cells, "Root mean square error of the torque, % of the limit.")


def cross_table(cross: dict[str, dict[str, float]]) -> Any:
    """Return how each net does on data of the others."""
    names = list(cross)
    cells = [[f"net of {name}", *(f"{100 * cross[name][other]:.2f}" for other in names)] for name in names]
    return table(
        ["", *(f"on {name}" for name in names)], cells, "The same error, on runs that a net was not fitted to."
    )


def robot_table(robots: Sequence[dict[str, Any]]) -> Any:
    """Return the joints of the robots."""
    names = ("level", "strength", "damping", "armature")
    cells = [[robot["name"], *(f"{robot[name]:.3f}" for name in names)] for robot in robots]
    return table(["robot", "friction over limit", "motor strength", "viscous friction", "rotor inertia"], cells)


def run_blocks(found: dict[str, Any]) -> tuple[Any, ...]:
    """Return what was measured, and the policies."""
    rows = [
        (name, str(policy["seed"]), policy["revision"], policy["digest"][:16], _net_of(policy))
        for name, policy in found["policies"].items()
    ]
    return (
        paragraph(f"Torque was measured on the {found['options']['torque'].replace('_', ' ')}."),
        table(["policy", "seed", "revision", "digest", "Actuator Net"], rows),
    )


def _net_of(policy: dict[str, Any]) -> str:
    """Return the net that a policy was trained with."""
    net = policy["actuator"]
    return f"{net['name']}, {net['sha256'][:16]}" if net else "none"


def draw(rows: Sequence[Row]) -> Figure:
    """Draw the speed ratio by robot, a panel for each command, a line for each policy."""
    commands = list(dict.fromkeys(row["command"] for row in rows if row["speed_ratio"] is not None))
    figure, axes = new_figure(1, max(1, len(commands)), size=(4.8 * max(1, len(commands)), 3.4))
    places = list(dict.fromkeys(map(_place, rows)))
    for axis, command in zip(axes, commands, strict=False):
        axis.axhspan(*FOLLOWS, color=COLORS[2], alpha=0.12, linewidth=0)
        for policy in dict.fromkeys(row["policy"] for row in rows):
            points = [row for row in rows if (row["policy"], row["command"]) == (policy, command)]
            at = [places.index(_place(row)) for row in points]
            axis.plot(at, [row["speed_ratio"] for row in points], "o", markersize=5, label=policy)
        axis.set(title=f"commanded {command}", xticks=range(len(places)))
        axis.set_xticklabels(places, rotation=20, ha="right")
    if commands:
        axes[0].set_ylabel("speed reached / commanded")
        legend(axes[0])
    return figure


def _place(row: Row) -> str:
    """Return where a row was measured."""
    return f"{row['robot']}, {100 * row['friction_level']:.3g} %"
