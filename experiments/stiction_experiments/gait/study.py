"""`stiction study gait BUNDLE...`: the gaits of policies trained with and without r_trot and r_unsync."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from stiction.core.errors import ConfigurationError
from stiction.core.flags import ARGUMENT
from stiction.core.records import part_of, read_rows
from stiction.files.results import DIRECTIONS
from stiction_experiments.lab.study import RedrawnOptions, Report, Study, UsageError, Work, recorded

DESCRIPTION = (
    "Drive policies over commands and show which feet are on the ground when: gait diagram, shares of each contact "
    "group, flight, synchrony; and judge the paper's sentences on its two gait rewards. Which rewards a policy had is "
    "read off the training command in its contract, or off the run. Train the ablations with `stiction train "
    "--set task.rewards.trot=0`, `--set task.rewards.unsync=0`, and both.\n\n"
    "Example:\n  stiction study gait saturn_lite-flat-none-0.2 saturn_lite-flat-deception-0.2 --out gait"
)


@dataclass(frozen=True, kw_only=True)
class GaitOptions(RedrawnOptions):
    """Options of `stiction study gait`."""

    policies: Annotated[tuple[Path, ...], ARGUMENT]
    """Policy bundles: directories, names of shipped ones, or finished training runs, which are exported first."""
    variants: tuple[Literal["both", "no-trot", "no-unsync", "neither"], ...] = ()
    """Gait rewards of each policy, in order, where its training command does not name them."""
    commands: tuple[str, ...] = DIRECTIONS
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
    """A robot of your own, its file or `package.module:NAME`; by default the robot that the bundle names."""
    out: Path = Path("stiction-gait")
    """Directory for gaits.csv, feet.csv, claims.csv, contacts.npz, gait.png, summary.json and report.html."""


def run(options: GaitOptions, work: Work) -> Report:
    """Check and drive the policies, judge what they do; or judge what a folder has."""
    if options.judge_again:
        return redrawn(options.out, work)
    if not options.policies:
        raise UsageError("no bundle given")
    if options.variants and len(options.variants) != len(options.policies):
        raise ConfigurationError(
            f"{len(options.variants)} variants for {len(options.policies)} policies; expected one each, or none"
        )
    from dataclasses import asdict
    from functools import partial

    from stiction.evaluation.evaluate import EvaluationCfg
    from stiction.evaluation.summary import describe
    from stiction_experiments.gait.claims import judge
    from stiction_experiments.gait.measure import trained_alike, trained_variant, walk_gaits
    from stiction_experiments.gait.page import report

    cfg = part_of(EvaluationCfg, options, friction_levels=(options.friction_level,))
    out = work.begin()
    bundles = work.bundles([_exported(path, out) for path in options.policies])
    variants: tuple[str, ...] = options.variants or tuple(
        trained_variant(bundle.contract.command) for bundle in bundles
    )
    walked = []
    for bundle, variant in zip(bundles, variants, strict=True):
        progress = partial(work.progress, bundle.name)
        walked += walk_gaits(bundle, variant, cfg, options.robot, work.threads, progress)
    gaits = [one.row for one in walked]
    alike = trained_alike([describe(bundle) | {"terrain": bundle.contract.terrain} for bundle in bundles])
    named = zip(bundles, variants, strict=True)
    settings = {
        "evaluation": asdict(cfg),
        "seconds": work.seconds,
        "policies": {bundle.name: describe(bundle) | {"variant": variant} for bundle, variant in named},
    }
    return report(gaits, [foot for one in walked for foot in one.feet], judge(gaits, alike), settings, walked)


def redrawn(out: Path, work: Work) -> Report:
    """Return the report of the walks that a folder has, with the gait diagram that was drawn of them."""
    from stiction_experiments.gait.claims import judge
    from stiction_experiments.gait.measure import FootRow, GaitRow, trained_alike
    from stiction_experiments.gait.page import report

    before = recorded(out, work, ("policies", "evaluation", "gaits"))
    gaits, feet = read_rows(out / "gaits.csv", GaitRow), read_rows(out / "feet.csv", FootRow)
    alike = trained_alike(list(before["policies"].values()))
    return report(gaits, feet, judge(gaits, alike), before, drawn=out / "gait.png")


def _exported(path: Path, out: Path) -> Path:
    """Return the bundle that a path means; a training run is exported into `out` under its own name."""
    if not (path / "config.json").is_file():
        return path
    bundle = out / "bundles" / path.name
    if not bundle.exists():
        from stiction.evaluation.export import export_run

        export_run(path, bundle)
    return bundle


STUDY = Study(
    "which feet are down when, with and without the two gait rewards",
    DESCRIPTION,
    GaitOptions,
    run,
    results=("gaits.csv", "feet.csv", "contacts.npz", "gait.png"),
)
