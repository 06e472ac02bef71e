"""`stiction study adaptation RUN...`: what adaptation does, and whether friction can be read from it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from stiction.core.flags import ARGUMENT
from stiction.core.records import part_of
from stiction.files.results import DIRECTIONS
from stiction_experiments.lab.study import RedrawnOptions, Report, Study, UsageError, Work, recorded


@dataclass(frozen=True, kw_only=True)
class AdaptationOptions(RedrawnOptions):
    """Options of `stiction study adaptation`."""

    runs: Annotated[tuple[Path, ...], ARGUMENT]
    """Directories of finished training runs; several seeds of a method are put together."""
    friction_levels: tuple[float, ...] = (0.0, 0.1, 0.2, 0.3)
    """Dry friction of the walks on other latents, fractions of the torque limit [-]; at least two."""
    commands: tuple[str, ...] = DIRECTIONS
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
    """Directory for results.csv, summary.json, report.html, and RUN-wear.json, a run's wear monitor, if it has one."""


def run(options: AdaptationOptions, work: Work) -> Report:
    """Study the runs."""
    if options.judge_again:
        from stiction_experiments.adaptation.page import report

        return report(recorded(options.out, work, ("methods", "runs", "threshold")))
    if not options.runs:
        raise UsageError("no run given")
    from stiction.evaluation.evaluate import EvaluationCfg
    from stiction_experiments.adaptation.page import report
    from stiction_experiments.adaptation.probes import WalkCfg
    from stiction_experiments.adaptation.run import AdaptationCfg, study

    walk = part_of(WalkCfg, options, seconds=options.walk_seconds)
    cfg = AdaptationCfg(part_of(EvaluationCfg, options), walk)
    return report(study(options.runs, work.begin(), cfg, work.threads, work.progress))


DESCRIPTION = (
    "What does adaptation do? A student that has a latent z* also walks with it frozen at its mean and taken from "
    "another robot, and a linear probe reads each joint's friction from z*, from the estimates, and from the history "
    "behind them.\n\n"
    "Example:\n  stiction study adaptation runs/seed-0 runs/seed-1 --out adaptation"
)

STUDY = Study(
    "what a policy's summary of its history (the latent z*) does, and whether friction can be read from it",
    DESCRIPTION,
    AdaptationOptions,
    run,
    results=("results.csv", "latents.png", "probes.png"),
)
