"""`stiction evaluate BUNDLE...`: what a policy reaches over friction levels and commands, in MuJoCo."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True)
class EvaluateCfg:
    """Drive policy bundles over friction levels and commands."""

    bundles: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Directories of the bundles."""
    friction_levels: tuple[float, ...] = (0.0, 0.1, 0.2)
    """Dry friction in every joint, as fractions of its torque limit [-]; of the laws load and effort, coefficients."""
    friction_law: Literal["coulomb", "stribeck", "load", "effort"] = "coulomb"
    """Law of the dry friction, whatever the policies were trained with. coulomb: a torque; stribeck: a torque, more of
    it at rest; load: c (|F| + |T|) of what the joint transmits; effort: c |torque| of the motor."""
    static_ratio: float = 1.5
    """Friction at rest over friction in motion, of the law stribeck."""
    stribeck_velocity: float = 0.1
    """Speed at which 63 % of that excess is gone [rad/s], of the law stribeck."""
    commands: tuple[str, ...] = ("vx=0.5", "vx=-0.5")
    """Commanded velocities, vx forward, vy sideways [m/s], wz turn [rad/s]: vx=0.5 or vx=0.3,wz=0.2 or stand."""
    episodes: int = 32
    """Episodes per level and command."""
    seconds: float = 20.0
    """Length of an episode [s]; its first 2 s are not measured."""
    seed: int = 0
    """Seed of initial states and sensor noise; the same for every bundle, level and command."""
    action_delay: float = 0.0
    """Delay between joint target and motor [s], in whole physics steps, at most 8 of them."""
    robot: str | None = None
    """A robot of your own, `package.module:NAME`; by default the shipped robot that the bundle names."""
    log: Path | None = None
    """Also log the walks as a robot would, for `stiction identify` and `stiction train-actuator`: a folder for one NPZ
    per bundle, level, command and robot. The first --log-robots episodes, at the physics rate."""
    log_robots: int = 4
    """Robots to log per level and command."""
    log_seconds: float = 10.0
    """Length of a log [s]; a fall ends it sooner."""
    log_torque: Literal["motor_side", "output_side"] = "motor_side"
    """Torque in the log: `motor_side`, what the motor gave (what `stiction identify` needs), or `output_side`, what
    reached the link, dry and viscous friction of the joint taken off."""
    out: Path = Path("stiction-evaluation")
    """Directory for results.csv, summary.json, friction_budget.svg and .png, and report.html."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Check and evaluate the bundles, write the results, print them."""
    cfg = tyro.cli(EvaluateCfg, args=arguments, prog="stiction evaluate", description=DESCRIPTION)
    if not cfg.bundles:
        print("stiction evaluate: no bundle given; `stiction evaluate --help` shows the usage", file=sys.stderr)
        return 2
    from stiction.cli.terminal import print_rows, work_progress
    from stiction.deploy.check import check_bundle
    from stiction.formats.folder import make_folder
    from stiction.formats.reproducibility import num_threads
    from stiction.formats.results import summary_text
    from stiction.formats.shipped import find_bundle
    from stiction.report.evaluation import write_evaluation
    from stiction.transfer.evaluate import EvaluationCfg
    from stiction.transfer.summary import evaluate_all
    from stiction.transfer.walk import RecordCfg, log_all

    settings = EvaluationCfg(
        friction_levels=cfg.friction_levels,
        commands=cfg.commands,
        episodes=cfg.episodes,
        seconds=cfg.seconds,
        seed=cfg.seed,
        action_delay=cfg.action_delay,
        friction_law=cfg.friction_law,
        static_ratio=cfg.static_ratio,
        stribeck_velocity=cfg.stribeck_velocity,
    )
    record = None if cfg.log is None else RecordCfg(cfg.log_robots, cfg.log_seconds, torque=cfg.log_torque)
    make_folder(cfg.out)
    if cfg.log is not None:
        make_folder(cfg.log, "--log")
    bundles = [check_bundle(find_bundle(path)).bundle for path in cfg.bundles]
    with work_progress() as progress:
        rows, summary = evaluate_all(bundles, settings, cfg.robot, num_threads(), progress)
        if record is not None and cfg.log is not None:
            summary["logs"] = log_all(bundles, settings, record, cfg.log, cfg.robot, num_threads(), progress)
    summary = {"command": shlex.join(["stiction", "evaluate", *arguments])} | summary
    write_evaluation(cfg.out, rows, summary)
    if cfg.json:
        print(summary_text(summary), end="")
    else:
        print_rows(rows)
        print(f"report: {cfg.out / 'report.html'}")
        if cfg.log is not None:
            print(f"logs: {len(summary['logs'])} in {cfg.log}")
    return 0


DESCRIPTION = (
    "Drive policy bundles over levels of dry joint friction and velocity commands, in MuJoCo, from the bundles alone. "
    "A bundle is a directory, or the name of one that comes with the package."
)
