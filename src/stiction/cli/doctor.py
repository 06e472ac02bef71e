"""`stiction doctor`: what the machine is, whether randomisation does what it says, and whether mjlab's does."""

from __future__ import annotations

import json
import math
import re
import sys
import warnings
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from stiction.core.extras import require
from stiction.core.options import read_options, refuse
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
        for name, value in facts.items():
            text = ", ".join(f"{k} {v}" for k, v in value.items()) if isinstance(value, dict) else value
            print(f"{name}: {text}")
    return 0


def _audit(options: Doctor) -> int:
    """Audit the randomisation of a task of ours."""
    require("train")
    from rich.table import Table

    from stiction.learning.config import TrainCfg
    from stiction.learning.presets import check_settings
    from stiction.report.terminal import Terminal
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
        table = Table(
            "parameter", "measured", "share of the formula's effect", "verdict", title=f"randomisation of {spec.name}"
        )
        for row in rows:
            table.add_row(
                row.parameter, row.quantity, f"{row.share:.3f}", row.verdict, style="" if row.ok else "bold red"
            )
        Terminal().print(table)
    if failed:
        names = ", ".join(sorted({row.parameter for row in failed}))
        print(f"stiction doctor: {len(failed)} of {len(rows)} checks failed: {names}", file=sys.stderr)
    return 1 if failed else 0


def _audit_mjlab(task: str, as_json: bool) -> int:
    """Audit a task of mjlab."""
    require("mjlab")
    from rich.table import Column, Table

    from stiction.core.draws import CREEP
    from stiction.report.terminal import Terminal

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
        drawn = Table(Column("event, value", no_wrap=True), *ranges, "verdict", title=f"what {task} draws")
        for row in audit.draws:
            name = row.event + "\n" + re.sub(r" (?=/ |- |of |\[)", "\n", row.quantity)
            drawn.add_row(name, _ends(row.seen), _ends(row.declared), row.verdict, style="" if row.ok else "bold red")
        held = Table(
            Column("joint", no_wrap=True),
            *("friction", "moved", "in MuJoCo", "verdict"),
            title="under 0.8 of its friction for 1 s [N m, mrad]",
        )
        for joint in audit.holds:
            moved = (f"{1e3 * angle:.3g}" for angle in (joint.moved, joint.moved_in_mujoco))
            held.add_row(
                joint.joint, f"{joint.friction:.3g}", *moved, joint.verdict, style="" if joint.ok else "bold red"
            )
        Terminal().print(drawn if audit.draws else f"no event of {task} draws anything of the model")
        Terminal().print(held if audit.holds else "no driven joint has dry friction: there is none to hold it")
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
