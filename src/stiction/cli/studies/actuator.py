"""`stiction study actuator`: the paper's loop f0 -> log -> f_motor -> f1, on virtual robots, resumable."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from stiction.transfer.loop_config import LoopCfg

DESCRIPTION = """The paper's loop with an Actuator Net: a policy f0 trained without joint friction walks on a robot that
has it, its log trains an Actuator Net, and a second policy f1 is trained with that net in the loop. The log is of
backward walking only, as in the paper; controls are walking in all directions, and three different robots.

Stop it at any time; the same command goes on where it stood."""


@dataclass(frozen=True)
class ActuatorStudy:
    """Options of `stiction study actuator`."""

    config: Annotated[LoopCfg, tyro.conf.arg(name="")] = field(default_factory=LoopCfg)
    """What is run."""
    out: Path = Path("actuator-study")
    """Folder of the study."""
    json: bool = False
    """Print summary.json on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Run the study, write its results and its page."""
    options = tyro.cli(ActuatorStudy, args=arguments, prog="stiction study actuator", description=DESCRIPTION)

    from stiction.cli.terminal import print_warnings, work_progress
    from stiction.formats.configuration import to_plain
    from stiction.formats.origin import Origin
    from stiction.formats.results import ResultRow, summary_text, write_results, write_summary
    from stiction.report.actuator import write_actuator_page
    from stiction.report.actuator_loop import write_loop_page
    from stiction.transfer.actuator_loop import ActuatorLoop

    origin = Origin.now()
    command = shlex.join(["stiction", "study", "actuator", *arguments])
    with work_progress() as progress:
        found = ActuatorLoop(options.out, options.config, command, progress).run()
    config = options.config
    summary = {
        "command": command,
        "options": {
            name: to_plain(value) if name in ("net", "train") else value for name, value in vars(config).items()
        },
        **origin.provenance,
        "warnings": origin.warnings(),
    } | found
    summary["options"]["policy"] = None if config.policy is None else str(config.policy)
    print_warnings("study actuator", summary["warnings"])
    rows = [{key: value for key, value in row.items() if key != "robot"} for row in found["rows"]]
    for row, whole in zip(rows, found["rows"], strict=True):
        row["policy"] = f"{row['policy']} on {whole['robot']}"
    write_results(options.out / "results.csv", [ResultRow(**row) for row in rows])
    write_summary(options.out / "summary.json", summary)
    for name in found["nets"]:
        write_actuator_page(options.out / "nets" / name)
    page = write_loop_page(options.out, summary)
    if options.json:
        print(summary_text(summary), end="")
    else:
        print(f"page: {page}")
    return 0
