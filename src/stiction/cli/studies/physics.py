"""`stiction study physics BUNDLE...`: what a faster simulation of joint friction does to the speed of a walk."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

DESCRIPTION = (
    "Drive the same policies with the joints' friction simulated by rows of the solver, by softer rows and by yielding "
    "springs, at several steps, and hold their speeds against rows at 0.25 ms. Evaluation is always on rows at the "
    "step of the contract; this says what training on another physics may cost."
)


@dataclass(frozen=True)
class PhysicsStudy:
    """Options of `stiction study physics`."""

    policies: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Policy bundles: directories, or names of shipped ones."""
    friction_levels: tuple[float, ...] = (0.0, 0.05, 0.1, 0.15, 0.2)
    """Dry friction in every joint, as fractions of its torque limit [-]."""
    speed: float = 0.5
    """Commanded speed, forward and backward [m/s]."""
    episodes: int = 16
    """Walks per level and direction."""
    seconds: float = 8.0
    """Length of a walk [s]; its first 2 s are not measured."""
    seed: int = 0
    """Seed of initial states and sensor noise."""
    out: Path = Path("stiction-physics")
    """Directory for physics.csv and summary.json."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Check and drive the policies, write the rows, print how far each physics is from the others."""
    options = tyro.cli(PhysicsStudy, args=arguments, prog="stiction study physics", description=DESCRIPTION)
    if not options.policies:
        print(
            "stiction study physics: no bundle given; `stiction study physics --help` shows the usage", file=sys.stderr
        )
        return 2
    from dataclasses import asdict

    from stiction.cli.terminal import print_warnings, work_progress
    from stiction.deploy.check import check_bundle
    from stiction.formats.folder import make_folder
    from stiction.formats.origin import Origin
    from stiction.formats.reproducibility import num_threads
    from stiction.formats.results import summary_text
    from stiction.formats.rows import write_rows
    from stiction.formats.shipped import find_bundle
    from stiction.transfer.physics_study import WalkCfg, bias, compare
    from stiction.transfer.summary import check_names, describe

    cfg = WalkCfg(options.friction_levels, options.speed, options.episodes, options.seconds, options.seed)
    bundles = [check_bundle(find_bundle(path)).bundle for path in options.policies]
    check_names([bundle.name for bundle in bundles])
    make_folder(options.out)
    origin = Origin.now()
    with work_progress() as progress:
        rows = compare({bundle.name: bundle for bundle in bundles}, cfg, num_threads(), progress)
    summary = {
        "command": shlex.join(["stiction", "study", "physics", *arguments]),
        "walks": asdict(cfg),
        "bias": bias(rows),
        **origin.provenance,
        "warnings": origin.warnings(),
        "policies": {bundle.name: describe(bundle) for bundle in bundles},
    }
    print_warnings("study physics", summary["warnings"])
    write_rows(options.out / "physics.csv", rows)
    (options.out / "summary.json").write_text(summary_text(summary))
    if options.json:
        print(summary_text(summary), end="")
        return 0
    for name, apart in summary["bias"].items():
        said = "no walk to compare"
        if apart:
            said = (
                f"speed ratio at most {apart['largest_from_rows']:.3f} from rows at the contract's step, "
                f"{apart['largest_from_reference']:.3f} from rows at 0.25 ms"
            )
        print(f"{name:<34}{said}")
    return 0
