"""`stiction demo --loop`: the whole loop on a virtual robot, each step the command that a user would type.

bench (motions under the supervisor) → identify → what to train → deploy a policy → identify its walk, and compare with
what the robot really has.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from stiction.core.decode import is_number
from stiction.core.errors import FileError, StictionError
from stiction.core.files import write_text
from stiction.core.records import column, header, texts
from stiction.deploy.runtime.ticker import BUSY, LATE, QUIET
from stiction.files.bam import load_joints
from stiction.files.plain import read_object

POLICY, ROBOT = "saturn_lite-flat-deception-0.2", "saturn_lite"
"""Bundle that is deployed, and its robot."""

KINDS = ("hip", "thigh", "shank")
"""Kinds of joints that go on the bench, one after the other."""

SEED, LEVEL = 3, "0.1"
"""Virtual robot, and its dry friction."""

SECONDS = 12.0
"""Length of the walk [s]."""

TRIES = 3
"""Number of attempts at a run on a machine too busy for it."""

WAITS, WAITS_FOR_POLICY = ("--stale", "0.5", "--gap", "0.5"), ("--silence", "2")
"""How long the supervisor waits for the robot, and for a policy [s]: longer than on a robot of metal, since here
nothing falls on anybody, and a demo runs on machines that do other work."""

TIMING = (*BUSY, "not ready")
"""Rules that end a run on a virtual robot only where the machine is late."""


def _yes(holds: bool) -> str:
    """Return whether an interval holds the truth, in a word."""
    return "yes" if holds else "no"


@dataclass(frozen=True)
class JointRow:
    """One joint before and after deployment. Friction as the motors' own torque tells it, f/k [N m]."""

    joint: str = field(metadata=column("joint", form=str))
    """Name of the joint."""
    own: float = field(metadata=column("the robot's own f/k", "N m", ".3g"))
    """True friction of the virtual robot, over the true torque constant in units of the data sheet's."""
    bench: str = field(metadata=column("on the bench, 95 %", "N m", str))
    """Interval that the bench's log gave."""
    walk: str = field(metadata=column("after deployment, 95 %", "N m", str))
    """Interval that the walk's log gave."""
    bench_holds: bool | None = field(metadata=column("bench holds", form=_yes))
    """True if the bench's interval holds the true friction; None without an interval."""
    walk_holds: bool | None = field(metadata=column("walk holds", form=_yes))
    """True if the walk's interval holds the true friction; None without an interval."""


def run_loop(out: Path) -> list[JointRow]:
    """Run the loop, write `loop.json`, and return a row a joint.

    Raises `StictionError` where a step fails: what it said stands on standard error.
    """
    bench_intervals: dict[str, tuple[float, float]] = {}
    virtual = ["--robot", "virtual", "--armed", "--robot-seed", str(SEED), "--friction-level", LEVEL]
    for kind in KINDS:
        motion, bench = out / f"excite-{kind}", out / f"bench-{kind}"
        _step("excite", "--robot", ROBOT, "--joint", kind, "--out", motion)
        _deploy(bench, *virtual, "--stand", "--excitation", motion / "trajectory.csv")
        _step("identify", bench, "--test-condition", "in_air", "--out", out / f"identified-{kind}", "--overwrite")
        bench_intervals |= friction_in(out / f"identified-{kind}" / "joints.json")
    walk = out / "walk"
    _deploy(walk, *virtual, "--command", "vx=0.4", "--duration", SECONDS, *WAITS_FOR_POLICY)
    _step("identify", "walk", walk, "--out", out / "identified-walk", "--overwrite")
    after = friction_in(out / "identified-walk" / "joints.json")
    rows = compared(own_friction(), bench_intervals, after)
    summary = {"joints": [vars(row) for row in rows], **shares(rows)}
    write_text(out / "loop.json", json.dumps(summary, indent=2) + "\n")
    return rows


def own_friction() -> dict[str, float]:
    """Return what the joints of the virtual robot have, f/k [N m]: the truth, which no step above was told."""
    from stiction.robots.catalog import find_robot
    from stiction.virtual.cases import Case, parse_level
    from stiction.virtual.hidden import draw

    spec = find_robot(ROBOT)
    own = Case(SEED, "all", parse_level(LEVEL)).shown(draw(spec, SEED), spec)
    return {name: float(value) for name, value in zip(spec.joint_names, own, strict=True)}


def friction_in(path: Path) -> dict[str, tuple[float, float]]:
    """Return joint -> 95 % interval of its dry friction [N m], of those that have one, in a joints.json."""
    intervals = {}
    for name, record in load_joints(path).joints.items():
        if record.coulomb_friction is not None and not record.objections:
            intervals[name] = record.coulomb_friction.interval95
    return intervals


def compared(
    own: dict[str, float], bench: dict[str, tuple[float, float]], walk: dict[str, tuple[float, float]]
) -> list[JointRow]:
    """Return a row a joint; `own`: what each really has, bench and walk: what was found, where something was."""
    rows = []
    for joint, value in own.items():
        ends = [interval.get(joint) for interval in (bench, walk)]
        cells = ["" if pair is None else f"{pair[0]:.3g} to {pair[1]:.3g}" for pair in ends]
        holds = [None if pair is None else pair[0] <= value <= pair[1] for pair in ends]
        rows.append(JointRow(joint, value, cells[0], cells[1], holds[0], holds[1]))
    return rows


def shares(rows: list[JointRow]) -> dict[str, list[int]]:
    """Return of bench and walk how many intervals hold what the robot has, and how many there are."""
    return {
        name: [sum(bool(getattr(row, name)) for row in rows), sum(getattr(row, name) is not None for row in rows)]
        for name in ("bench_holds", "walk_holds")
    }


def show(rows: list[JointRow]) -> None:
    """Print the rows as a table."""
    from rich.table import Table

    from stiction.report.terminal import Terminal

    table = Table(*header(JointRow))
    for row in rows:
        table.add_row(*texts(row))
    Terminal().print(table)


def _deploy(out: Path, *words: object) -> None:
    """Make a run of the robot in a folder, and again where the machine was too busy for it; those are set aside.

    Raises `StictionError` where a run was stopped for another reason, or the machine stays busy.
    """
    arguments = ("deploy", POLICY, *words, *WAITS, "--out", out)
    for number in range(1, TRIES + 1):
        status = _status(*arguments)
        late = lateness(report_of(out))
        if status == 0:
            if late:
                print(
                    f"the machine was busy meanwhile ({late}): what is found may be wider than it could be",
                    file=sys.stderr,
                )
            return
        if not late:
            raise _failure(arguments, status)
        print(f"the machine was too busy for a robot in real time: {late}; try {number} of {TRIES}", file=sys.stderr)
        if number < TRIES:
            out.rename(out.with_name(f"{out.name}-late{number}"))
    raise StictionError(
        f"the machine was too busy for a robot in real time, {TRIES} times ({late}): end other programs, then again"
    )


def report_of(out: Path) -> dict[str, Any]:
    """Return the report of a run, empty where there is none; raise `StictionError` for what deploy does not write."""
    file = out / "report.json"
    if not file.exists():
        return {}
    expected = "what deploy writes"
    report = read_object(file, expected)
    times = [report.get(name) for name in ("probe_ms", "lateness_ms")]
    timed = all(isinstance(timing, dict) and is_number(timing.get("p99")) for timing in times)
    if not timed or not isinstance(report.get("stop", ""), dict | None):
        raise FileError(f"{file}: no lateness or no reason of the end in it; expected {expected}")
    return report


def lateness(report: Mapping[str, Any]) -> str:
    """Return how late a machine was in a run, in words; empty where it was quick enough, or nothing is known."""
    if not report:
        return ""
    rule = (report["stop"] or {}).get("rule")
    causes = [f"`{rule}`"] if rule in TIMING else []
    for name, most, what in (("probe_ms", QUIET, "an idle loop"), ("lateness_ms", LATE, "the policy")):
        if (p99 := report[name]["p99"]) > most:
            causes.append(f"{what} came {p99:.1f} ms late, p99, of {most:g} allowed")
    return ", ".join(causes)


def _step(*words: object) -> None:
    """Run one verb as a user would; raise `StictionError` where it fails."""
    if status := _status(*words):
        raise _failure(words, status)


def _failure(words: Sequence[object], status: int) -> StictionError:
    """Return the error of a verb that failed."""
    command = " ".join(map(str, words))
    return StictionError(f"`stiction {command}` ended with status {status}; its own line above says why")


def _status(*words: object) -> int:
    """Run one verb in this process and return its status; what it prints goes to standard error."""
    from contextlib import redirect_stdout

    from stiction.cli.main import main

    arguments = [*map(str, words)]
    print(f"$ stiction {' '.join(arguments)}", file=sys.stderr)
    with redirect_stdout(sys.stderr):
        return main(arguments) or 0
