"""`stiction study adaptation RUN...`: what adaptation does, and whether it tells the friction."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class AdaptationStudy:
    """Walk students on latents that are not their own, and probe what theirs tell."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Directories of finished training runs; several seeds of a method are put together."""
    friction_levels: tuple[float, ...] = (0.0, 0.1, 0.2, 0.3)
    """Dry friction of the walks on other latents, fractions of the torque limit [-]; at least two."""
    commands: tuple[str, ...] = ("vx=0.5", "vx=-0.5")
    """Commanded velocities of these walks."""
    episodes: int = 16
    """Episodes per level and command."""
    seconds: float = 10.0
    """Length of an episode [s]; its first 2 s are not measured."""
    robots: int = 384
    """Robots of each walk that is probed; all but their friction is drawn as in the run's training."""
    walk_seconds: float = 22.1
    """Length of these walks [s]; their first 2 s are left out."""
    seed: int = 0
    """Seed of initial states, noise and robots."""
    out: Path = Path("stiction-adaptation")
    """Directory for results.csv, summary.json, report.html, and a RUN-wear.json per run whose walk tells friction."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Study the runs, write the page, print the answer."""
    options = tyro.cli(AdaptationStudy, args=arguments, prog="stiction study adaptation", description=DESCRIPTION)
    if not options.runs:
        print("stiction study adaptation: no run given; --help shows the usage", file=sys.stderr)
        return 2
    from stiction.cli.terminal import print_warnings, work_progress
    from stiction.formats.folder import make_folder
    from stiction.formats.origin import Origin
    from stiction.formats.reproducibility import num_threads
    from stiction.formats.results import ResultRow, summary_text
    from stiction.report.adaptation import lead, write_adaptation
    from stiction.transfer.adaptation.friction_walk import WalkCfg
    from stiction.transfer.adaptation.study import AdaptationCfg, study
    from stiction.transfer.evaluate import EvaluationCfg

    cfg = AdaptationCfg(
        EvaluationCfg(
            friction_levels=options.friction_levels,
            commands=options.commands,
            episodes=options.episodes,
            seconds=options.seconds,
            seed=options.seed,
        ),
        WalkCfg(robots=options.robots, seconds=options.walk_seconds, seed=options.seed),
    )
    make_folder(options.out)
    origin = Origin.now()
    with work_progress() as progress:
        summary = study(options.runs, options.out, cfg, num_threads(), progress)
    made = {"command": shlex.join(["stiction", "study", "adaptation", *arguments]), **origin.provenance}
    summary = made | {"warnings": origin.warnings()} | summary
    print_warnings("study adaptation", summary["warnings"])
    rows = [ResultRow(**row) for run in summary["runs"].values() for row in run["latents"]["rows"]]
    page = write_adaptation(options.out, rows, summary)
    if options.json:
        print(summary_text(summary), end="")
    else:
        print(f"{lead(summary)}\nreport: {page}")
    return 0


DESCRIPTION = (
    "What does adaptation do? Every student also walks with its latent z* frozen at its mean and taken from another "
    "robot, and a linear probe asks what z*, and the history that it is made from, tell of each joint's friction."
)
