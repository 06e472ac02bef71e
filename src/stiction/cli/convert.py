"""`stiction convert`: identified joints, and the range to train with, in the form that others read."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from stiction.core.effects import flag_of, requirement
from stiction.core.errors import ConfigurationError
from stiction.core.files import keep_inputs, write_bytes, write_text
from stiction.core.flags import ARGUMENT
from stiction.core.options import read_options, refuse
from stiction.exchange.targets import ConvertOptions, convert, convert_training
from stiction.files.bam import load_all_joints
from stiction.files.joints import is_training
from stiction.files.settings import check_file

DESCRIPTION = """Write identified friction, damping and rotor inertia as a simulator reads them (joints.json), or
the range of friction to train with as a training framework draws it (training.json).

Without --model: a snippet to paste. With --model (MJCF, URDF, PROTO or world): the model with its joints changed, and
all else, comments included, as it was. What the simulator cannot hold, or nobody knows, is left out; a comment names
it, and --json says why. The page "Which value goes where" of the documentation says what friction means in each.
For mjlab these are lines for your task, which calls stiction.mjlab.

Examples:
  stiction convert joints.json --to mjlab --joint-map shank='*_calf_joint'
  stiction convert joints.json --to playground --robot go1 --joint-map shank='*_calf_joint'
  stiction convert training.json --to isaaclab --robot go2 --out friction_events.py
  stiction convert training.json --to playground --robot go1 --out friction.py
  stiction convert xl330/m4.json mx64/m4.json --to joints --out joints.json
  stiction convert actuator --to mjlab --out nets
  stiction convert joints.json --to mujoco --model robot.xml --joint-map shank='*_calf_joint' --out new.xml"""


@dataclass(frozen=True, kw_only=True)
class Convert(ConvertOptions):
    """Options of the verb."""

    joints: Annotated[tuple[Path, ...], ARGUMENT]
    """The `joints.json` of `stiction identify`, or the `training.json` beside it; parameter files of BAM, m1 to m4, a
    servo each; or the folder of `stiction train-actuator`, for mjlab and isaaclab."""
    out: Path | None = None
    """File to write, for an Actuator Net and for BAM with more than one joint a folder; by default standard output."""
    overwrite: bool = False
    """Write over a file of other content."""
    json: bool = False
    """Print the summary (and the text, without --out) as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Run the verb; return the exit status."""
    cfg = read_options(Convert, arguments, "stiction convert", DESCRIPTION)
    if not cfg.joints:
        refuse("stiction convert", "no file given; expected a joints.json, a training.json, or files of BAM")
    if cfg.out is not None:
        keep_inputs(cfg.out, *cfg.joints, *(() if cfg.model is None else (cfg.model,)))
    first = cfg.joints[0]
    if first.is_dir() or first.suffix == ".npz":
        return _convert_net(cfg)
    if len(cfg.joints) == 1 and is_training(first):
        done = convert_training(first, cfg)
    elif len(cfg.joints) > 1 and cfg.to == "mjlab":
        raise ConfigurationError(f"--to mjlab: got {len(cfg.joints)} files, expected one; first convert --to joints")
    else:
        done = convert(load_all_joints(cfg.joints), cfg, first)
    files = {} if cfg.out is None else {cfg.out: done.text}
    if len(done.files) > 1:
        if cfg.out is None or cfg.out.suffix:
            raise ConfigurationError(f"--to {cfg.to}: got {len(done.files)} joints, a file each; expected --out FOLDER")
        if wrong := [name for name in done.files if Path(name).name != name]:
            raise ConfigurationError(f"joint {wrong[0]!r}: got no name of a file; --joint-map {wrong[0]}=NAME names it")
        cfg.out.mkdir(parents=True, exist_ok=True)
        files = {cfg.out / f"{name}.json": text for name, text in done.files.items()}
    for path, text in files.items():
        check_file(path, cfg, text=text)
    for path, text in files.items():
        write_text(path, text)
    if cfg.json:
        summary = {"to": cfg.to, "out": cfg.out and str(cfg.out), "joints": done.joints, "notes": done.notes}
        texts = {"text": done.text} | ({"files": done.files} if done.files else {})
        print(json.dumps(summary if cfg.out else summary | texts, indent=2, ensure_ascii=False))
        return 0
    if cfg.out is None:
        print(done.text, end="")
        return 0
    for note in done.told:
        print(f"note: {note}", file=sys.stderr)
    if cfg.model is not None and cfg.out.resolve().parent != cfg.model.resolve().parent:
        print("note: paths of meshes are relative to the model: keep the new file in its folder", file=sys.stderr)
    print(f"{cfg.out}: {', '.join(done.joints)}", file=sys.stderr)
    return 0


def _convert_net(cfg: Convert) -> int:
    """Write an Actuator Net as TorchScript with its configuration; return the exit status."""
    from stiction.files.actuator import read_actuator

    for name in ("model", "joint_map", "timestep", "assumed_load", "robot"):
        if getattr(cfg, name) not in (None, ()):
            raise ConfigurationError(requirement(flag_of(name), "a joints.json or training.json"))
    if len(cfg.joints) > 1 or cfg.to not in ("mjlab", "isaaclab") or cfg.out is None:
        raise ConfigurationError(f"{cfg.joints[0]}: expected one Actuator Net, --to mjlab or isaaclab, --out FOLDER")
    net = read_actuator(cfg.joints[0])
    from stiction.learning.actuator_script import actuator_files

    files = {cfg.out / name: content for name, content in actuator_files(net, cfg.to).items()}
    for path in files:
        check_file(path, cfg)
    cfg.out.mkdir(parents=True, exist_ok=True)
    for path, content in files.items():
        write_bytes(path, content)
    if cfg.json:
        print(json.dumps({"to": cfg.to, "out": str(cfg.out), "joints": {name: name for name in net.joint_names}}))
    else:
        print(f"{cfg.out}: {', '.join(path.name for path in files)}", file=sys.stderr)
    return 0
