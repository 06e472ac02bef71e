"""`stiction convert`: identified joints, and the range to train with, in the form that others read."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from stiction.core.files import keep_inputs, write_text
from stiction.core.flags import ARGUMENT
from stiction.core.options import read_options
from stiction.exchange.targets import ConvertOptions, convert, convert_training
from stiction.files.joints import is_training, load_joints
from stiction.files.settings import check_file

DESCRIPTION = """Write identified friction, damping and rotor inertia as a simulator reads them (joints.json), or
the range of friction to train with as a training framework draws it (training.json).

Without --model: a snippet to paste. With --model (MJCF, URDF, PROTO or world): the model with its joints changed, and
all else, comments included, as it was. What the simulator cannot hold, or nobody knows, is left out; a comment says so.
A range is written with the traps of its framework: what friction means there, what overrides it, what holds at rest.
For mjlab these are lines for your task, which calls stiction.mjlab.

Examples:
  stiction convert joints.json --to mjlab --joint-map shank='*_calf_joint'
  stiction convert training.json --to isaaclab --robot go2 --out friction_events.py
  stiction convert joints.json --to mujoco --model robot.xml --joint-map shank='*_calf_joint' --out new.xml"""


@dataclass(frozen=True, kw_only=True)
class Convert(ConvertOptions):
    """Options of the verb."""

    joints: Annotated[Path, ARGUMENT]
    """The `joints.json` of `stiction identify`, or the `training.json` beside it."""
    out: Path | None = None
    """File to write; by default standard output."""
    overwrite: bool = False
    """Write over a file of other content."""
    json: bool = False
    """Print the summary (and the text, without --out) as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Run the verb; return the exit status."""
    cfg = read_options(Convert, arguments, "stiction convert", DESCRIPTION)
    if cfg.out is not None:
        keep_inputs(cfg.out, *(given for given in (cfg.joints, cfg.model) if given is not None))
    done = (
        convert_training(cfg.joints, cfg)
        if is_training(cfg.joints)
        else convert(load_joints(cfg.joints), cfg, cfg.joints)
    )
    if cfg.out is not None:
        check_file(cfg.out, cfg, text=done.text)
        write_text(cfg.out, done.text)
    if cfg.json:
        summary = {"to": cfg.to, "out": cfg.out and str(cfg.out), "joints": done.joints, "notes": done.notes}
        print(json.dumps(summary if cfg.out else summary | {"text": done.text}, indent=2, ensure_ascii=False))
        return 0
    if cfg.out is None:
        print(done.text, end="")
        return 0
    for note in done.notes:
        print(f"note: {note}", file=sys.stderr)
    if cfg.model is not None and cfg.out.resolve().parent != cfg.model.resolve().parent:
        print("note: paths of meshes are relative to the model: keep the new file in its folder", file=sys.stderr)
    print(f"{cfg.out}: {', '.join(done.joints)}", file=sys.stderr)
    return 0
