"""`stiction study bench`: virtual robots on their benches, identified, and what was found held against the truth."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from stiction.core.errors import ConfigurationError, StictionError, check_once
from stiction.report.terminal import RobotSeeds
from stiction_experiments.lab.study import ParallelOptions, Report, Study, Work

DESCRIPTION = """Put virtual robots on their benches, log every joint, identify them, and hold what was found against
what was there.

Each robot has a folder of its own with what a person with that robot would have: bench.npz and bench.json, its log;
joints.json and training.json, what `stiction identify` makes of it. The truth stands in bench.csv and report.html
alone. Stop it at any time: the same command goes on with the robots that are missing; one in progress, some minutes, is
begun anew."""


@dataclass(frozen=True, kw_only=True)
class BenchOptions(ParallelOptions):
    """Options of `stiction study bench`."""

    engine: Literal["mujoco", "physx", "ode", "ode-webots"] = "physx"
    """Physics engine that the robots are in."""
    robots: RobotSeeds = (1000, 1001, 1002)
    levels: tuple[str, ...] = ("0.1", "bench+0.02")
    """Their dry friction: fractions of the torque limit, bench (what was measured of each kind of joint), bench+0.02
    (and that coefficient of the load)."""
    cell: str = "all"
    """Real effects of the robots: all, friction alone, or groups joined by +; without friction, level 0 alone."""
    robot: str = "saturn_lite"
    """Data sheet of the robots: a shipped one, or your own, `package.module:NAME`."""
    seconds: float = 20.0
    """Length of the log of each kind of joint [s]."""
    out: Path = Path("stiction-bench")
    """Directory for the robots' folders, bench.csv, summary.json, bench.png and report.html."""

    def __post_init__(self) -> None:
        """Refuse no work, and the same work twice, at once."""
        for name in ("robots", "levels"):
            check_once(f"--{name}", getattr(self, name))


def run(options: BenchOptions, work: Work) -> Report:
    """Log and identify the robots; the exit status is 1 if one could not be identified."""
    from dataclasses import asdict

    from stiction.robots.catalog import find_robot
    from stiction.virtual.bench import Bench, BenchCfg
    from stiction.virtual.cases import factorial, warnings_on
    from stiction_experiments.bench.page import report
    from stiction_experiments.bench.robots import study_benches

    spec, cfg = find_robot(options.robot), BenchCfg(seconds=options.seconds)
    cases = factorial(options.robots, options.levels, (options.cell,))
    benches = [Bench(options.engine, case, spec, cfg) for case in cases]
    out = work.begin()
    rows, failed = study_benches(benches, out, work.jobs, work.progress)
    for label, reason in failed.items():
        work.say(f"{label}: {reason}")
    if not rows:
        raise ConfigurationError("no robot could be identified, so there is no page")
    steps = {bench.label: next_step(out / bench.label) for bench in benches if bench.label not in failed}
    settings = {
        "seconds": work.seconds,
        "bench": asdict(cfg),
        "engine": options.engine,
        "cell": options.cell,
        "failed": failed,
    }
    return report(rows, steps, settings, warnings_on(options.robots))


def next_step(folder: Path) -> str:
    """Return the command that trains with what was found of a robot, or why there is nothing to train with."""
    from stiction.files.joints import read_training

    file = folder / "training.json"
    try:
        read_training(file)
    except StictionError as error:
        return str(error)
    return shlex.join(["stiction", "train", "--friction-from", str(file)])


STUDY = Study(
    "what identification finds of virtual robots on their benches, held against the truth",
    DESCRIPTION,
    BenchOptions,
    run,
    results=("bench.csv", "bench.png"),
)
