"""`stiction excite`: design the log that identification needs, before the robot is touched."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from stiction.core.errors import ConfigurationError, RobotError, unknown_name
from stiction.core.files import write_text
from stiction.core.options import read_options
from stiction.core.records import header, part_of, texts
from stiction.formats.design import ExcitationDesign, Predicted, percent, two_digits, write_signals
from stiction.formats.log import write_log
from stiction.formats.plain import object_text
from stiction.formats.settings import results_folder
from stiction.identify.excite.setup import ExciteSetup
from stiction.robots.model import Joint

DESCRIPTION = """Design a log that shows a joint's inertia and friction well: a motion within limits of angle, speed and
torque, how long to run it, and at which gains. Predicts the standard deviation of each parameter, and shows what a
single sine or a stiff loop would cost. Guesses of the parameters do: limits hold, and the worst case is judged, over a
range around them. Writes trajectory.csv (what the controller plays back) with its sidecar, design.json, design.npz and
report.html.

Examples:
  stiction excite --robot go2 --joint FL_calf --out excite
  stiction identify log.csv --out identified"""


@dataclass(frozen=True, kw_only=True)
class ExciteConfig(ExciteSetup):
    """Options of the verb."""

    robot: str | None = None
    """A robot, saturn_lite or go1 or package.module:NAME, whose joint fills in gains, limits, and the bare motor's
    inertia and friction."""
    joint: str = "joint"
    """Name of the joint, FL_shank, or its kind, shank."""
    out: Path = Path("excite")
    """Folder for the results."""
    overwrite: bool = False
    """Write over results of other settings in --out."""
    json: bool = False
    """Print the machine-readable summary, and nothing else, on standard output."""


def main(arguments: list[str]) -> int:
    """Run the verb; return the exit status."""
    config = read_options(ExciteConfig, arguments, "stiction excite", DESCRIPTION)
    given = part_of(ExciteSetup, config)
    check_name(config.joint)
    setup = given.filled(robot_joint(config.robot, config.joint) if config.robot else None)
    from stiction.identify.excite.plan import design_excitation
    from stiction.report.excitation import write_excitation_page
    from stiction.report.terminal import Terminal, work_progress

    command = shlex.join(["stiction", "excite", *arguments])
    with work_progress() as progress:
        designed = design_excitation(setup, config.joint, command, progress)
    text = object_text(designed.record.to_dict())
    with results_folder(config.out, "excite", config):
        write_log(config.out / "trajectory.csv", designed.trajectory)
        write_signals(config.out / "design.npz", designed.signals)
        write_text(config.out / "design.json", text)
        write_excitation_page(config.out)
    if config.json:
        print(text, end="")
    else:
        show(Terminal(), designed.record, config.out)
    return 0


def check_name(joint: str) -> None:
    """Raise `StictionError` for a name that cannot stand in the header of a log."""
    if not joint.strip() or any(mark in joint for mark in ',"\r\n'):
        raise ConfigurationError(f"--joint {joint!r}: expected a name without commas, quotes and line breaks: FL_shank")


def robot_joint(robot: str, joint: str) -> Joint:
    """Return a robot's joint by its name, or the first of a kind; raise `RobotError` if it has none such."""
    from stiction.robots.catalog import find_robot

    spec = find_robot(robot)
    for found in spec.joints:
        if joint in (found.name, found.kind):
            return found
    raise RobotError(f"robot {spec.name!r}: {unknown_name('joint', joint, (*spec.joint_kinds, *spec.joint_names))}")


def show(console: Console, design: ExcitationDesign, out: Path) -> None:
    """Print how to run the log, what it will tell and what to type next, for a person."""
    table = Table(*header(Predicted), title=design.joint)
    for row in design.predicted:
        table.add_row(*texts(row))
    console.print(table)
    lines = [design.advice, *run_lines(design, out)]
    lines += [f"warning: {text}" for text in design.warnings]
    lines += [f"page: {out / 'report.html'}", f"then: {design.next_command}"]
    for line in lines:
        console.print(line, highlight=False, soft_wrap=True)


def run_lines(design: ExcitationDesign, out: Path) -> list[str]:
    """Say how long to run what."""
    reached, limits, wanted = design.reached, design.limits, design.wanted
    best = min((sine.worst for sine in design.sines), default=None)
    lines = [
        f"Play {out / 'trajectory.csv'} back once at {design.setup['rate']:g} Hz: {design.duration:g} s, the motion of "
        f"{design.pattern_duration:g} s {design.repeats} times; log angle{design.torque_too} at the same rate.",
        f"Over the range of guesses it goes from {reached['low']:.3g} to {reached['high']:.3g} rad, to "
        f"{reached['speed']:.3g} rad/s and {reached['torque']:.3g} N m (limits {limits['low']:g} to "
        f"{limits['high']:g}, {limits['speed']:g}, {limits['torque']:g}).",
        f"For Coulomb friction to {percent(wanted['relative'])}, {wanted['duration']:g} s are enough, as far as white "
        "noise goes.",
    ]
    if best is not None:
        ratio = best / design.worst
        longer = f": it takes {two_digits(ratio**2)} times as long to know as much" if ratio > 1 else ""
        lines.append(f"The best single sine would leave {two_digits(ratio)} times the worst deviation{longer}.")
    return lines
