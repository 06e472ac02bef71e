"""`stiction study physics BUNDLE...`: what a faster simulation of joint friction does to the speed of a walk."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import tyro

from stiction.studies.study import Options, Report, Study, Work

DESCRIPTION = (
    "Drive the same policies with the joints' friction simulated by rows of the solver, by softer rows and by yielding "
    "springs, at several steps, and hold their speeds against rows at 0.25 ms. Evaluation is always on rows at the "
    "step of the contract; this says what training on another physics may cost."
)


@dataclass(frozen=True, kw_only=True)
class PhysicsOptions(Options):
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


def run(options: PhysicsOptions, work: Work) -> Report:
    """Drive the policies in every physics; say how far each is from the others."""
    from stiction.evaluate.summary import describe
    from stiction.studies.physics.walks import WalkCfg, bias, compare

    cfg = WalkCfg(options.friction_levels, options.speed, options.episodes, options.seconds, options.seed)
    bundles = {bundle.name: bundle for bundle in work.bundles(options.policies)}
    work.begin()
    rows = compare(bundles, cfg, work.threads, work.progress)
    found, said = bias(rows), []
    for name, apart in found.items():
        line = "no walk to compare"
        if apart:
            line = (
                f"speed ratio at most {apart['largest_from_rows']:.3f} from rows at the contract's step, "
                f"{apart['largest_from_reference']:.3f} from rows at 0.25 ms"
            )
        said.append(f"{name:<34}{line}")
    policies = {name: describe(bundle) for name, bundle in bundles.items()}
    return Report(
        tables={"physics": rows}, summary={"walks": asdict(cfg), "bias": found, "policies": policies}, answer=said
    )


STUDY = Study(
    "what a faster simulation of joint friction does to the speed of a walk", DESCRIPTION, PhysicsOptions, run
)
