"""`stiction doctor`: what the machine is, whether randomisation does what it says, and whether mjlab's does."""

from __future__ import annotations

import json
import math
import re
import sys
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from rich.table import Column, Table

from stiction.core.extras import EXTRAS, install_command, installed_by, installed_from, missing, require
from stiction.core.options import read_options, refuse
from stiction.report.glance import Glance, print_glance
from stiction.report.terminal import Terminal
from stiction.task.config import TaskCfg

DESCRIPTION = """Measure that every randomised parameter changes the physics as its own formula says. Without
--randomization or --mjlab: say what this machine is.

--randomization [train]: nothing is read back: robots with both ends of each range are simulated, and the difference
of their motion is compared with the formula's.
--mjlab TASK [mjlab]: a task registered in mjlab is built on the CPU and reset; what its events draw is compared over
robots and resets with the declared ranges, and every joint must hold under 0.8 of its dry friction.
Exit status 1 where a parameter does nothing, or not what it says, or where a joint does not hold.

Examples:
  stiction doctor --randomization --robot go1
  stiction doctor --mjlab Stiction-Velocity-Flat-Unitree-Go1"""


@dataclass(frozen=True)
class Doctor:
    """Options of `stiction doctor`."""

    randomization: bool = False
    """Audit the randomisation."""
    mjlab: str | None = None
    """Audit a task registered in mjlab, by its name."""
    task: TaskCfg = field(default_factory=TaskCfg)
    """The task whose ranges are audited."""
    json: bool = False
    """Print the audit as JSON on standard output, and nothing else."""


GROUPS = {
    "usually needed": ("--randomization", "--robot", "--mjlab", "--json"),
    "whose ranges": ("--terrain", "--friction-law", "--friction-level", "--task.friction.range"),
}
"""The options that people use; the others are those of the task, as `stiction train --help-all` has them."""


def main(arguments: list[str]) -> int:
    """Run the verb."""
    options = read_options(Doctor, arguments, "stiction doctor", DESCRIPTION, groups=GROUPS)
    if not options.randomization and options.task != TaskCfg():
        refuse("stiction doctor", "robot and ranges are those of an audit; add --randomization")
    if options.mjlab == "":
        refuse("stiction doctor", "--mjlab: got an empty name, expected that of a task registered in mjlab")
    if options.randomization and options.mjlab:
        refuse("stiction doctor", "--mjlab audits a task of mjlab, --randomization one of stiction; give one of them")
    if options.mjlab:
        return _audit_mjlab(options.mjlab, options.json)
    return _audit(options) if options.randomization else _describe_machine(options.json)


def _describe_machine(as_json: bool) -> int:
    """Print what this machine is."""
    from stiction.core.provenance import machine

    facts = machine()
    if as_json:
        print(json.dumps(facts))
    else:
        lacking = [extra for extra in EXTRAS if missing(extra)]
        some = f"{len(EXTRAS) - len(lacking)} of {len(EXTRAS)} extras, not {', '.join(lacking)}"
        ready = "sim" not in lacking and "train" not in lacking
        print_glance(
            Terminal(),
            Glance(
                f"{facts['cpu']}, {facts['cores']} cores, {facts['system']}, Python {facts['python']}",
                "Installed",
                some if lacking else "every extra",
                "good" if ready else "note",
                "stiction demo" if "sim" not in lacking else install_command("sim", installed_from(), installed_by()),
                why="threads, packages and their versions: stiction doctor --json",
            ),
        )
    return 0


def _audit(options: Doctor) -> int:
    """Audit the randomisation of a task of ours."""
    require("train")
    from stiction.learning.config import TrainCfg
    from stiction.learning.presets import check_settings
    from stiction.robots.catalog import find_robot
    from stiction.robots.sliders import weak_friction
    from stiction.task.audit import check_randomization

    check_settings(TrainCfg(task=options.task), TrainCfg())
    spec = find_robot(options.task.robot)
    task = replace(options.task, rewards=options.task.rewards.for_robot(spec))
    lightest = task.randomization.armature[0] * spec.joint_values("armature")
    if line := weak_friction(spec, task.physics, task.timestep, lightest):
        print(f"stiction doctor: warning: {line}", file=sys.stderr)
    note = Terminal(stderr=True, quiet=options.json)
    rows = check_randomization(task, spec, lambda what: note.print(f"measuring: {what}"))
    failed = [row for row in rows if not row.ok]
    if options.json:
        print(json.dumps({"robot": spec.name, "ok": not failed, "rows": [asdict(r) | {"ok": r.ok} for r in rows]}))
    else:
        table = Table("parameter", "measured", "share of the formula's effect", "verdict", box=None, pad_edge=False)
        for row in failed:
            table.add_row(row.parameter, row.quantity, f"{row.share:.3f}", row.verdict, style="bold red")
        good = ", ".join(dict.fromkeys(row.parameter for row in rows if row.ok))
        _print_audit(f"randomisation of {spec.name}", rows, failed, f"good: {good}", table)
    if failed:
        names = ", ".join(sorted({row.parameter for row in failed}))
        print(f"stiction doctor: {len(failed)} of {len(rows)} checks failed: {names}", file=sys.stderr)
    return 1 if failed else 0


def _audit_mjlab(task: str, as_json: bool) -> int:
    """Audit a task of mjlab."""
    require("mjlab")
    from stiction.core.draws import CREEP

    # Of mjlab's own functions, at its import.
    warnings.filterwarnings("ignore", message=r"`torch\.jit\.script` is deprecated")
    from stiction.exchange.mjlab.audit import audit_task

    note = Terminal(stderr=True, quiet=as_json)
    audit = audit_task(task, report=lambda what: note.print(f"measuring: {what}"))
    failed = audit.failed
    if as_json:
        rows = {name: [asdict(r) | {"ok": r.ok, "verdict": r.verdict} for r in getattr(audit, name)] for name in ROWS}
        print(json.dumps({"task": task, "ok": not failed} | _plain(rows)))
    else:
        # Names stay whole in 80 columns.
        ranges = (Column(name, max_width=10) for name in ("seen", "declared"))
        look: dict[str, Any] = {"box": None, "pad_edge": False}
        drawn = Table(Column("event, value", no_wrap=True), *ranges, "verdict", **look)
        for row in (row for row in audit.draws if not row.ok):
            name = row.event + "\n" + re.sub(r" (?=/ |- |of |\[)", "\n", row.quantity)
            drawn.add_row(name, _ends(row.seen), _ends(row.declared), row.verdict, style="bold red")
        held = Table(
            Column("joint", no_wrap=True),
            *("friction", "moved", "in MuJoCo", "verdict"),
            caption="under 0.8 of its friction for 1 s [N m, mrad]",
            **look,
        )
        for joint in (joint for joint in audit.holds if not joint.ok):
            moved = (f"{1e3 * angle:.3g}" for angle in (joint.moved, joint.moved_in_mujoco))
            held.add_row(joint.joint, f"{joint.friction:.3g}", *moved, joint.verdict, style="bold red")
        good = (
            f"{sum(row.ok for row in audit.draws)} values drawn as declared"
            if audit.draws
            else f"no event of {task} draws anything of the model",
            f"{sum(joint.ok for joint in audit.holds)} joints hold"
            if audit.holds
            else "no driven joint has dry friction: there is none to hold it",
        )
        _print_audit(task, [*audit.draws, *audit.holds], failed, "; ".join(good), drawn, held)
    if loose := [row for row in audit.holds if row.ok and row.moved_in_mujoco > CREEP]:
        print(
            f"stiction doctor: warning: joints that hold in training and creep in MuJoCo on the CPU, as policies are "
            f"played: {loose[0].joint}, {len(loose)} in all; set iterations to 20 and ls_iterations to 50",
            file=sys.stderr,
        )
    if failed:
        total = len(audit.draws) + len(audit.holds)
        print(f"stiction doctor: {len(failed)} of {total} checks failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


def _print_audit(what: str, rows: Sequence[Any], failed: Sequence[Any], good: str, *tables: Table) -> None:
    """Print an audit: the rows that failed, and all good ones in one line."""
    answer = f"no, {len(failed)} of {len(rows)} checks failed" if failed else f"yes, all {len(rows)} checks"
    glance = Glance(what, "As declared", answer, "bad" if failed else "good", why=good)
    print_glance(Terminal(), glance, *(table for table in tables if table.row_count))


ROWS = ("draws", "holds")
"""Fields of a `TaskAudit` that are printed."""


def _ends(ends: tuple[float, float] | None) -> str:
    """Return a range as text."""
    return "unknown" if ends is None else f"{ends[0]:.3g} .. {ends[1]:.3g}"


def _plain(value: Any) -> Any:
    """Return rows as JSON has them, which knows no infinity."""
    if isinstance(value, dict):
        return {name: _plain(of_it) for name, of_it in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
