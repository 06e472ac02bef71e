"""`stiction study calibration BUNDLE`: intervals of its wear monitor that hold on virtual robots."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from stiction.core.errors import BundleError, ConfigurationError
from stiction.core.files import write_text
from stiction.core.flags import ARGUMENT
from stiction.core.records import make_folder
from stiction.report.terminal import RobotSeeds
from stiction_experiments.lab.study import ParallelOptions, Report, Study, Work

DESCRIPTION = """Calibrate the intervals of a bundle's wear monitor on virtual robots, and test them on others.

A monitor is fitted in the simulator of the training, whose joints have no backlash, delays, load or Stribeck friction.
Here robots that have all of it walk under the bundle at friction drawn from what the map was fitted on. From how far it
is off on the calibration robots follow intervals (split conformal prediction, a robot is a sample), and their coverage
is measured on the test robots. NAME-wear.json is the map with both; the monitor then says them beside every reading.
Give it to the robot beside the bundle, or to `stiction export --wear`. Stop it at any time: the same command goes on.

Example:
  stiction study calibration saturn_lite-flat-deception-0.2 --out results/wear/calibration"""


@dataclass(frozen=True, kw_only=True)
class CalibrationOptions(ParallelOptions):
    """Options of `stiction study calibration`."""

    bundle: Annotated[Path, ARGUMENT]
    """Directory of the bundle, or name of a shipped one; with a wear monitor."""
    robots: RobotSeeds = tuple(range(500, 540))
    """Seeds of the calibration robots; below 1000, which are not for results. Two-sided intervals of 95 % take 39."""
    tested: RobotSeeds = tuple(range(1100, 1120))
    """Seeds of the test robots."""
    windows: int = 1
    """Windows of the monitor, one after another, in each walk."""
    engine: str = "physx"
    """Physics engine: physx, ode, ode-webots, mujoco."""
    out: Path = Path("stiction-calibration")
    """Directory for NAME-wear.json, coverage.csv, summary.json, report.html; and for robots, a file for every walk."""


FEWEST = 39
"""Calibration robots below which a bound of 97.5 % is the largest error that was seen, and not that bound."""


def run(options: CalibrationOptions, work: Work) -> Report:
    """Walk, calibrate, test."""
    from stiction.core.parallel import spread
    from stiction.files.bundle import find_bundle
    from stiction_experiments.calibration.calibrate import calibrate, usual, walk_robot

    if both := sorted({*options.robots} & {*options.tested}):
        raise ConfigurationError(f"robot {both[0]} is to calibrate and to test; expected different robots")
    if options.windows < 1:
        raise ConfigurationError(f"{options.windows} windows a walk; expected at least one")
    path = find_bundle(options.bundle)
    (bundle,) = work.bundles([path])
    if bundle.wear is None:
        raise BundleError(f"{bundle.name} has no wear monitor; `stiction study adaptation` fits one")
    robots = work.begin() / "robots"
    make_folder(robots)
    seeds = [*options.robots, *options.tested]
    tasks = [(path, seed, options.windows, options.engine, robots) for seed in seeds]
    walked = {}
    for number, found in spread(walk_robot, tasks, work.jobs):
        walked[seeds[number]] = found
        work.progress("robots", len(walked) / len(seeds))
    judged = {one.seed: one for one in usual({seed: walked[seed] for seed in seeds})}
    own, other = ([judged[seed] for seed in some if seed in judged] for some in (options.robots, options.tested))
    if not own or not other:
        raise ConfigurationError("no calibration or no test robot walked a whole usual window; give more robots")
    calibration, rows = calibrate(bundle.wear, own, other, options.engine)
    model = replace(bundle.wear, calibration=calibration)
    level = rows[-1]
    narrow = sum(row.upper - row.lower < bundle.wear.highest for row in rows[:-1])
    lead = (
        f"On {len(other)} robots that were not calibrated on, the level's own 95 % intervals held the truth in "
        f"{100 * level.held_before:.0f} % of the windows, the calibrated ones in {100 * level.held:.0f} %; of "
        f"{len(rows) - 1} joints {narrow} have an interval narrower than what the map was fitted on."
    )
    few = f"{len(own)} calibration robots: the interval is as wide as the largest errors seen, under 95 % of new robots"
    name = f"{bundle.name}-wear.json"
    return Report(
        title="Intervals of the wear monitor, calibrated on virtual robots",
        lead=lead,
        tables={"coverage": rows},
        warnings=[few] if len(own) < FEWEST else [],
        summary={
            "policy": bundle.name,
            "digest": bundle.digest,
            "engine": options.engine,
            "windows": options.windows,
            "robots": [one.seed for one in own],
            "tested": [one.seed for one in other],
            "left_out": [seed for seed in seeds if seed not in judged],
            "levels": {str(seed): float(one.true[-1]) for seed, one in judged.items()},
        },
        files=lambda out: write_text(out / name, model.to_json()),
    )


STUDY = Study(
    "whether the intervals of a wear monitor hold on virtual robots, and how wide they must be",
    DESCRIPTION,
    CalibrationOptions,
    run,
    results=("coverage.csv",),
)
