"""`stiction train-actuator LOG...`: an Actuator Net from logs of walks, beside the analytic law."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from stiction.core.flags import ARGUMENT, FLAT
from stiction.core.options import read_options, refuse
from stiction.joints.net import ActuatorCfg

DESCRIPTION = """Fit an Actuator Net (what torque a motor gives, from its joint's last samples) to logs that declare on
which side of the joint's friction torque was measured: walking logs of `stiction evaluate --log --log-torque ...` or of
a robot, or canonical joint logs with a sidecar. Whole runs are kept out of the fit and measure it.
`stiction convert ACTUATOR --to mjlab` or `--to isaaclab` writes the net for those trainers.

Examples:
  stiction train-actuator walks/ --out actuator
  stiction train --actuator actuator
  stiction convert actuator --to mjlab --out nets"""

RESULTS = ("actuator.npz", "summary.json", "fit.npz", "report.html")
"""Files written into --out."""


@dataclass(frozen=True)
class TrainActuator:
    """Options of `stiction train-actuator`."""

    logs: Annotated[tuple[Path, ...], ARGUMENT]
    """Logs, one file a run, or folders of walking logs."""
    config: Annotated[ActuatorCfg, FLAT] = field(default_factory=ActuatorCfg)
    """Inputs, sizes, schedule, split."""
    out: Path = Path("actuator")
    """Folder for actuator.npz, summary.json, fit.npz and report.html."""
    overwrite: bool = False
    """Write over results of other settings in --out."""
    json: bool = False
    """Print summary.json on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Run the verb."""
    options = read_options(TrainActuator, arguments, "stiction train-actuator", DESCRIPTION)
    if not options.logs:
        refuse("stiction train-actuator", "no log given; expected files, or folders of walking logs")

    import torch

    from stiction.core.errors import ConfigurationError
    from stiction.core.provenance import num_threads
    from stiction.files.inputs import with_sidecars
    from stiction.files.results import summary_text
    from stiction.files.run_log import find_run_log
    from stiction.files.settings import results_folder
    from stiction.learning.actuator import train_actuator, write_trained
    from stiction.learning.actuator_data import read_run
    from stiction.report.terminal import work_progress
    from stiction.report.training import is_worse, lead, write_actuator_page

    torch.set_num_threads(num_threads())
    folders = {path for path in options.logs if path.is_dir() and find_run_log(path) is None}
    files = [file for path in options.logs for file in (sorted(path.glob("*.npz")) if path in folders else [path])]
    if not files:
        raise ConfigurationError(
            f"no log in {', '.join(map(str, options.logs))}; expected NPZ logs of `stiction evaluate --log`"
        )
    with results_folder(options.out, "train-actuator", options, RESULTS, {"logs": with_sidecars(files)}):
        runs = [read_run(file) for file in files]
        command = shlex.join(["stiction", "train-actuator", *arguments])
        with work_progress() as progress:
            trained = train_actuator(runs, options.config, command, progress)
        write_trained(options.out, trained)
        page = write_actuator_page(options.out)
    if options.json:
        print(summary_text(trained.summary), end="")
    else:
        print(f"{lead(trained.summary)}\npage: {page}")
        more = f"more or longer logs, or --epochs above {options.config.epochs}; or stiction train without --actuator"
        theirs = f"stiction convert {options.out} --to mjlab --out nets (or --to isaaclab)"
        print("next:", more if is_worse(trained.summary) else f"stiction train --actuator {options.out}, or {theirs}")
    return 0
