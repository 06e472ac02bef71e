"""`stiction study damping`: B and k·kd as one number, where that holds, and where it fails (section V of the paper)."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

import tyro

DESCRIPTION = (
    "Move damping between viscous friction B and derivative gain kd at equal B + k·kd, and measure what a joint and "
    "whole robots make of it: under dry friction, at torque limits, with a sampled controller, with an Actuator Net."
)

AIR_LEVELS = (0.0, 0.1)
"""Dry friction of the robots in the air, over torque limit [-]."""


@dataclass(frozen=True)
class DampingStudy:
    """Options of `stiction study damping`."""

    bundles: tuple[Path, ...] | None = None
    """Policies that drive walking robots: directories or names of shipped bundles; all shipped ones by default."""
    robots: tuple[str, ...] = ("go1", "saturn_lite")
    """Robots whose joint is taken, and that swing their legs in the air."""
    joint: str = "shank"
    """Kind of joint: hip, thigh or shank."""
    draws: int = 100
    """Joints drawn to compare ways of randomising."""
    episodes: int = 8
    """Walking robots per friction level, command and torque limits."""
    seconds: float = 10.0
    """Length of a walk [s]; its first 2 s do not count for speed and saturation."""
    seed: int = 0
    """Seed of draws, initial states and sensor noise."""
    out: Path = Path("stiction-damping")
    """Directory for the tables, damping.png, summary.json and report.html."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Run the study, write its page, print where it is."""
    options = tyro.cli(DampingStudy, args=arguments, prog="stiction study damping", description=DESCRIPTION)
    import time
    from dataclasses import asdict
    from functools import partial

    from stiction.cli.terminal import print_warnings, work_progress
    from stiction.deploy.check import check_bundle
    from stiction.formats.folder import make_folder
    from stiction.formats.origin import Origin
    from stiction.formats.reproducibility import num_threads
    from stiction.formats.results import summary_text
    from stiction.formats.shipped import find_bundle, shipped_bundles
    from stiction.report.damping import DampingResult, lead, write_damping
    from stiction.transfer.damping import DampingCfg, swap_rows
    from stiction.transfer.damping_robot import WalkCfg, air_row, walk_rows
    from stiction.transfer.damping_spread import draw_rows, net_rows

    cfg = DampingCfg(options.robots, joint=options.joint, draws=options.draws, seed=options.seed)
    walk = WalkCfg(episodes=options.episodes, seconds=options.seconds, seed=options.seed)
    paths = options.bundles if options.bundles is not None else tuple(shipped_bundles().values())
    bundles = [check_bundle(find_bundle(path)).bundle for path in paths]
    make_folder(options.out)
    origin, start = Origin.now(), time.perf_counter()
    swaps = tuple(row for robot in cfg.robots for row in swap_rows(robot, cfg))
    nets = tuple(row for robot in cfg.robots for row in net_rows(robot, cfg))
    draws = tuple(row for robot in cfg.robots for row in draw_rows(robot, cfg))
    robots = [air_row(robot, level, cfg) for robot in cfg.robots for level in AIR_LEVELS]
    with work_progress() as progress:
        for bundle in bundles:
            for lift in (True, False):
                name = f"{bundle.name}, {'lifted' if lift else 'own'} limits"
                robots += walk_rows(bundle, walk, lift, threads=num_threads(), progress=partial(progress, name))
    result = DampingResult(swaps, nets, draws, tuple(robots))
    summary = {
        "command": shlex.join(["stiction", "study", "damping", *arguments]),
        **origin.provenance,
        "warnings": origin.warnings(),
        "seconds": time.perf_counter() - start,
        "study": asdict(cfg),
        "walk": asdict(walk),
        "lead": lead(result),
    }
    print_warnings("study damping", summary["warnings"])
    page = write_damping(options.out, result, summary)
    if options.json:
        print(summary_text(summary), end="")
    else:
        print(f"{summary['lead']}\nreport: {page}")
    return 0
