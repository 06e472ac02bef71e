"""`stiction study actuator`: the paper's loop f0 -> log -> f_motor -> f1, on virtual robots, resumable."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

from stiction.core.flags import FLAT
from stiction_experiments.actuator.config import LoopCfg
from stiction_experiments.lab.study import RedrawnOptions, Report, Study, Work, recorded

DESCRIPTION = """The paper's loop with an Actuator Net: a policy f0 trained without joint friction walks on a robot that
has it, its log trains an Actuator Net, and a second policy f1 is trained with that net in the loop. The log is of
backward walking only, as in the paper; controls are walking in all directions, and three different robots.

Stop it at any time; the same command goes on where it stood."""

GROUPS = {
    "usually needed": ("--policy", "--out", "--overwrite", "--judge-again", "--json"),
    "the virtual robot and its log": ("--level", "--torque", "--repeats", "--log-seconds", "--variants"),
    "the evaluation": ("--episodes", "--seconds", "--commands"),
    "the trainings": ("--num-envs", "--seed", "--device", "--teacher.iterations", "--student.iterations"),
}
"""The options that people use; the others are those of `stiction train` and `stiction train-actuator`."""


@dataclass(frozen=True, kw_only=True)
class ActuatorOptions(RedrawnOptions):
    """Options of `stiction study actuator`."""

    config: Annotated[LoopCfg, FLAT] = field(default_factory=LoopCfg)
    """Settings of the loop."""
    out: Path = Path("actuator-study")
    """Folder of the study."""


def run(options: ActuatorOptions, work: Work) -> Report:
    """Go through the loop."""
    from stiction.report.training import write_actuator_page
    from stiction_experiments.actuator.page import report
    from stiction_experiments.actuator.run import ActuatorLoop

    if options.judge_again:
        return report(recorded(options.out, work, ("rows", "nets", "cross", "robots", "policies")))
    # What it refuses is refused before the folder is made; nothing is written before the folder is its own.
    loop = ActuatorLoop(options.out, options.config, work.command, work.progress)
    work.begin()
    result = loop.run()

    def write_nets(out: Path) -> None:
        for name in result["nets"]:
            write_actuator_page(out / "nets" / name)

    return replace(report(result), files=write_nets)


STUDY = Study(
    "whether an Actuator Net, fitted to walks of one policy, trains a better one",
    DESCRIPTION,
    ActuatorOptions,
    run,
    GROUPS,
    results=("results.csv", "speed.png"),
)
