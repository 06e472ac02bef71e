"""`stiction identify WALK.npz`: joint friction from the log of a walking robot. `identify` hands over such logs."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from stiction.core.errors import ConfigurationError, FileError, RobotError
from stiction.core.records import part_of
from stiction.identify.walking.setup import WalkSetup

DESCRIPTION = """Find the friction of a walking robot's joints in its log (of evaluate --log, or of deploy): unloaded
friction from legs in swing, and what load adds to it from the body in stance, where the robot's masses are declared
known. Writes joints.json, fit.npz, training.json and report.html."""

RESULTS = ("joints.json", "fit.npz", "training.json", "report.html")
"""What is written into --out."""


CAPTION = "± is the half-width of the 95 % interval; viscous in N m s/rad"


@dataclass(frozen=True, kw_only=True)
class WalkOptions(WalkSetup):
    """Options for a walking log."""

    log: Annotated[Path, tyro.conf.Positional]
    """The log, NPZ."""
    robot: str | None = None
    """The robot, with its masses and link lengths; by default the shipped one that the log names."""
    out: Path = Path("identified")
    """Folder for joints.json, fit.npz, training.json and report.html."""
    json: bool = False
    """Print the machine-readable summary, and nothing else, on standard output."""


def asks_for_walk(arguments: list[str]) -> bool:
    """Return whether one of the arguments of `identify` is a walking log."""
    from stiction.formats.walk import is_walk

    return any(text.endswith(".npz") and is_walk(Path(text)) for text in arguments)


def from_arguments(arguments: list[str]) -> int:
    """Parse the options, identify, write and print; return the exit status."""
    options = tyro.cli(WalkOptions, args=arguments, prog="stiction identify", description=DESCRIPTION)
    setup = part_of(WalkSetup, options)
    return run(options.log, options.out, options.robot, setup, options.json)


def run(log: Path, out: Path, robot: str | None, setup: WalkSetup, as_json: bool = False) -> int:
    """Identify a walking log, write the results into `out`, print them; return the exit status.

    robot: name of the robot, or None for the shipped one that the log names. Raises `StictionError` in one line for
    whatever is wrong with the log, the robot or the folder.
    """
    from stiction.formats.walk import read_walk
    from stiction.identify.walking.pipeline import identify_walk
    from stiction.robots.catalog import find_robot

    if any((out / name).resolve() == log.resolve() for name in RESULTS):
        raise ConfigurationError(f"--out {out} would overwrite the log {log.name}; choose another --out")
    console = Console(stderr=True)
    with console.status("reading, fitting"):
        walk = read_walk(log)
        if robot is None and not walk.header.robot.isidentifier():
            raise RobotError(f"the log is of the robot {walk.header.robot!r}, not a shipped one; name it: --robot")
        result = identify_walk(walk, find_robot(robot or walk.header.robot), setup)
        write_results(out, result)
    if as_json:
        print(json.dumps(result.joints.to_dict(), indent=2, allow_nan=False, ensure_ascii=False))
    else:
        show(Console(), result)
        console.print(f"page: {out / 'report.html'}", highlight=False, soft_wrap=True)
    return 0


def write_results(folder: Path, result) -> None:
    """Write the results of a `WalkIdentification`; raise `StictionError` if the folder cannot be written."""
    from stiction.formats.joints import write_training
    from stiction.formats.walk import write_walk_fit
    from stiction.identify.verdict import propose
    from stiction.report.walking import write_walking_page

    try:
        folder.mkdir(parents=True, exist_ok=True)
        result.joints.write(folder / "joints.json")
        write_walk_fit(folder / "fit.npz", result.fit)
        write_training(folder / "training.json", propose(result.joints))
        write_walking_page(folder)
    except OSError as error:
        raise FileError(f"cannot write to {folder}: {error.strerror or error}; choose another --out") from error


def show(console: Console, result) -> None:
    """Print what a `WalkIdentification` found, and its warnings, for a person."""
    from stiction.report.walking import grouped_warnings, span

    table = Table("", "dry friction [N m]", "of limit [%]", "viscous", "per load [1]", "swings", caption=CAPTION)
    for name, record in result.joints.joints.items():
        cells = (
            span(record.coulomb_friction),
            span(record.friction_ratio, 100),
            span(record.viscous_friction),
            span(record.load_coefficient),
        )
        table.add_row(name, *cells, str(record.diagnostics["swings"]))
    console.print(table)
    for text in grouped_warnings(result.joints):
        console.print(f"warning: {text}", highlight=False, markup=False, soft_wrap=True)
