"""`stiction study damping`: B and k·kd as one number, where that holds, and where it fails (section V of the paper)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from stiction.core.records import part_of, read_rows
from stiction_experiments.lab.study import RedrawnOptions, Report, Study, Work, recorded

DESCRIPTION = (
    "Move damping between viscous friction B and derivative gain kd at equal B + k·kd, and measure how the motion "
    "of a joint and of whole robots changes: under dry friction, at torque limits, with a sampled controller, and with "
    "an Actuator Net."
)

AIR_LEVELS = (0.0, 0.1)
"""Dry friction of the robots in the air, over torque limit [-]."""


@dataclass(frozen=True, kw_only=True)
class DampingOptions(RedrawnOptions):
    """Options of `stiction study damping`."""

    bundles: tuple[Path, ...] | None = None
    """Policies that drive walking robots: directories or names of shipped bundles; all shipped ones by default."""
    robots: tuple[str, ...] = ("go1", "saturn_lite")
    """Robots whose joint is taken, and that swing their legs in the air."""
    joint: str | None = None
    """Kind of joint, such as hip; by default that of the outermost joint."""
    draws: int = 100
    """Joints drawn to compare randomisations."""
    episodes: int = 8
    """Walking robots per friction level, command and torque limits."""
    seconds: float = 10.0
    """Length of a walk [s]; its first 2 s do not count for speed and saturation."""
    seed: int = 0
    """Seed of draws, initial states and sensor noise."""
    out: Path = Path("stiction-damping")
    """Directory for the tables, damping.png, summary.json and report.html."""


def run(options: DampingOptions, work: Work) -> Report:
    """Move damping in joints, robots in the air, and walking robots."""
    from dataclasses import asdict
    from functools import partial

    from stiction_experiments.damping.joint import DampingCfg, draw_rows, net_rows, swap_rows
    from stiction_experiments.damping.page import TABLES, DampingResult, report
    from stiction_experiments.damping.robot import WalkCfg, air_row, walk_rows

    if options.judge_again:
        earlier = recorded(options.out, work, ("study", "walk", *TABLES))
        rows = {name: tuple(read_rows(options.out / f"{name}.csv", kind)) for name, kind in TABLES.items()}
        return report(DampingResult(**rows), earlier)
    cfg = DampingCfg(options.robots, joint=options.joint, draws=options.draws, seed=options.seed)
    walk = part_of(WalkCfg, options)
    bundles = work.bundles(options.bundles)
    work.begin()
    swaps = tuple(row for robot in cfg.robots for row in swap_rows(robot, cfg))
    nets = tuple(row for robot in cfg.robots for row in net_rows(robot, cfg))
    draws = tuple(row for robot in cfg.robots for row in draw_rows(robot, cfg))
    robots = [air_row(robot, level, cfg) for robot in cfg.robots for level in AIR_LEVELS]
    for bundle in bundles:
        for lift in (True, False):
            progress = partial(work.progress, f"{bundle.name}, {'lifted' if lift else 'own'} limits")
            robots += walk_rows(bundle, walk, lift, threads=work.threads, progress=progress)
    result = DampingResult(swaps, nets, draws, tuple(robots))
    return report(result, {"seconds": work.seconds, "study": asdict(cfg), "walk": asdict(walk)})


STUDY = Study(
    "whether viscous friction and the controller's damping are one number to a joint: where that holds, where it fails",
    DESCRIPTION,
    DampingOptions,
    run,
    results=("swaps.csv", "nets.csv", "draws.csv", "robots.csv", "damping.png"),
)
