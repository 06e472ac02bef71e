"""`stiction study gait BUNDLE...`: the gaits of policies trained with and without r_trot and r_unsync."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from stiction.formats.errors import StictionError

DESCRIPTION = (
    "Drive policies over commands and show which feet are on the ground when: gait diagram, shares of each contact "
    "group, flight, synchrony; and judge the paper's sentences on its two gait rewards. Which rewards a policy had is "
    "read off the training command in its contract, or off the run. Train the ablations with `stiction train "
    "--task.rewards.trot 0`, `--task.rewards.unsync 0`, and both."
)


@dataclass(frozen=True)
class GaitStudy:
    """Options of `stiction study gait`."""

    policies: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Policy bundles: directories, names of shipped ones, or finished training runs, which are exported first."""
    variants: tuple[Literal["both", "no-trot", "no-unsync", "neither"], ...] = ()
    """Gait rewards of each policy, in order, where its training command does not tell them."""
    commands: tuple[str, ...] = ("vx=0.5", "vx=-0.5")
    """Commanded velocities; each must ask for motion."""
    friction_level: float = 0.0
    """Dry friction in every joint, as a fraction of its torque limit [-]."""
    episodes: int = 16
    """Episodes per command."""
    seconds: float = 12.0
    """Length of an episode [s]; its first 2 s are not measured."""
    seed: int = 0
    """Seed of initial states and sensor noise."""
    robot: str | None = None
    """A robot of your own, `package.module:NAME`; by default the shipped robot that the bundle names."""
    out: Path = Path("stiction-gait")
    """Directory for gaits.csv, feet.csv, claims.csv, contacts.npz, gait.png, summary.json and report.html."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Check and drive the policies, write the page, print where it is."""
    options = tyro.cli(GaitStudy, args=arguments, prog="stiction study gait", description=DESCRIPTION)
    if not options.policies:
        print("stiction study gait: no bundle given; `stiction study gait --help` shows the usage", file=sys.stderr)
        return 2
    if options.variants and len(options.variants) != len(options.policies):
        raise StictionError(
            f"{len(options.variants)} variants for {len(options.policies)} policies; expected one each, or none"
        )
    import time
    from dataclasses import asdict
    from functools import partial

    from stiction.cli.terminal import print_warnings, work_progress
    from stiction.formats.folder import make_folder
    from stiction.formats.origin import Origin
    from stiction.formats.reproducibility import num_threads
    from stiction.formats.results import summary_text
    from stiction.report.gait import GaitResult, lead, write_gait
    from stiction.transfer.evaluate import EvaluationCfg
    from stiction.transfer.gait_claims import judge
    from stiction.transfer.gait_study import trained_alike, trained_variant, walk_gaits
    from stiction.transfer.summary import check_names, describe

    cfg = EvaluationCfg(
        (options.friction_level,), options.commands, options.episodes, options.seconds, seed=options.seed
    )
    make_folder(options.out)
    bundles = [_bundle(path, options.out) for path in options.policies]
    check_names([bundle.name for bundle in bundles])
    variants: tuple[str, ...] = options.variants or tuple(
        trained_variant(bundle.contract.command) for bundle in bundles
    )
    origin, start, walked = Origin.now(), time.perf_counter(), []
    with work_progress() as progress:
        for bundle, variant in zip(bundles, variants, strict=True):
            walked += walk_gaits(bundle, variant, cfg, options.robot, num_threads(), partial(progress, bundle.name))
    gaits = tuple(one.row for one in walked)
    result = GaitResult(
        gaits,
        tuple(foot for one in walked for foot in one.feet),
        tuple(judge(gaits, trained_alike(bundles))),
        tuple(one.contact for one in walked),
        walked[0].period,
    )
    named = zip(bundles, variants, strict=True)
    summary = {
        "command": shlex.join(["stiction", "study", "gait", *arguments]),
        "evaluation": asdict(cfg),
        "seconds": time.perf_counter() - start,
        **origin.provenance,
        "warnings": origin.warnings(),
        "policies": {bundle.name: describe(bundle) | {"variant": variant} for bundle, variant in named},
        "lead": lead(result),
    }
    print_warnings("study gait", summary["warnings"])
    page = write_gait(options.out, result, summary)
    if options.json:
        print(summary_text(summary), end="")
    else:
        print(f"{summary['lead']}\nreport: {page}")
    return 0


def _bundle(path: Path, out: Path):
    """Return the checked bundle that a path means; a training run is exported into `out` under its own name."""
    from stiction.deploy.check import check_bundle
    from stiction.formats.shipped import find_bundle

    if not (path / "config.json").is_file():
        return check_bundle(find_bundle(path)).bundle
    made = out / "bundles" / path.name
    if made.exists():
        return check_bundle(made).bundle
    from stiction.transfer.export import export_run

    return export_run(path, made).bundle
