"""`stiction doctor`: what the machine is, and whether randomisation does what it says."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass, field, replace

from stiction.core.options import read_options, refuse
from stiction.task.config import TaskCfg

DESCRIPTION = """Measure that every randomised parameter changes the physics as its own formula says. Without
--randomization: say what this machine is.

Nothing is read back: robots with both ends of each range are simulated, and the difference of their motion is
compared with the formula's. Exit status 1 where a parameter does nothing, or not what it says.

Example:
  stiction doctor --randomization --robot go1"""


@dataclass(frozen=True)
class Doctor:
    """Options of `stiction doctor`."""

    randomization: bool = False
    """Audit the randomisation."""
    task: TaskCfg = field(default_factory=TaskCfg)
    """The task whose ranges are audited."""
    json: bool = False
    """Print the audit as JSON on standard output, and nothing else."""


GROUPS = {
    "usually needed": ("--randomization", "--robot", "--json"),
    "whose ranges": ("--terrain", "--friction-law", "--friction-level", "--task.friction.range"),
}
"""The options that people use; the others are those of the task, as `stiction train --help-all` has them."""


def main(arguments: list[str]) -> int:
    """Run the verb."""
    options = read_options(Doctor, arguments, "stiction doctor", DESCRIPTION, groups=GROUPS)
    from stiction.core.provenance import machine

    if not options.randomization:
        if options.task != TaskCfg():
            refuse("stiction doctor", "robot and ranges are those of an audit; add --randomization")
        facts = machine()
        if options.json:
            print(json.dumps(facts))
        else:
            for name, value in facts.items():
                text = ", ".join(f"{k} {v}" for k, v in value.items()) if isinstance(value, dict) else value
                print(f"{name}: {text}")
        return 0

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
