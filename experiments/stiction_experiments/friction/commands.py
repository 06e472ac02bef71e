"""Write commands.csv, commands-ROBOT.csv and commands.md: commands that policies follow, by `stiction evaluate`.

    python -m stiction_experiments.friction.commands OUT RESULTS... [--advice FILE]

Each RESULTS has results.csv and summary.json. What OUT/commands.head.md says stands above the tables. FILE is what
`stiction identify` advises by: it gets the counts.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean

from stiction.files.advice import TRAINING, CommandCount, read_advice
from stiction.files.following import COMMAND_SET, CommandVerdict, judge_row, worst_command
from stiction.files.results import ResultRow, read_results, read_summary, write_results
from stiction.files.velocity import parse_command
from stiction_experiments.lab.files import write_source

Place = tuple[str, str]
"""Training method and engine."""

ENGINES = {
    "mujoco": "MuJoCo",
    "physx": "PhysX",
    "mujoco-alone+all 1000": "virtual robot 1000",
    "mujoco-alone+all 1001": "virtual robot 1001",
}
"""Engine, and virtual robot, as the page calls them."""


def label(rows: Sequence[ResultRow], engine: str) -> str:
    """Return how the page calls a place of so many rows."""
    return f"{ENGINES[engine]}, {rows[0].episodes} walks a cell"


def read_places(folders: Sequence[Path]) -> tuple[dict[Place, list[ResultRow]], list[str]]:
    """Return the rows of several evaluations by method and engine, and the command and revision of each."""
    places: dict[Place, list[ResultRow]] = {}
    origins = []
    for folder in folders:
        summary = read_summary(folder / "summary.json")
        robots = "".join(f" {robot}" for robot in summary["robots"])
        origins.append(f"`{summary['command']}` (revision `{summary['revision'][:12]}`)")
        for row in read_results(folder / "results.csv"):
            places.setdefault((row.method, row.engine + robots), []).append(row)
    return places, origins


def verdicts(rows: Sequence[ResultRow]) -> list[CommandVerdict]:
    """Return the verdicts of rows, which all have a mean velocity."""
    return [verdict for row in rows if (verdict := judge_row(row)) is not None]


def reached_text(rows: Sequence[ResultRow]) -> str:
    """Return how many policies follow and the reached ratio of each commanded axis, mean over policies."""
    command = parse_command(rows[0].command)
    count = f"{sum(verdict.follows for verdict in verdicts(rows))} of {len(rows)}"
    means = [command.axis_ratios(row.mean_velocity or (0.0, 0.0, 0.0)) for row in rows]
    ratios = [f"{fmean(values):.2f}" for values in zip(*means, strict=True)]
    return f"{count}: {', '.join(ratios)}" if ratios else count


def count_commands(places: dict[Place, list[ResultRow]]) -> list[CommandCount]:
    """Return the counts over all commands by method, engine and friction."""
    counts = []
    for (method, engine), rows in places.items():
        for level in sorted({row.friction_level for row in rows}):
            here = [row for row in rows if row.friction_level == level]
            policies = {row.policy for row in here}
            every = sum(worst_command(row for row in here if row.policy == name) is None for name in policies)
            followed = sum(verdict.follows for verdict in verdicts(here))
            worst = worst_command(here)
            named = f"{worst.row.command}, {', '.join(worst.faults)}" if worst else ""
            counts.append(CommandCount(method, engine, level, len(policies), every, len(here), followed, named))
    return counts


def summary_table(places: dict[Place, list[ResultRow]]) -> list[str]:
    """Return the table of policies that follow every command, by place and friction."""
    lines = [
        "| trained | where | friction | policies that follow all | cells followed | worst |",
        "|---|---|---|---|---|---|",
    ]
    for count in count_commands(places):
        where, share = label(places[count.method, count.engine], count.engine), f"{100 * count.friction_level:.0f} %"
        lines.append(
            f"| `{count.method}` | {where} | {share} | {count.follow_all} of {count.seeds} | {count.followed} "
            f"of {count.cells} | {count.worst or '–'} |"
        )
    return lines


def command_table(rows: Sequence[ResultRow]) -> list[str]:
    """Return the table of one place: commands against friction."""
    levels = sorted({row.friction_level for row in rows})
    lines = [
        "| command | " + " | ".join(f"{100 * level:.0f} %" for level in levels) + " |",
        "|---" * (len(levels) + 1) + "|",
    ]
    for command in COMMAND_SET:
        cells = [[row for row in rows if (row.command, row.friction_level) == (command, level)] for level in levels]
        lines.append(f"| `{command}` | " + " | ".join(map(reached_text, cells)) + " |")
    return lines


def main() -> None:
    """Write both files, and the counts into the advice where it is named."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("out", type=Path, help="folder of commands.csv and commands.md")
    parser.add_argument("results", type=Path, nargs="+", help="folders of `stiction evaluate`")
    parser.add_argument("--advice", type=Path, help="advice.json, which gets the counts")
    cfg = parser.parse_args()
    places, origins = read_places(cfg.results)
    parts = [(cfg.out / "commands.head.md").read_text(), *summary_table(places), ""]
    for (method, engine), rows in places.items():
        parts += [f"## `{method}`, {label(rows, engine)}", "", *command_table(rows), ""]
    parts += ["## Made by", "", *(f"* {origin}" for origin in origins), ""]
    (cfg.out / "commands.md").write_text("\n".join(parts))
    # Rows do not name their virtual robot: each has a file of its own.
    for robot in {engine.partition(" ")[2] for _, engine in places}:
        rows = [row for (_, engine), own in places.items() if engine.partition(" ")[2] == robot for row in own]
        write_results(cfg.out / f"commands{robot and '-'}{robot}.csv", rows)
    if cfg.advice is not None:
        source = read_advice(cfg.advice)[TRAINING]
        write_source(cfg.advice, TRAINING, replace(source, commands=tuple(count_commands(places))))


if __name__ == "__main__":
    main()
