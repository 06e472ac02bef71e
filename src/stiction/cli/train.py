"""`stiction train`: a teacher and its student, from nothing, resumable."""

from __future__ import annotations

import hashlib
import json
import shlex
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from stiction.formats.errors import StictionError
from stiction.locomotion.friction import FrictionCfg
from stiction.rma.config import PRESETS, TrainCfg

DESCRIPTION = """Train a teacher (PPO, sees everything) and its student (sees what the robot measures) for a robot.

Example: stiction train --method deception --friction-level 0.2 --out runs/deception

Stop it at any time; `stiction train --resume runs/deception` goes on from the last checkpoint. Watch it with
`tensorboard --logdir runs`. Then: `stiction export runs/deception`."""


@dataclass(frozen=True)
class Train:
    """Options of `stiction train`."""

    config: Annotated[TrainCfg, tyro.conf.arg(name="")] = field(default_factory=TrainCfg)
    """The whole configuration."""
    preset: Literal["full", "quick", "paper"] = "full"
    """Defaults for everything else: `full` is what results are made with, `quick` is for a first look, `paper`
    randomises the paper's table and no more."""
    out: Path = Path("runs/train")
    """Folder of the run."""
    friction_from: Path | None = None
    """A `training.json` of `stiction identify`; its method and level go in place of --method and --friction-level."""
    resume: Path | None = None
    """Continue the run in this folder; all other options come from its config.json."""
    json: bool = False
    """Print summary.json on standard output, and nothing else."""


def _preset(arguments: list[str]) -> str:
    """Find the preset first: it changes the defaults that the parser then shows."""
    for index, word in enumerate(arguments):
        name, _, value = word.partition("=")
        if name == "--preset":
            value = value or (arguments[index + 1] if index + 1 < len(arguments) else "")
            return value if value in PRESETS else "full"
    return "full"


def _identified(file: str | None, robot: str) -> dict[str, Any] | None:
    """Read the nominal joints of a robot from a `joints.json`, with its name and hash; say what is not used."""
    if file is None:
        return None
    from stiction.formats.joints import load_joints
    from stiction.locomotion.identified import identified_joints
    from stiction.robots.catalog import find_robot
    from stiction.sim.fleet import Fleet

    path, spec = Path(file), find_robot(robot)
    limits = spec.joint_values("torque_limit")
    found = identified_joints(load_joints(path), spec.joint_names, Fleet(spec, 1).link_inertia(), limits)
    for warning in found.warnings:
        print(f"stiction train: warning: {warning}", file=sys.stderr)
    values = {name: list(getattr(found, name)) for name in ("armature", "damping", "frictionloss")}
    return {"file": path.name, "sha256": hashlib.sha256(path.read_bytes()).hexdigest(), "values": values}


def _friction_from(path: Path, cfg: TrainCfg, arguments: list[str]) -> TrainCfg:
    """Return the configuration with the friction that a `training.json` proposes; refuse flags that say otherwise."""
    from stiction.formats.configuration import from_plain
    from stiction.formats.training import read_training

    own = ("--method", "--friction-level", "--friction-law", "--task.friction.")
    given = [flag for word in arguments if (flag := word.partition("=")[0].replace("_", "-")).startswith(own)]
    if given:
        raise StictionError(
            f"--friction-from {path} and {', '.join(given)} both set the friction; leave one of them out"
        )
    friction = from_plain(FrictionCfg, read_training(path)["friction"], f"{path.name}: friction")
    return replace(cfg, task=replace(cfg.task, friction=friction))


def _only_resume(arguments: list[str]) -> None:
    """Refuse other options beside --resume: the run goes on as its config.json says, and they would have no effect."""
    flags = [word.partition("=")[0] for word in arguments if word.startswith("--")]
    others = [flag for flag in flags if flag not in ("--resume", "--json")]
    if others:
        raise StictionError(
            f"--resume continues a run as it was started, and {', '.join(others)} would have no effect; "
            "leave it out, or start another run with --out"
        )


def main(arguments: list[str]) -> int:
    """Run the verb."""
    default = Train(config=PRESETS[_preset(arguments)])
    options = tyro.cli(Train, args=arguments, prog="stiction train", description=DESCRIPTION, default=default)

    import numpy as np

    from stiction.cli.progress import training_progress
    from stiction.report.training import draw_training
    from stiction.rma.run import RunDirectory
    from stiction.rma.runner import train
    from stiction.robots.catalog import find_robot

    if options.resume is not None:
        _only_resume(arguments)
        run = RunDirectory(options.resume)
        run.resume()
        cfg, identified = run.config(), run.header()["identified"]
    else:
        cfg = options.config
        if options.friction_from is not None:
            cfg = _friction_from(options.friction_from, cfg, arguments)
        if cfg.task.friction.method != "none" and cfg.task.friction.level == 0.0:
            raise StictionError(
                f"--method {cfg.task.friction.method} at --friction-level 0 trains without friction; "
                "use --method none, or a level above 0"
            )
        cfg.task.randomization.check_robot(find_robot(cfg.task.robot))
        identified = _identified(cfg.joints, cfg.task.robot)
        run = RunDirectory.create(options.out, cfg, shlex.join(["stiction", "train", *arguments]), identified)
    values = {name: np.array(value, float) for name, value in identified["values"].items()} if identified else None
    with training_progress(cfg, quiet=options.json) as progress:
        summary = train(cfg, run, values, progress)
    curves = draw_training(run.path)
    if options.json:
        print(json.dumps(summary))
    else:
        student = summary["last"]["student"]
        print(
            f"student in {run.path}: tracking error {student['walk/tracking_error']:.3f} m/s, "
            f"tripod share {student['walk/tripod_share']:.0%}, {summary['seconds'] / 60:.1f} min\n"
            f"curves: {curves}\nnext: stiction export {run.path}",
            file=sys.stderr,
        )
    return 0
