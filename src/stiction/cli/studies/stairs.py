"""`stiction study stairs`: how high a policy climbs, without and with joint friction."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

DESCRIPTION = """Drive policy bundles over stairs: up, a landing, down, height by height, at levels of joint friction.

Example: stiction study stairs bundles/stairs --step-heights 0.06 0.08 0.10 --out results/stairs"""


@dataclass(frozen=True)
class StairsCfg:
    """Options of `stiction study stairs`."""

    bundles: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Directories of the bundles, or names of shipped ones."""
    step_heights: tuple[float, ...] = (0.02, 0.04, 0.06, 0.08, 0.10, 0.12, 0.14)
    """Heights of a step [m]."""
    friction_levels: tuple[float, ...] = (0.0, 0.2)
    """Dry friction in every joint, as fractions of its torque limit [-]."""
    trials: int = 100
    """Trials per height and level."""
    speed: float = 0.4
    """Commanded speed [m/s]."""
    seed: int = 0
    """Seed of starts and sensor noise."""
    out: Path = Path("stiction-stairs")
    """Directory for stairs.csv, summary.json, stairs.png and report.html."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Drive the bundles, write the results, print the answers."""
    cfg = tyro.cli(StairsCfg, args=arguments, prog="stiction study stairs", description=DESCRIPTION)
    if not cfg.bundles:
        print("stiction study stairs: no bundle given; --help shows the usage", file=sys.stderr)
        return 2
    from stiction.cli.terminal import print_warnings, work_progress
    from stiction.deploy.check import check_bundle
    from stiction.formats.folder import make_folder
    from stiction.formats.origin import Origin
    from stiction.formats.reproducibility import num_threads
    from stiction.formats.results import summary_text
    from stiction.formats.shipped import find_bundle
    from stiction.report.stairs import answers, write_stairs
    from stiction.transfer.stairs import ClimbCfg, climb
    from stiction.transfer.summary import check_names, describe

    settings = ClimbCfg(cfg.step_heights, cfg.friction_levels, cfg.trials, cfg.speed, cfg.seed)
    bundles = [check_bundle(find_bundle(path)).bundle for path in cfg.bundles]
    check_names([bundle.name for bundle in bundles])
    make_folder(cfg.out)
    origin, rows = Origin.now(), []
    with work_progress() as progress:
        for bundle in bundles:
            rows += climb(bundle, settings, num_threads(), partial(progress, bundle.name))
    summary = {
        "command": shlex.join(["stiction", "study", "stairs", *arguments]),
        "settings": asdict(settings),
        **origin.provenance,
        "warnings": origin.warnings(),
        "policies": {bundle.name: describe(bundle) for bundle in bundles},
        "rows": [asdict(row) for row in rows],
    }
    print_warnings("study stairs", summary["warnings"])
    page = write_stairs(cfg.out, rows, summary)
    if cfg.json:
        print(summary_text(summary), end="")
    else:
        print("\n".join(answers(rows)))
        print(f"report: {page}")
    return 0
