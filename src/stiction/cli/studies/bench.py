"""`stiction study bench`: virtual robots on their benches, identified, and what was found held against the truth."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from stiction.cli.jobs import jobs_of
from stiction.cli.virtual_robots import RobotSeeds
from stiction.formats.errors import StictionError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiction.transfer.robot.bench import BenchCfg
    from stiction.transfer.robot.identification import Bench

DESCRIPTION = """Put virtual robots on their benches, log every joint, identify them, and hold what was found against
what was there.

Each robot has a folder of its own with what a person with that robot would have: bench.npz and bench.json, its log;
joints.json and training.json, what `stiction identify` makes of it. The truth stands in bench.csv and report.html
alone. Stop it at any time: the same command goes on with the robots that are missing; one in progress, some minutes, is
begun anew."""


@dataclass(frozen=True)
class BenchStudy:
    """Options of `stiction study bench`."""

    engine: Literal["mujoco", "physx", "ode", "ode-webots"] = "physx"
    """Physics engine that the robots are in."""
    robots: RobotSeeds = (1000, 1001, 1002)
    levels: tuple[str, ...] = ("0.1", "bench+0.02")
    """Their dry friction: fractions of the torque limit, bench (what was measured of each kind of joint), bench+0.02
    (and that coefficient of the load)."""
    cell: str = "all"
    """What of them is real: all, friction (nothing else), or groups joined by +. Cells without friction have level 0
    alone."""
    robot: str = "saturn_lite"
    """Data sheet of the robots: a shipped one, or your own, `package.module:NAME`."""
    seconds: float = 20.0
    """Length of the log of each kind of joint [s]."""
    jobs: int | None = None
    """Robots at once; by default as many as there are cores (STICTION_THREADS)."""
    out: Path = Path("stiction-bench")
    """Directory for the robots' folders, bench.csv, summary.json, bench.png and report.html."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""

    def __post_init__(self) -> None:
        """Refuse no work, and the same work twice, at once."""
        for name in ("robots", "levels"):
            given = getattr(self, name)
            if not given or len(set(given)) < len(given):
                raise StictionError(f"--{name} {' '.join(map(str, given))}: expected at least one, each once")


def main(arguments: list[str]) -> int:
    """Run the study; return 1 if a robot could not be identified."""
    options = tyro.cli(BenchStudy, args=arguments, prog="stiction study bench", description=DESCRIPTION)
    jobs = jobs_of(options.jobs)
    import time
    from dataclasses import asdict

    from stiction.cli.terminal import print_warnings, work_progress
    from stiction.formats.folder import make_folder
    from stiction.formats.origin import Origin
    from stiction.formats.results import summary_text
    from stiction.report.bench import lead, scores, write_bench
    from stiction.transfer.robot.bench import BenchCfg
    from stiction.transfer.robot.bench_study import study_benches
    from stiction.transfer.robot.seeds import warnings_on

    cfg = BenchCfg(seconds=options.seconds)
    benches = benches_of(options, cfg)
    make_folder(options.out)
    origin, start = Origin.now(), time.perf_counter()
    with work_progress() as progress:
        rows, failed = study_benches(benches, options.out, jobs, progress)
    for label, reason in failed.items():
        print(f"stiction study bench: {label}: {reason}", file=sys.stderr)
    if not rows:
        raise StictionError("no robot could be identified, so there is no page")
    steps = {bench.label: next_step(options.out / bench.label) for bench in benches if bench.label not in failed}
    summary = {
        "command": shlex.join(["stiction", "study", "bench", *arguments]),
        **origin.provenance,
        "seconds": time.perf_counter() - start,
        "bench": asdict(cfg),
        "engine": options.engine,
        "cell": options.cell,
        "failed": failed,
        "warnings": [*origin.warnings(), *warnings_on(options.robots)],
        "next": steps,
        "scores": scores(rows),
        "lead": lead(rows),
    }
    print_warnings("study bench", summary["warnings"])
    page = write_bench(options.out, rows, steps, summary)
    if options.json:
        print(summary_text(summary), end="")
    else:
        print(f"{summary['lead']}\nreport: {page}")
        for label, step in steps.items():
            print(f"next: {step}" if step.startswith("stiction") else f"{label}: {step}")
    return 1 if failed else 0


def benches_of(options: BenchStudy, cfg: BenchCfg) -> Sequence[Bench]:
    """Return the robots on their benches that the options ask for."""
    from stiction.robots.catalog import find_robot
    from stiction.transfer.robot.factorial import factorial
    from stiction.transfer.robot.identification import Bench

    spec = find_robot(options.robot)
    cases = factorial(options.robots, options.levels, (options.cell,))
    return [Bench(options.engine, case, spec, cfg) for case in cases]


def next_step(folder: Path) -> str:
    """Return the command that trains with what was found of a robot, or why there is nothing to train with."""
    from stiction.formats.training import read_training

    file = folder / "training.json"
    try:
        read_training(file)
    except StictionError as error:
        return str(error)
    return shlex.join(["stiction", "train", "--friction-from", str(file)])
