"""`stiction study wear BUNDLE...`: how long policies follow while friction grows, and whether monitors notice it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

from stiction.core.errors import FileError
from stiction.core.flags import ARGUMENT
from stiction.core.records import part_of, read_rows
from stiction.report.terminal import RobotSeeds
from stiction_experiments.lab.straight import FAST, SLOW
from stiction_experiments.lab.study import ParallelOptions, RedrawnOptions, Report, Study, UsageError, Work, recorded

DESCRIPTION = f"""Let policies walk on virtual robots whose friction grows from x0.3, seals out, to x3 of a level.

A policy's lifetime lasts while it follows its commands, forward and backward, from the first to the last time: it
ends where the policy is too slow for good, under {SLOW}, too fast, over {FAST}, or where the robot falls. Too fast at
first, it has not begun to follow. A bundle's wear monitor, if it has one, reads the policy's input: does it notice
before that? And would it have noticed as much had nothing grown? Stop it at any time: the same command goes on. What is
lost is the walks in progress, one a core, under a minute each in PhysX.

Example:
  stiction study wear saturn_lite-flat-none-0.2 saturn_lite-flat-deception-0.2 --out results/wear"""


@dataclass(frozen=True, kw_only=True)
class WearOptions(ParallelOptions, RedrawnOptions):
    """Options of `stiction study wear`."""

    bundles: Annotated[tuple[Path, ...], ARGUMENT]
    """Directories of the bundles, or names of shipped ones; none for --judge-again."""
    engine: str = "physx"
    """Physics engine: physx, ode, ode-webots, mujoco."""
    levels: tuple[str, ...] = ("0.1",)
    """Levels of dry friction that wear multiplies: fractions of each joint's torque limit, or `bench`."""
    robots: RobotSeeds = (1000, 1001, 1002, 1003, 1004)
    joint: str | None = None
    """The joint (FL_shank) or the kind of joints (shank) that wears; by default all do. The others stay at x1."""
    cell: str = "all"
    """Real effects of the robots: all, friction, or groups such as friction+delays."""
    start: float = 0.3
    """Wear at the beginning [1]."""
    end: float = 3.0
    """Wear at the end [1]; in between it grows by equal ratios."""
    seconds: float = 120.0
    """Time from `start` to `end` [s]; a window at `end` follows. In PhysX some 36 s on one core, and so six
    minutes for the five robots of a policy, both ways, eighteen with their controls."""
    control: bool = True
    """Let every robot also walk with friction that stays at `start`, and at x1: what a monitor notices there is a false
    alarm, and a lifetime that ends there did not end by growth."""
    commands: tuple[str, ...] = ("vx=0.5", "vx=-0.5")
    """Commanded velocities, a walk each: a robot follows where it follows all of them."""
    window: float = 10.0
    """Time over which the speed is averaged [s]."""
    out: Path = Path("stiction-wear")
    """Directory for lives.csv, windows.csv, readings.csv, summary.json, figures, report.html; and for robots, a file
    for every walk."""


def run(options: WearOptions, work: Work) -> Report:
    """Wear robots out under the bundles, or judge those of before."""
    if options.judge_again:
        return judge_recorded(options.out, work)
    if not options.bundles:
        raise UsageError("no bundle given")
    from stiction.evaluation.summary import describe
    from stiction.evaluation.table import methods_of
    from stiction.files.bundle import find_bundle
    from stiction.virtual.cases import warnings_on
    from stiction.virtual.robot import Wear
    from stiction_experiments.wear.lifetimes import groups, over_seeds
    from stiction_experiments.wear.page import report
    from stiction_experiments.wear.run import WearCfg, study_wear, untrained_notes

    wear = part_of(Wear, options, joints=() if options.joint is None else (options.joint,))
    cfg = part_of(WearCfg, options, wear=wear)
    paths = [find_bundle(path) for path in options.bundles]
    bundles = work.bundles(paths)
    robots = work.begin() / "robots"
    lifetimes, windows, readings = study_wear(bundles, paths, cfg, robots, work.jobs, work.progress)
    settings = {
        "settings": asdict(cfg),
        "policies": {bundle.name: describe(bundle) | {"monitor": bundle.wear is not None} for bundle in bundles},
        "groups": groups(lifetimes),
        "ways": over_seeds(lifetimes, methods_of(lifetimes, bundles), (wear.start, wear.end)),
    }
    return report(lifetimes, windows, readings, settings, [*warnings_on(cfg.robots), *untrained_notes(bundles, cfg)])


def judge_recorded(out: Path, work: Work) -> Report:
    """Judge the walks of a folder anew, by the speeds and readings in its files."""
    from stiction_experiments.wear.lifetimes import Reading, Window, groups, judge_again, over_seeds
    from stiction_experiments.wear.page import report

    before = recorded(out, work)
    windows = read_rows(out / "windows.csv", Window)
    readings = read_rows(out / "readings.csv", Reading, optional=True)
    try:
        lifetimes = judge_again(before["lives"], windows, readings)
        tried = before["settings"]["wear"]["start"], before["settings"]["wear"]["end"]
        methods = {policy: method["way"] for method in before["ways"] for policy in method["policies"]}
    except KeyError as error:
        raise FileError(f"{out / 'summary.json'} is none of `stiction study wear`: no {error}") from error
    known = [row for row in lifetimes if row.policy in methods]
    settings = before | {"groups": groups(lifetimes), "ways": over_seeds(known, methods, tried)}
    return report(lifetimes, windows, readings, settings)


STUDY = Study(
    "how long a policy follows while friction grows, and whether its monitor notices in time",
    DESCRIPTION,
    WearOptions,
    run,
    results=("lives.csv", "windows.csv", "readings.csv", "wear.png", "monitor.png"),
)
