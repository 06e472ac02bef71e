"""`stiction study wear BUNDLE...`: how long policies live while friction grows, and whether their monitors see it."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import tyro

from stiction.cli.jobs import jobs_of
from stiction.cli.virtual_robots import RobotSeeds

DESCRIPTION = """Let policies walk on virtual robots whose friction grows from x0.3, seals out, to x3 of a level.

A policy's life is the factor at which its speed falls under 80 % of the command for good, or at which the robot falls.
A bundle's wear monitor, if it has one, listens to what the policy sees: does it notice before that? And would it have
noticed as much had nothing grown? Stop it at any time: the same command goes on. What is lost is the walks in progress,
one a core, under a minute each in PhysX.

Example: stiction study wear saturn_lite-flat-none-0.2 saturn_lite-flat-deception-0.2 --out results/wear"""


@dataclass(frozen=True)
class WearStudy:
    """Options of `stiction study wear`."""

    bundles: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Directories of the bundles, or names of shipped ones."""
    engine: str = "physx"
    """Physics engine: physx, ode, ode-webots, mujoco."""
    levels: tuple[str, ...] = ("0.1",)
    """Levels of dry friction that wear multiplies: fractions of each joint's torque limit, or `bench`."""
    robots: RobotSeeds = (1000, 1001, 1002, 1003, 1004)
    joint: str | None = None
    """The joint (FL_shank) or the kind of joints (shank) that wears; by default all do. The others stay at x1."""
    cell: str = "all"
    """What is real about the robots: all, friction, or groups such as friction+delays."""
    start: float = 0.3
    """Wear at the beginning [1]."""
    end: float = 3.0
    """Wear at the end [1]; in between it grows by equal ratios."""
    seconds: float = 120.0
    """Time from `start` to `end` [s]; a window at `end` follows. In PhysX some 36 s on one core, and so three
    minutes for the five robots of a policy, nine with their controls."""
    control: bool = True
    """Let every robot also walk with friction that stays at `start`, and at x1: what a monitor notices there is a false
    alarm, and a life that ends there did not end by growth."""
    command: str = "vx=0.5"
    """Commanded velocity."""
    window: float = 10.0
    """Time over which the speed is averaged [s]."""
    jobs: int | None = None
    """Walks at once, each on one thread; by default as many as there are cores (STICTION_THREADS)."""
    out: Path = Path("stiction-wear")
    """Directory for lives.csv, windows.csv, readings.csv, summary.json, figures, report.html; and for robots, a file
    for every walk."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Wear robots out under the bundles, write the results, print the answers."""
    options = tyro.cli(WearStudy, args=arguments, prog="stiction study wear", description=DESCRIPTION)
    if not options.bundles:
        print("stiction study wear: no bundle given; --help shows the usage", file=sys.stderr)
        return 2
    from stiction.cli.terminal import print_warnings, work_progress
    from stiction.deploy.check import check_bundle
    from stiction.formats.folder import make_folder
    from stiction.formats.origin import Origin
    from stiction.formats.results import summary_text
    from stiction.formats.shipped import find_bundle
    from stiction.report.wear import answers, write_wear
    from stiction.transfer.grid.table import ways_of
    from stiction.transfer.robot.seeds import warnings_on
    from stiction.transfer.robot.wear import Wear
    from stiction.transfer.summary import check_names, describe
    from stiction.transfer.wear_life import groups, over_seeds
    from stiction.transfer.wear_study import WearCfg, study_wear

    jobs, origin = jobs_of(options.jobs), Origin.now()
    joints = () if options.joint is None else (options.joint,)
    wear = Wear(joints, options.start, options.end, options.seconds)
    names = ("engine", "levels", "cell", "robots", "command", "window", "control")
    cfg = WearCfg(wear=wear, **{name: getattr(options, name) for name in names})
    paths = [find_bundle(path) for path in options.bundles]
    bundles = [check_bundle(path).bundle for path in paths]
    check_names([bundle.name for bundle in bundles])
    make_folder(options.out / "robots")
    with work_progress() as progress:
        lives, windows, readings = study_wear(bundles, paths, cfg, options.out / "robots", jobs, progress)
    summary = {
        "command": shlex.join(["stiction", "study", "wear", *arguments]),
        "settings": asdict(cfg),
        "warnings": [*origin.warnings(), *warnings_on(cfg.robots)],
        **origin.provenance,
        "policies": {bundle.name: describe(bundle) | {"monitor": bundle.wear is not None} for bundle in bundles},
        "groups": groups(lives),
        "ways": over_seeds(lives, ways_of(lives, bundles), (wear.start, wear.end)),
        "lives": [asdict(one) for one in lives],
    }
    print_warnings("study wear", summary["warnings"])
    page = write_wear(options.out, lives, windows, readings, summary)
    if options.json:
        print(summary_text(summary), end="")
    else:
        print("\n".join(answers(summary["groups"], cfg.wear.end, summary["ways"])))
        print(f"report: {page}")
    return 0
