"""Crossings of stairs in other engines and on virtual robots, by the walks and the criterion of `evaluate`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.grid import GridCfg
from stiction.evaluation.run import Progress, walk_grid
from stiction.evaluation.table import rows_of
from stiction.files.bundle import Bundle
from stiction_experiments.paper.plan import VIRTUAL

COMMAND = "vx=0.4"
"""Commanded velocity."""


@dataclass(frozen=True)
class Climbed:
    """Stairs of one seed: a row of stairs.csv."""

    training: str
    seed: int
    place: str
    friction: str
    """As typed: a share of the torque limit, or `bench`."""
    height: float
    """Step height [m]."""
    crossed: float
    """Share of walks that cross [1]."""


@dataclass(frozen=True)
class Stairs:
    """Place with stairs: an engine, perhaps with virtual robots."""

    name: str
    engine: str
    levels: tuple[str, ...]
    """Friction over the torque limit; `bench`: the paper's values."""
    heights: tuple[float, ...]
    """Step heights [m]."""
    episodes: int
    """Walks of a height, on each robot."""
    trainings: tuple[str, ...]
    """Names of the trainings that walk there."""
    robots: tuple[int, ...] = ()
    """Virtual robots; none: the robot of the data sheet."""

    def grid(self, level: str) -> GridCfg:
        """Return the walks at one level of friction."""
        base = EvaluationCfg((0.0,), (COMMAND,), self.episodes)
        terrains = tuple(f"stairs={height:g}" for height in self.heights)
        if not self.robots:
            base = replace(base, friction_levels=(float(level),))
            return GridCfg(base, (self.engine,), terrains)
        return GridCfg(base, (self.engine,), terrains, self.robots, (level,))


STAIRS = (
    Stairs("webots", "ode-webots", ("0",), (0.04, 0.08, 0.12, 0.16), 10, ("stairs-deception", "stairs-none")),
    Stairs("robots", "physx+all", ("bench", "0.2"), (0.08, 0.12), 5, ("stairs-deception", "stairs-net"), VIRTUAL[:2]),
)
"""Places with stairs."""


def of_level(progress: Progress, level: str, _: str, share: float) -> None:
    """Say how far the walks under one friction are."""
    progress(f"friction {level}", share)


def climb(
    training: str,
    bundles: Sequence[Bundle],
    stairs: Stairs,
    folder: Path,
    jobs: int,
    progress: Progress,
) -> list[Climbed]:
    """Let the policies of a training cross the stairs of a place; folder: of the ledgers, where it goes on."""
    seeds = {bundle.name: bundle.contract.seed for bundle in bundles}
    climbed = []
    for level in stairs.levels:
        watch = partial(of_level, progress, level)
        for row in rows_of(walk_grid(bundles, stairs.grid(level), folder / level, jobs, progress=watch), bundles)[1]:
            height, place = float(row["terrain"].removeprefix("stairs=")), (stairs.name, level)
            climbed.append(Climbed(training, seeds[row["policy"]], *place, height, row["crossed"]))
    return climbed
