"""`stiction study stairs`: how high a policy climbs, without and with joint friction."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated

from stiction.core.flags import ARGUMENT, FLAT
from stiction.core.records import read_rows
from stiction_experiments.lab.study import RedrawnOptions, Report, Study, UsageError, Work, recorded
from stiction_experiments.stairs.config import ClimbCfg

DESCRIPTION = """Drive policy bundles over stairs: up, a landing, down, height by height, at levels of joint friction.

Example:
  stiction study stairs bundles/stairs --step-heights 0.06 0.08 0.10 --out results/stairs"""


@dataclass(frozen=True, kw_only=True)
class StairsOptions(RedrawnOptions):
    """Options of `stiction study stairs`."""

    bundles: Annotated[tuple[Path, ...], ARGUMENT]
    """Directories of the bundles, or names of shipped ones."""
    config: Annotated[ClimbCfg, FLAT] = field(default_factory=ClimbCfg)
    """Settings of the climbs."""
    out: Path = Path("stiction-stairs")
    """Directory for stairs.csv, summary.json, stairs.png and report.html."""


def run(options: StairsOptions, work: Work) -> Report:
    """Drive the bundles over every height at every level."""
    from stiction.evaluation.summary import describe
    from stiction_experiments.stairs.climb import Climb, climb
    from stiction_experiments.stairs.page import report

    if options.judge_again:
        earlier = recorded(options.out, work, ("settings", "policies"))
        return report(read_rows(options.out / "stairs.csv", Climb), earlier)
    if not options.bundles:
        raise UsageError("no bundle given")
    bundles, rows = work.bundles(options.bundles), []
    work.begin()
    for bundle in bundles:
        rows += climb(bundle, options.config, work.threads, partial(work.progress, bundle.name))
    policies = {bundle.name: describe(bundle) for bundle in bundles}
    return report(rows, {"settings": asdict(options.config), "policies": policies})


STUDY = Study(
    "how high a policy climbs, without and with joint friction",
    DESCRIPTION,
    StairsOptions,
    run,
    results=("stairs.csv", "stairs.png"),
)
