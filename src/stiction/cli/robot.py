"""`stiction robot check|show|list`: is a file a robot, what is known of it, which ones are shipped."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro
from tyro.conf import Positional, subcommand

from stiction.core.errors import RobotError
from stiction.core.lock import output_folder


@dataclass(frozen=True)
class CheckCfg:
    """Check a robot: mass, inertias, limits, motors, gravity in the pose, feet, mirror, order, and that it stands."""

    robot: Positional[str]
    """robot.yaml, a MuJoCo (.xml) or URDF (.urdf) file, a shipped robot, or package.module:ROBOT."""
    json: bool = False
    """Print the findings as JSON on standard output, and nothing else."""


@dataclass(frozen=True)
class ShowCfg:
    """Show a robot: every value with where it came from; draws it standing and writes its complete robot.yaml."""

    robot: Positional[str]
    """robot.yaml, a MuJoCo (.xml) or URDF (.urdf) file, a shipped robot, or package.module:ROBOT."""
    out: Path | None = None
    """Folder for robot.png, robot.yaml and robot.xml (the model that is simulated); none: print only."""
    json: bool = False
    """Print the robot as JSON on standard output, and nothing else."""


@dataclass(frozen=True)
class ListCfg:
    """List the shipped robots and the policies that come with the package."""

    json: bool = False
    """Print the list as JSON on standard output, and nothing else."""


@dataclass(frozen=True)
class RobotCfg:
    """What to do with robots."""

    do: (
        Annotated[CheckCfg, subcommand("check")]
        | Annotated[ShowCfg, subcommand("show")]
        | Annotated[ListCfg, subcommand("list")]
    ) = field(default_factory=ListCfg)


def main(arguments: list[str]) -> int:
    """Run one of the three; return 1 where a check fails."""
    cfg = tyro.cli(
        tyro.conf.OmitSubcommandPrefixes[RobotCfg], args=arguments, prog="stiction robot", description=DESCRIPTION
    ).do
    if isinstance(cfg, CheckCfg):
        return _check(cfg)
    if isinstance(cfg, ShowCfg):
        _show(cfg)
    else:
        _list(cfg)
    return 0


def _check(cfg: CheckCfg) -> int:
    """Print what the checks found; return 1 where one is bad."""
    from stiction.api.robot import check_robot

    found = check_robot(cfg.robot)
    findings, bad = found.findings, found.bad
    if cfg.json:
        print(json.dumps(found.to_dict(), indent=2))
        return int(bool(bad))
    from rich.table import Table
    from rich.text import Text

    from stiction.report.terminal import Terminal

    table = Table(
        "check", "", "found", "what mends it", title=f"{found.robot.name} ({cfg.robot})", title_justify="left"
    )
    styles = {"good": "green", "note": "yellow", "bad": "bold red"}
    states = {state: Text(state, style) for state, style in styles.items()}
    for finding in findings:
        table.add_row(
            finding.check, states[finding.state], finding.text, finding.mend if finding.state != "good" else ""
        )
    for note in found.notes:
        table.add_row("file", states["note"], note, "")
    console = Terminal()
    console.print(table)
    if bad:
        names = ", ".join(dict.fromkeys(finding.check for finding in bad))
        raise RobotError(
            f"{cfg.robot}: fails {len(bad)} of {len(findings)} checks ({names}); the table says what mends each"
        )
    console.print("It can be used: stiction train --robot " + cfg.robot)
    return 0


def _show(cfg: ShowCfg) -> None:
    """Print every value with its origin, and write picture, YAML and model."""
    from stiction.api.robot import read, write_model

    derived = read(cfg.robot)
    robot = derived.robot
    if cfg.json:
        print(json.dumps(asdict(robot), indent=1))
    else:
        _print(derived)
    if cfg.out is None:
        return
    with output_folder(cfg.out):
        write_model(robot, cfg.out)
    if not cfg.json:
        print(f"written: {cfg.out}/robot.png, robot.yaml (complete), robot.xml (what is simulated)")


def _print(derived: Any) -> None:
    """Print a robot's joints, and the origins that are not the same for all of them."""
    from rich.box import SIMPLE
    from rich.table import Table

    from stiction.report.terminal import Terminal

    robot, console = derived.robot, Terminal()
    console.width = max(console.width, 112)
    title = f"{robot.name}: {robot.mass:.4g} kg, stands {robot.standing_height:.3g} m high"
    table = Table(title=title, title_justify="left", box=SIMPLE)
    for name in ("joint", "kind", "torque", "armature", "kp", "kd", "limits", "pose", "scale", "axis"):
        table.add_column(name, no_wrap=True)
    for joint, link in zip(robot.joints, robot.links, strict=True):
        motor = (joint.torque_limit, joint.armature, joint.kp, joint.kd)
        table.add_row(
            joint.name,
            joint.kind,
            *(f"{value:.4g}" for value in motor),
            f"{joint.lower:+.2f} {joint.upper:+.2f}",
            f"{joint.default_position:+.2f}",
            f"{joint.action_scale:.3g}",
            " ".join(f"{share:+.2g}" for share in link.axis),
        )
    console.print(table)
    console.print(
        "N m, kg m², N m/rad, N m s/rad, rad; the axis in the base's frame at angles of zero, right-hand rule"
    )
    origins = Table("value", "came from", "of", title="where it came from", title_justify="left")
    grouped: dict[tuple[str, str], list[str]] = {}
    for origin in derived.origins:
        grouped.setdefault((origin.field, origin.source), []).append(f"{origin.subject} {origin.value}")
    for (value, source), subjects in grouped.items():
        more = f" and {len(subjects) - 3} more" if len(subjects) > 3 else ""
        origins.add_row(value, source, "; ".join(subjects[:3]) + more)
    if grouped:
        console.print(origins)
    for note in derived.notes:
        console.print(f"note: {note}")


def _list(cfg: ListCfg) -> None:
    """Print the shipped robots and policies."""
    from stiction.formats.bundle import shipped_bundles
    from stiction.robots.catalog import find_robot, robot_names

    robots = [find_robot(name) for name in robot_names()]
    policies = list(shipped_bundles())
    if cfg.json:
        rows = [
            {"name": robot.name, "mass": robot.mass, "joints": robot.joint_names, "feet": robot.foot_names}
            for robot in robots
        ]
        print(json.dumps({"robots": rows, "policies": policies}, indent=2))
        return
    from rich.table import Table

    from stiction.report.terminal import Terminal

    table = Table("robot", "mass [kg]", "joints", "feet", title="shipped robots", title_justify="left")
    for robot in robots:
        table.add_row(robot.name, f"{robot.mass:.4g}", str(robot.num_joints), str(len(robot.feet)))
    console = Terminal()
    console.print(table)
    console.print("shipped policies: " + ", ".join(policies))


DESCRIPTION = (
    "Check a robot's file, show what is known of it and where each value came from, or list the shipped robots. Your "
    "own robot is a MuJoCo or URDF file with a few lines of robot.yaml beside it; nothing has to be imported."
)
"""What `stiction robot --help` says first."""
