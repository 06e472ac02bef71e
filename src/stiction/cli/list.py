"""`stiction list [robots|policies|engines|faults]`: what there is by name, without a file of yours."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from stiction.core.extras import install_command, installed_by, installed_from, is_installed, outdated
from stiction.core.flags import ARGUMENT
from stiction.core.options import read_options

DESCRIPTION = """List what comes with the package, by the names that other verbs take.

Examples:
  stiction list
  stiction list policies
  stiction list engines --json"""


@dataclass(frozen=True)
class ListCfg:
    """Options of the verb."""

    what: Annotated[Literal["all", "robots", "policies", "engines", "faults"], ARGUMENT] = "all"
    """Kind of listing; `all` is all but the faults."""
    json: bool = False
    """Print the list as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Run the verb."""
    cfg = read_options(ListCfg, arguments, "stiction list", DESCRIPTION)
    kinds = [name for name in KINDS if name != "faults"] if cfg.what == "all" else [cfg.what]
    listing = {name: KINDS[name][0]() for name in kinds}
    if cfg.json:
        print(json.dumps(listing, indent=2))
        return 0
    from rich.table import Table

    from stiction.report.terminal import Terminal

    for name, rows in listing.items():
        table = Table(*KINDS[name][1])
        table.columns[0].no_wrap = True
        for row in rows:
            table.add_row(*map(_cell, row.values()))
        if rows:
            Terminal().print(table)
    return 0


def _cell(value: Any) -> str:
    """Return a value as a cell of the table: of several how many."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return str(len(value)) if isinstance(value, list) else f"{value:.4g}" if isinstance(value, float) else str(value)


def robots() -> list[dict[str, Any]]:
    """Return the shipped robots: mass [kg], joints that move, feet that it stands on."""
    from stiction.robots.catalog import find_robot, robot_names

    return [
        {"name": robot.name, "mass": robot.mass, "joints": [*robot.joint_names], "feet": [*robot.foot_names]}
        for robot in map(find_robot, robot_names())
    ]


def policies() -> list[dict[str, Any]]:
    """Return the shipped policies: the robot and the ground of their training, and the friction of its joints."""
    from stiction.files.bundle import read_bundle, shipped_bundles

    contracts = {name: read_bundle(path).contract for name, path in shipped_bundles().items()}
    return [
        {"name": name, "robot": policy.robot, "terrain": policy.terrain, "training": policy.trained}
        for name, policy in contracts.items()
    ]


def engines() -> list[dict[str, Any]]:
    """Return the shipped engines, whether each can be used here, and else how to have it."""
    from stiction.engines.catalog import ENGINES

    rows, source, program = [], installed_from(), installed_by()
    for spec in ENGINES.values():
        here = all(binary is not None for binary in spec.binaries().values())
        old = outdated(spec.extra) if spec.extra else None
        here = here and is_installed(PACKAGES.get(spec.name, "stiction")) and old is None
        install = old or (install_command(spec.extra, source, program) if spec.extra and not here else "–")
        rows.append({"name": spec.name, "here": here, "install": install})
    return rows


def faults() -> list[dict[str, Any]]:
    """Return the faults that `stiction deploy --fault` tries, each with what happens."""
    from stiction.virtual.faults import FAULTS

    return [{"name": name, "what": what} for name, what in FAULTS.items()]


PACKAGES = {"mujoco": "mujoco", "physx": "sapien"}
"""Engine -> the Python package that it needs; the others need a library alone."""

KINDS = {
    "robots": (robots, ("robot", "mass [kg]", "joints", "feet")),
    "policies": (policies, ("policy", "robot", "ground", "friction in training")),
    "engines": (engines, ("engine", "installed", "if not: install it by")),
    "faults": (faults, ("fault, --fault NAME@SECOND", "what happens")),
}
"""Kind of listing -> the function that returns its rows, and the headings of its table."""
