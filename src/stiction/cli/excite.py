"""`stiction excite`: design the log that identification needs, before the robot is touched."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from stiction.core.options import read_options
from stiction.core.records import header, part_of, texts, two_digits
from stiction.files.design import ExcitationDesign, Predicted, percent
from stiction.files.plain import object_text
from stiction.files.settings import check_settings, results_folder
from stiction.identification.excite.setup import ExciteSetup

DESCRIPTION = """Design a log that shows a joint's inertia and friction well: a motion within limits of angle, speed and
torque, how long to run it, and at which gains. Predicts the standard deviation of each parameter, and shows what a
single sine or a stiff loop would cost. Guesses of the parameters do: limits hold, and the worst case is judged, over a
range around them. Writes trajectory.csv (what the controller plays back) with its sidecar, design.json, design.npz and
report.html.

Examples:
  stiction excite --robot go2 --joint FL_calf_joint --out excite
  stiction identify log.csv --out identified"""

RESULTS = ("trajectory.csv", "trajectory.json", "design.json", "design.npz", "report.html")
"""Files written into --out."""


@dataclass(frozen=True, kw_only=True)
class ExciteConfig(ExciteSetup):
    """Options of the verb."""

    robot: str | None = None
    """A shipped robot, a robot's file or package.module:NAME, whose joint fills in gains, limits, and the bare motor's
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
    from stiction.api.excitation import design
    from stiction.report.terminal import Terminal, work_progress

    # Before the search, which takes a while: a folder of other results is refused at once.
    check_settings(config.out, "excite", config, RESULTS, {"robot": config.robot})
    command = shlex.join(["stiction", "excite", *arguments])
    with work_progress() as progress:
        designed = design(part_of(ExciteSetup, config), config.joint, config.robot, command, progress)
    with results_folder(config.out, "excite", config, RESULTS, {"robot": config.robot}):
        designed.write(config.out)
    if config.json:
        print(object_text(designed.to_dict()), end="")
    else:
        show(Terminal(), designed.design, config.out)
    return 0


def show(console: Console, design: ExcitationDesign, out: Path) -> None:
    """Print how to run the log, what it will tell and what to type next, for a person."""
    table = Table(*header(Predicted), title=design.joint)
    for row in design.predicted:
        table.add_row(*texts(row))
    console.print(table)
    lines = [design.advice, *run_lines(design, out)]
    lines += [f"warning: {text}" for text in design.warnings]
    lines += [f"page: {out / 'report.html'}", f"then: {design.next_command}"]
    if design.test_condition == "bare_motor":
        lines.append("with the link on it and the robot in the air, say so: --test-condition in_air")
    for line in lines:
        console.print(line, highlight=False, soft_wrap=True)


def run_lines(design: ExcitationDesign, out: Path) -> list[str]:
    """Return instructions to play the trajectory, one per line."""
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
