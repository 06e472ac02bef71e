"""`stiction list [robots|policies|engines]`: what there is by name, without a file of yours."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, Literal

from stiction.core.extras import install_command, installed_by, installed_from, is_installed
from stiction.core.flags import ARGUMENT
from stiction.core.options import read_options
from stiction.core.records import column, header, texts

DESCRIPTION = """List what comes with the package, by the names that other verbs take.

Examples:
  stiction list
  stiction list policies
  stiction list engines --json"""


@dataclass(frozen=True)
class ListCfg:
    """Options of the verb."""

    what: Annotated[Literal["all", "robots", "policies", "engines"], ARGUMENT] = "all"
    """What to list."""
    json: bool = False
    """Print the list as JSON on standard output, and nothing else."""


@dataclass(frozen=True)
class RobotRow:
    """A shipped robot."""

    name: str = field(metadata=column("robot"))
    """As `--robot` takes it."""
    mass: float = field(metadata=column("mass", "kg", ".4g"))
    """Of the whole robot."""
    joints: tuple[str, ...] = field(metadata=column("joints", form=lambda names: str(len(names))))
    """Those that move."""
    feet: tuple[str, ...] = field(metadata=column("feet", form=lambda names: str(len(names))))
    """Those that it stands on."""


@dataclass(frozen=True)
class PolicyRow:
    """A shipped policy."""

    name: str = field(metadata=column("policy"))
    """As `verify`, `evaluate` and `deploy` take it."""
    robot: str = field(metadata=column("robot"))
    """What it walks on."""
    terrain: str = field(metadata=column("ground"))
    """What it was trained on."""
    training: str = field(metadata=column("friction in training"))
    """What its joints had."""


@dataclass(frozen=True)
class EngineRow:
    """A physics engine."""

    name: str = field(metadata=column("engine"))
    """As `--engines` takes it."""
    here: bool = field(metadata=column("installed"))
    """Whether it can be used now."""
    install: str = field(metadata=column("if not: install it by"))
    """The command that installs its extra; a dash where it is there."""


def main(arguments: list[str]) -> int:
    """Run the verb."""
    cfg = read_options(ListCfg, arguments, "stiction list", DESCRIPTION)
    kinds: dict[str, Callable[[], list[Any]]] = {"robots": robots, "policies": policies, "engines": engines}
    found = {name: make() for name, make in kinds.items() if cfg.what in ("all", name)}
    if cfg.json:
        print(json.dumps({name: [asdict(row) for row in rows] for name, rows in found.items()}, indent=2))
        return 0
    for rows in filter(None, found.values()):
        show(rows)
    return 0


def show(rows: Sequence[Any]) -> None:
    """Print records as a table."""
    from rich.table import Table

    from stiction.report.terminal import Terminal

    name, *rest = header(rows[0])
    table = Table()
    table.add_column(name, no_wrap=True)
    for title in rest:
        table.add_column(title)
    for row in rows:
        table.add_row(*texts(row))
    Terminal().print(table)


def robots() -> list[RobotRow]:
    """Return the shipped robots."""
    from stiction.robots.catalog import find_robot, robot_names

    found = map(find_robot, robot_names())
    return [RobotRow(robot.name, robot.mass, tuple(robot.joint_names), tuple(robot.foot_names)) for robot in found]


def policies() -> list[PolicyRow]:
    """Return the shipped policies."""
    from stiction.files.bundle import read_bundle, shipped_bundles

    rows = []
    for name, path in shipped_bundles().items():
        contract = read_bundle(path).contract
        rows.append(PolicyRow(name, contract.robot, contract.terrain, contract.trained))
    return rows


def engines() -> list[EngineRow]:
    """Return the shipped engines, and whether each can be used here."""
    from stiction.engines.catalog import ENGINES

    rows, source, program = [], installed_from(), installed_by()
    for spec in ENGINES.values():
        here = all(found is not None for found in spec.binaries().values())
        here = here and is_installed(PACKAGES.get(spec.name, "stiction"))
        missing = spec.extra and not here
        rows.append(EngineRow(spec.name, here, install_command(spec.extra, source, program) if missing else "–"))
    return rows


PACKAGES = {"mujoco": "mujoco", "physx": "sapien"}
"""Engine -> the Python package that it needs; the others need a library alone."""
