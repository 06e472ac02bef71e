"""`stiction convert`: identified joints in the form that a simulator reads."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from stiction.core.errors import ConfigurationError, FileError

DESCRIPTION = """Write identified friction, damping and rotor inertia as a simulator reads them.

Without --model: a snippet to paste. With --model (MJCF, URDF, PROTO or world): the model with its joints changed, and
all else, comments included, as it was. What the simulator cannot hold, or nobody knows, is left out; a comment says so.

Example: stiction convert joints.json --to mujoco --model robot.xml --joint-map shank='*_calf_joint' --out new.xml"""


@dataclass(frozen=True)
class Convert:
    """Options of the verb."""

    joints: Annotated[Path, tyro.conf.Positional]
    """The `joints.json` of `stiction identify`."""
    to: Literal["mujoco", "urdf", "isaaclab", "webots"]
    """The simulator, or format."""
    model: Path | None = None
    """A MJCF, URDF, PROTO or world to put the values into; it is not changed itself."""
    joint_map: tuple[str, ...] = ()
    """RECORDED=MODEL pairs, where names differ; MODEL may have wildcards if --model is given. For isaaclab it is a
    regular expression."""
    out: Path | None = None
    """File to write; by default standard output."""
    timestep: float | None = None
    """Physics step [s] that MuJoCo's solver settings are for, where it is not the model's own."""
    assumed_load: float | None = None
    """|F| + |T| on the joint [N + N m]: also write the coefficient of PhysX before 5.6, which is right at this load."""
    json: bool = False
    """Print the summary (and the text, without --out) as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Run the verb; return the exit status."""
    cfg = tyro.cli(Convert, args=arguments, prog="stiction convert", description=DESCRIPTION)
    from stiction.exchange.targets import ConvertOptions, convert
    from stiction.formats.joints import load_joints

    _keep_inputs(cfg)
    options = ConvertOptions(cfg.model, cfg.joint_map, cfg.timestep, cfg.assumed_load)
    done = convert(load_joints(cfg.joints), cfg.to, options)
    if cfg.out is not None:
        try:
            cfg.out.write_bytes(done.text.encode())
        except OSError as error:
            raise FileError(f"cannot write {cfg.out}: {error.strerror or error}; choose another --out") from error
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


def _keep_inputs(cfg: Convert) -> None:
    """Refuse to write over the model or the identification, under whatever name they go."""
    for given in (cfg.joints, cfg.model):
        if cfg.out is None or given is None or not given.exists():
            continue
        if cfg.out.resolve() == given.resolve() or (cfg.out.exists() and cfg.out.samefile(given)):
            raise ConfigurationError(f"--out {cfg.out} is {given}, which would be overwritten; choose another --out")
