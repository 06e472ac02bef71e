"""`stiction study physics BUNDLE...`: what a faster simulation of joint friction does to the speed of a walk."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

from stiction.core.flags import ARGUMENT, FLAT
from stiction_experiments.lab.study import Options, Report, Study, Work
from stiction_experiments.physics.config import WalkCfg

DESCRIPTION = (
    "Drive the same policies with the joints' friction simulated by rows of the solver, by softer rows and by yielding "
    "springs, at several steps, and hold their speeds against rows at 0.25 ms. Evaluation is always on rows at the "
    "step of the contract; this shows what training on another physics may cost.\n\n"
    "Example:\n  stiction study physics saturn_lite-flat-none-0.2 --out physics"
)


@dataclass(frozen=True, kw_only=True)
class PhysicsOptions(Options):
    """Options of `stiction study physics`."""

    policies: Annotated[tuple[Path, ...], ARGUMENT]
    """Policy bundles: directories, or names of shipped ones."""
    config: Annotated[WalkCfg, FLAT] = field(default_factory=WalkCfg)
    """Settings of the walks."""
    out: Path = Path("stiction-physics")
    """Directory for physics.csv and summary.json."""


def run(options: PhysicsOptions, work: Work) -> Report:
    """Drive the policies in every physics; report how far each is from the others."""
    from stiction.evaluation.summary import describe
    from stiction_experiments.physics.walks import REFERENCE, bias, compare

    bundles = {bundle.name: bundle for bundle in work.bundles(options.policies)}
    work.begin()
    rows = compare(bundles, options.config, work.threads, work.progress)
    biases, lines = bias(rows), []
    for name, apart in biases.items():
        line = "no walk to compare"
        if apart:
            line = (
                f"speed ratio at most {apart['largest_from_rows']:.3f} from rows at the contract's step, "
                f"{apart['largest_from_reference']:.3f} from {REFERENCE}"
            )
        lines.append(f"{name:<34}{line}")
    policies = {name: describe(bundle) for name, bundle in bundles.items()}
    summary = {"walks": asdict(options.config), "bias": biases, "policies": policies}
    return Report(tables={"physics": rows}, summary=summary, answer=lines)


STUDY = Study(
    "what a faster simulation of joint friction does to the speed of a walk",
    DESCRIPTION,
    PhysicsOptions,
    run,
    results=("physics.csv",),
)
