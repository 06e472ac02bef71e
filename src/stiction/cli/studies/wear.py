"""`stiction study wear BUNDLE...`: how long policies live while friction grows, and whether their monitors see it."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from stiction.cli.jobs import jobs_of
from stiction.cli.virtual_robots import RobotSeeds

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiction.formats.life import Life, Reading, Window

Summary = dict[str, Any]
"""What stands in summary.json."""

DESCRIPTION = """Let policies walk on virtual robots whose friction grows from x0.3, seals out, to x3 of a level.

A policy lives while it follows its command, from the first to the last time: its life ends where it is too slow for
good, under 80 %, or where the robot falls. Too fast at first, over 120 %, it has not begun to follow.
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
    judge_again: bool = False
    """Walk nothing: judge what --out has by today's criteria, and draw its page anew. No bundle is needed."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Wear robots out under the bundles, write the results, print the answers."""
    options = tyro.cli(WearStudy, args=arguments, prog="stiction study wear", description=DESCRIPTION)
    command = shlex.join(["stiction", "study", "wear", *arguments])
    if options.judge_again:
        judge_again(options, command)
        return 0
    if not options.bundles:
        print("stiction study wear: no bundle given; --help shows the usage", file=sys.stderr)
        return 2
    from stiction.cli.terminal import print_warnings, work_progress
    from stiction.deploy.check import check_bundle
    from stiction.formats.folder import make_folder
    from stiction.formats.origin import Origin
    from stiction.formats.shipped import find_bundle
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
        "command": command,
        "settings": asdict(cfg),
        "warnings": [*origin.warnings(), *warnings_on(cfg.robots)],
        **origin.provenance,
        "policies": {bundle.name: describe(bundle) | {"monitor": bundle.wear is not None} for bundle in bundles},
        "groups": groups(lives),
        "ways": over_seeds(lives, ways_of(lives, bundles), (wear.start, wear.end)),
        "lives": [asdict(one) for one in lives],
    }
    print_warnings("study wear", summary["warnings"])
    tell(options, lives, windows, readings, summary)
    return 0


def judge_again(options: WearStudy, command: str) -> None:
    """Judge the walks of a folder anew, by what was seen of them."""
    from stiction.formats.errors import StictionError
    from stiction.formats.life import Reading, Window
    from stiction.formats.origin import Origin
    from stiction.formats.results import read_summary
    from stiction.formats.rows import read_rows
    from stiction.transfer import wear_life

    before = read_summary(options.out / "summary.json")
    windows = read_rows(options.out / "windows.csv", Window)
    heard = options.out / "readings.csv"
    readings = read_rows(heard, Reading) if heard.exists() else []
    try:
        lives = wear_life.judge_again(before["lives"], windows, readings)
        tried = before["settings"]["wear"]["start"], before["settings"]["wear"]["end"]
        ways = {policy: way["way"] for way in before["ways"] for policy in way["policies"]}
    except KeyError as error:
        raise StictionError(f"{options.out / 'summary.json'} is none of `stiction study wear`: no {error}") from error
    known = [row for row in lives if row.policy in ways]
    tell(
        options,
        lives,
        windows,
        readings,
        {name: value for name, value in before.items() if name != "schema_version"}
        | {"judged": {"command": command, **Origin.now().provenance}, "groups": wear_life.groups(lives)}
        | {"ways": wear_life.over_seeds(known, ways, tried), "lives": [asdict(one) for one in lives]},
    )


def tell(
    options: WearStudy, lives: Sequence[Life], windows: Sequence[Window], readings: Sequence[Reading], summary: Summary
) -> None:
    """Write the files and the page; print the answers."""
    from stiction.formats.results import summary_text
    from stiction.report.wear import answers, write_wear

    page = write_wear(options.out, lives, windows, readings, summary)
    if options.json:
        print(summary_text(summary), end="")
    else:
        print("\n".join(answers(summary["groups"], summary["settings"]["wear"]["end"], summary["ways"])))
        print(f"report: {page}")
