"""`stiction robot check|show|list`: is a file a robot, what is known of it, which ones are shipped."""

from __future__ import annotations

import json
import shlex
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

from stiction.cli.list import main as list_verb
from stiction.core.errors import RobotError, unknown_name
from stiction.core.files import keep_inputs
from stiction.core.flags import ARGUMENT
from stiction.core.options import HELP, HELP_ALL, read_options, refuse
from stiction.files.settings import check_settings, results_folder
from stiction.robots.catalog import is_file_name


@dataclass(frozen=True)
class CheckCfg:
    """Check a robot: mass, inertias, limits, motors, gravity in the pose, feet, mirror, order, and that it stands."""

    robot: Annotated[str, ARGUMENT]
    """robot.yaml, a MuJoCo (.xml) or URDF (.urdf) file, a shipped robot, or package.module:ROBOT."""
    json: bool = False
    """Print the findings as JSON on standard output, and nothing else."""


@dataclass(frozen=True)
class ShowCfg:
    """Show a robot, of a file also where each value came from; draws it standing and writes its complete robot.yaml."""

    robot: Annotated[str, ARGUMENT]
    """robot.yaml, a MuJoCo (.xml) or URDF (.urdf) file, a shipped robot, or package.module:ROBOT."""
    out: Path | None = None
    """Folder for robot.png, robot.yaml and robot.xml (the model that is simulated); none: print only."""
    overwrite: bool = False
    """Write over another robot in --out; the file that is shown is never written over."""
    json: bool = False
    """Print the robot as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Run one of the three; return 1 where a check fails."""
    asked, *rest = arguments or ["list"]
    if asked in (*HELP, HELP_ALL):
        print(USAGE)
        return 0
    if asked == "list":
        return list_verb(["robots", *rest])
    if asked == "check":
        return _check(read_options(CheckCfg, rest, "stiction robot check", CHECK))
    if asked == "show":
        _show(read_options(ShowCfg, rest, "stiction robot show", SHOW))
        return 0
    return refuse("stiction robot", unknown_name("word", asked, ("check", "show", "list")))


def _check(cfg: CheckCfg) -> int:
    """Print the findings of the checks; return 1 if one is bad."""
    from stiction.api.robot import check_robot

    check = check_robot(cfg.robot)
    findings, bad = check.findings, check.bad
    if cfg.json:
        print(json.dumps(check.to_dict(), indent=2))
        return int(bool(bad))
    from rich.table import Table

    from stiction.report.glance import Glance, print_glance
    from stiction.report.terminal import Terminal

    robot, names = check.robot, ", ".join(dict.fromkeys(finding.check for finding in bad))
    good = ", ".join(dict.fromkeys(finding.check for finding in findings if finding.state == "good"))
    # Without a friction of its own there is nothing to draw multiples of.
    level = "" if robot.joint_values("frictionloss").any() else " --friction-level 0.2"
    glance = Glance(
        f"{robot.name} ({cfg.robot}): {robot.mass:.4g} kg, {len(robot.joints)} joints, {len(robot.feet)} feet",
        "Usable",
        "no" if bad else "yes",
        "bad" if bad else "good",
        "" if bad else f"stiction train --robot {shlex.quote(cfg.robot)}{level}",
        why=f"good: {good}" if good else "",
    )
    table = Table("check", "found", "what mends it", box=None, pad_edge=False)
    for state, style in (("bad", "bold red"), ("note", "yellow")):
        for finding in findings:
            if finding.state == state:
                table.add_row(finding.check, finding.text, finding.mend, style=style)
    for note in check.notes:
        table.add_row("file", note, "", style="yellow")
    print_glance(Terminal(), glance, *([table] if table.row_count else []))
    if bad:
        raise RobotError(
            f"{cfg.robot}: fails {len(bad)} of {len(findings)} checks ({names}); the table says what mends each"
        )
    return 0


def _show(cfg: ShowCfg) -> None:
    """Print every value with its origin, and write picture, YAML and model."""
    from stiction.api.robot import MODEL_FILES, write_model
    from stiction.robots.catalog import find_derived
    from stiction.robots.description import files_of

    derived = find_derived(cfg.robot)
    robot = derived.robot
    if cfg.out is not None:
        for name in MODEL_FILES if is_file_name(cfg.robot) else ():
            keep_inputs(cfg.out / name, *files_of(Path(cfg.robot)))
        check_settings(cfg.out, "robot show", cfg, MODEL_FILES, {"robot": cfg.robot})
    if cfg.json:
        print(json.dumps(asdict(robot), indent=1))
    else:
        _print(derived)
    if cfg.out is None:
        return
    with results_folder(cfg.out, "robot show", cfg, MODEL_FILES, {"robot": cfg.robot}):
        write_model(robot, cfg.out)
    if not cfg.json:
        print(f"written: {cfg.out}/robot.png, robot.yaml (complete), robot.xml (what is simulated)")


def _print(derived: Any) -> None:
    """Print a robot's joints, and the origins that are not the same for all of them."""
    from rich.table import Table

    from stiction.report.terminal import Terminal

    robot, console = derived.robot, Terminal()
    title = f"{robot.name}: {robot.mass:.4g} kg, stands {robot.standing_height:.3g} m high"
    table = Table(title=title, title_justify="left", box=None, padding=(0, 1, 0, 0))
    for name in ("joint", "kind"):
        table.add_column(name, overflow="fold")
    for name in ("torque", "armature", "kp", "kd", "limits", "pose", "scale", "axis"):
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


CHECK = """Check a robot: mass, inertias, limits, motors, gravity in the pose, feet, mirror, order, and that it stands.

Examples:
  stiction robot check robot.yaml
  stiction robot check go2 --json"""

SHOW = """Show a robot, of a file also where each value came from; draw it standing and write its complete robot.yaml.

Examples:
  stiction robot show robot.urdf --out robot
  stiction robot show go2"""

USAGE = """usage: stiction robot check|show|list [--help] [options]

Check a robot's file, show what is known of it and where each value came from,
or list the shipped robots. Your own robot is a MuJoCo or URDF file with a few
lines of robot.yaml beside it; nothing has to be imported.

Examples:
  stiction robot check robot.yaml
  stiction robot show robot.yaml --out robot
  stiction robot list"""
"""Text of `stiction robot --help`."""
