"""`stiction study stairs`: how high a policy climbs, without and with joint friction."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from stiction.studies.study import Options, Report, Study, Work

DESCRIPTION = """Drive policy bundles over stairs: up, a landing, down, height by height, at levels of joint friction.

Example: stiction study stairs bundles/stairs --step-heights 0.06 0.08 0.10 --out results/stairs"""


@dataclass(frozen=True, kw_only=True)
class StairsOptions(Options):
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


def run(options: StairsOptions, work: Work) -> Report:
    """Drive the bundles over every height at every level."""
    from stiction.evaluate.summary import describe
    from stiction.studies.stairs.climb import ClimbCfg, climb
    from stiction.studies.stairs.page import report

    cfg = ClimbCfg(options.step_heights, options.friction_levels, options.trials, options.speed, options.seed)
    bundles, rows = work.bundles(options.bundles), []
    work.begin()
    for bundle in bundles:
        rows += climb(bundle, cfg, work.threads, partial(work.progress, bundle.name))
    policies = {bundle.name: describe(bundle) for bundle in bundles}
    return report(rows, {"settings": asdict(cfg), "policies": policies})


STUDY = Study("how high a policy climbs, without and with joint friction", DESCRIPTION, StairsOptions, run)
