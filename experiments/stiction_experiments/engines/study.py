"""`stiction study engines`: whether every physics engine does what it should, and how the same policy walks in each."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from stiction.core.records import make_folder, part_of, read_rows
from stiction.engines.catalog import TIMESTEP
from stiction.files.results import DIRECTIONS
from stiction_experiments.lab.study import ParallelOptions, RedrawnOptions, Report, Study, Work, recorded

if TYPE_CHECKING:
    from stiction_experiments.engines.run import FigureRow
    from stiction_experiments.engines.walks import EpisodeRow, WalkRow

DESCRIPTION = (
    "Run the conformance suite in every physics engine that can be had here, and let the same policies walk in each, "
    "on flat ground. The exit status is 1 where a figure of the suite is out of bounds. Stop it at any time: the same "
    "command goes on. What is lost is the suite, which takes a minute, and for each core one policy's episodes in one "
    "simulator at one level and command."
)


@dataclass(frozen=True, kw_only=True)
class EnginesOptions(ParallelOptions, RedrawnOptions):
    """Options of `stiction study engines`."""

    engines: tuple[str, ...] | None = None
    """Some of mujoco, physx, ode, ode-webots, or one of your own, package.module:ENGINE (an `EngineSpec`); by default
    all shipped ones that can be had here; what others need is reported."""
    robot: str = "saturn_lite"
    """Robot that the suite is run with: go1, saturn_lite, or one of your own, package.module:NAME."""
    timesteps: tuple[float, ...] = (TIMESTEP,)
    """Physics steps of the suite [s]; its bounds are made for 0.002, the step at which policies walk in any case."""
    walks: bool = True
    """Let policies walk. The suite alone takes a minute."""
    policies: tuple[Path, ...] | None = None
    """Policies: directories or names of shipped bundles; by default the shipped ones for flat ground."""
    friction_levels: tuple[float, ...] = (0.0, 0.2)
    """Dry friction of the walks in every joint, as fractions of its torque limit [-]."""
    commands: tuple[str, ...] = DIRECTIONS
    """Commanded velocities; each must ask for motion."""
    episodes: int = 5
    """Walks of each policy in each simulator, per friction level and command."""
    seconds: float = 6.0
    """Length of a walk [s]; its first 2 s are not measured."""
    seed: int = 0
    """Seed of the first joint angles."""
    out: Path = Path("stiction-engines")
    """Directory for conformance.csv, pace.csv, walks.csv, episodes.csv, motions.png, walks.png, summary.json and
    report.html; and for walks, a file for the episodes of a policy in one simulator at one level and command."""


def run(options: EnginesOptions, work: Work) -> Report:
    """Run suite and walks; or draw the page of those of a folder anew."""
    if options.judge_again:
        return redrawn(options.out, work)
    from stiction.evaluation.evaluate import EvaluationCfg
    from stiction.evaluation.summary import describe
    from stiction.robots.catalog import find_robot
    from stiction_experiments.engines.page import EnginesResult, report
    from stiction_experiments.engines.run import check_timesteps, figure_rows, find_engines, pace_rows, traces
    from stiction_experiments.engines.walks import check_walks, find_simulators, walk_bundles

    cfg = part_of(EvaluationCfg, options)
    check_timesteps(options.timesteps)
    check_walks(cfg)
    bundles = work.bundles(options.policies) if options.walks else []
    if options.policies is None:
        bundles = [bundle for bundle in bundles if bundle.contract.terrain == "flat"]
    spec = find_robot(options.robot)
    engines, missing = find_engines(options.engines, spec)
    out = work.begin()
    figures: list[FigureRow] = []
    walks: list[WalkRow] = []
    episodes: list[EpisodeRow] = []
    for timestep in options.timesteps:
        for name in engines:
            figures += figure_rows(name, spec, timestep, partial(work.progress, f"{name}, {1000 * timestep:g} ms"))
    paces = [row for timestep in options.timesteps for row in pace_rows(engines, spec, timestep)]
    motions = traces(engines, spec, options.timesteps[0])
    if bundles:
        make_folder(out / "walks")
        simulators = find_simulators(engines)
        walks, episodes = walk_bundles(bundles, simulators, cfg, out / "walks", work.jobs, work.progress)
    result = EnginesResult(figures, paces, walks, episodes, motions, missing)
    settings = {
        "engines": engines,
        "robot": spec.name,
        "evaluation": asdict(cfg),
        "policies": {bundle.name: describe(bundle) for bundle in bundles},
        "seconds": work.seconds,
    }
    return report(result, settings)


def redrawn(out: Path, work: Work) -> Report:
    """Return the report of what a folder has, with the figure of one joint that was drawn of it."""
    from stiction_experiments.engines.page import EnginesResult, report
    from stiction_experiments.engines.run import FigureRow, PaceRow
    from stiction_experiments.engines.walks import EpisodeRow, WalkRow

    before = recorded(out, work, ("engines", "evaluation", "policies", "conformance"))
    walked = (out / "walks.csv").exists()
    result = EnginesResult(
        read_rows(out / "conformance.csv", FigureRow),
        read_rows(out / "pace.csv", PaceRow),
        read_rows(out / "walks.csv", WalkRow) if walked else [],
        read_rows(out / "episodes.csv", EpisodeRow) if walked else [],
        out / "motions.png",
        before["missing"],
    )
    return report(result, {"robot": EnginesOptions.robot} | before)


STUDY = Study(
    "whether every physics engine does what it should, and how the same policy walks in each",
    DESCRIPTION,
    EnginesOptions,
    run,
    results=("conformance.csv", "pace.csv", "walks.csv", "episodes.csv", "motions.png", "walks.png"),
)
