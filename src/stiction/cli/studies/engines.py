"""`stiction study engines`: whether every physics engine does what it should, and how the same policy walks in each."""

from __future__ import annotations

import shlex
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from stiction.cli.jobs import jobs_of

if TYPE_CHECKING:
    from stiction.formats.engines import FigureRow
    from stiction.report.engines import EnginesResult
    from stiction.transfer.engine_walks import Walk

DESCRIPTION = (
    "Run the conformance suite in every physics engine that can be had here, and let the same policies walk in each, "
    "on flat ground. The exit status is 1 where a figure of the suite is out of bounds. Stop it at any time: the same "
    "command goes on. What is lost is the suite, which takes a minute, and for each core one policy's episodes in one "
    "simulator at one level and command."
)

WIDE = 140
"""Width of the tables where standard output is a file or a pipe [characters]."""


@dataclass(frozen=True)
class EnginesStudy:
    """Options of `stiction study engines`."""

    engines: tuple[str, ...] | None = None
    """Some of mujoco, physx, ode, ode-webots; by default all that can be had here, and what others need is said."""
    timesteps: tuple[float, ...] = (0.002,)
    """Physics steps of the suite [s]; its bounds are made for 0.002. Policies walk at that step whatever this says."""
    walks: bool = True
    """Let policies walk. The suite alone takes a minute."""
    policies: tuple[Path, ...] | None = None
    """Policies: directories or names of shipped bundles; by default the shipped ones for flat ground."""
    friction_levels: tuple[float, ...] = (0.0, 0.2)
    """Dry friction of the walks in every joint, as fractions of its torque limit [-]."""
    commands: tuple[str, ...] = ("vx=0.5", "vx=-0.5")
    """Commanded velocities; each must ask for motion."""
    episodes: int = 5
    """Walks of each policy in each simulator, per friction level and command."""
    seconds: float = 6.0
    """Length of a walk [s]; its first 2 s are not measured."""
    seed: int = 0
    """Seed of the first joint angles."""
    jobs: int | None = None
    """Walks at once, each on one thread; by default as many as there are cores (STICTION_THREADS)."""
    out: Path = Path("stiction-engines")
    """Directory for conformance.csv, pace.csv, walks.csv, episodes.csv, motions.png, walks.png, summary.json and
    report.html; and for walks, a file for the episodes of a policy in one simulator at one level and command."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Run suite and walks, write the page, print the figures; return 1 where one is out of bounds."""
    options = tyro.cli(EnginesStudy, args=arguments, prog="stiction study engines", description=DESCRIPTION)
    import time
    from functools import partial

    from stiction.cli.terminal import print_warnings, work_progress
    from stiction.formats.folder import make_folder
    from stiction.formats.origin import Origin
    from stiction.formats.results import summary_text
    from stiction.report.engines import EnginesResult, as_summary, write_engines
    from stiction.transfer.engine_walks import check_walks, simulators, walk_bundles
    from stiction.transfer.engines.study import check_timesteps, figure_rows, find_engines, pace_rows, traces
    from stiction.transfer.evaluate import EvaluationCfg
    from stiction.transfer.summary import describe

    jobs = jobs_of(options.jobs)
    origin, start = Origin.now(), time.perf_counter()
    cfg = EvaluationCfg(options.friction_levels, options.commands, options.episodes, options.seconds, seed=options.seed)
    check_timesteps(options.timesteps)
    check_walks(cfg)
    bundles = _bundles(options) if options.walks else []
    engines = find_engines(options.engines)
    make_folder(options.out)
    figures: list[FigureRow] = []
    walked: list[Walk] = []
    with work_progress() as progress:
        for timestep in options.timesteps:
            for name in engines.here:
                work = f"{name}, {1000 * timestep:g} ms"
                figures += figure_rows(name, timestep, partial(progress, work))
        paces = [row for timestep in options.timesteps for row in pace_rows(engines.here, timestep)]
        motions = traces(engines.here, options.timesteps[0])
        if bundles:
            make_folder(options.out / "walks")
            walked = walk_bundles(bundles, simulators(engines.here), cfg, options.out / "walks", jobs, progress)
    episodes = tuple(episode for walk in walked for episode in walk.episodes)
    result = EnginesResult(
        tuple(figures), tuple(paces), motions, tuple(walk.row for walk in walked), episodes, engines.missing
    )
    summary: dict[str, Any] = {
        "command": shlex.join(["stiction", "study", "engines", *arguments]),
        "engines": engines.here,
        "evaluation": asdict(cfg),
        "policies": {bundle.name: describe(bundle) for bundle in bundles},
        "seconds": time.perf_counter() - start,
        **origin.provenance,
        "warnings": origin.warnings(),
        **as_summary(result),
    }
    print_warnings("study engines", summary["warnings"])
    page = write_engines(options.out, result, summary)
    if options.json:
        print(summary_text(summary), end="")
    else:
        _show(result)
        print("\n".join([*summary["answers"], f"report: {page}"]))
    return 1 if summary["failures"] else 0


def _bundles(options: EnginesStudy) -> list:
    """Return the checked bundles that are to walk, each of another name."""
    from stiction.deploy.check import check_bundle
    from stiction.formats.shipped import find_bundle, shipped_bundles
    from stiction.transfer.summary import check_names

    paths = options.policies if options.policies is not None else tuple(shipped_bundles().values())
    bundles = [check_bundle(find_bundle(path)).bundle for path in paths]
    if options.policies is None:
        bundles = [bundle for bundle in bundles if bundle.contract.terrain == "flat"]
    check_names([bundle.name for bundle in bundles])
    return bundles


def _show(result: EnginesResult) -> None:
    """Print the figures, a table a timestep."""
    from rich.console import Console
    from rich.table import Table

    from stiction.report.engine_tables import figure_table

    console = Console()
    if not console.is_terminal:
        console = Console(width=WIDE)
    for timestep in dict.fromkeys(row.timestep for row in result.figures):
        header, lines = figure_table(result.figures, timestep)
        shown = Table(title=f"steps of {1000 * timestep:g} ms")
        for number, name in enumerate(header):
            shown.add_column(name, justify="left" if number < 2 else "right", overflow="fold")
        for line in lines:
            shown.add_row(*line)
        console.print(shown)
