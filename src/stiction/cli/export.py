"""`stiction export`: the student of a training run as a policy bundle, or a bundle as others deploy it (not run)."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, get_args

from stiction.core.effects import needs
from stiction.core.errors import ConfigurationError
from stiction.core.flags import ARGUMENT
from stiction.core.lock import replaced_folder
from stiction.core.options import read_options

DESCRIPTION = """Export a trained student as a policy bundle, or a policy bundle as others deploy it, not run there.

--to bundle: the network as ONNX, the contract, golden vectors recorded in MuJoCo, digests and a card. What was written
is checked at once, as `stiction verify` does.

--to webots: robot (PROTO), worlds (flat ground, stairs), a physics plugin for the rotors' inertia, and a controller
that runs the bundle. Written and tested short of running.

--to deploy.yaml, rl_sar, mjlab: the network and the file that unitree_rl_lab, rl_sar or mjlab's runtimes read,
generated from the contract; what that file cannot say goes into the network, what neither holds is refused. Read back
by `stiction import` it is the same policy.

Examples:
  stiction export runs/mine
  stiction export runs/mine --to rl_sar --out for-rl_sar"""


Target = Literal["bundle", "webots", "deploy.yaml", "rl_sar", "mjlab"]
"""Forms of export: a bundle of a run, the other forms of a bundle."""


@dataclass(frozen=True)
class ExportCfg:
    """Options of the verb."""

    source: Annotated[Path, ARGUMENT]
    """Directory of a run, as `stiction train` made it. With another --to than bundle: of a bundle, or the name of a
    shipped one, or a run with its bundle in it."""
    to: Target = "bundle"
    """Form of the export."""
    out: Path | None = None
    """Directory to make; by default `bundle` within the run, or `webots-NAME`, `rl_sar-NAME` and so on here for the
    bundle NAME."""
    wear: Path | None = field(default=None, metadata=needs("--to bundle"))
    """RUN-wear.json that `stiction study adaptation` wrote for this run; the bundle then also watches for wear."""
    joints: Path | None = field(default=None, metadata=needs("--to bundle"))
    """joints.json of the target robot, for a policy that observes its joints' friction; by default the nominal friction
    of training."""
    joint_map: tuple[str, ...] = field(default=(), metadata=needs("--to bundle"))
    """RECORDED=JOINT pairs where the records of --joints have other names than the policy's joints."""
    maker_targets: Path | None = field(default=None, metadata=needs("--to bundle"))
    """CSV to which the targets of the golden vectors are also written, in the order, with the signs and zeros of the
    robot's maker, held joints included: to be played with the robot in the air, and watched joint by joint."""
    uncorrected: bool = field(default=False, metadata=needs("--to bundle"))
    """Leave out the correction of commands, to compare with and without it."""
    friction_level: float | None = field(default=None, metadata=needs("--to webots"))
    """Dry friction of the joints in a Webots project as a fraction of each torque limit [-], 0 by default. It can be
    changed in the worlds."""
    step_height: float | None = field(default=None, metadata=needs("--to webots"))
    """Height of the stairs' steps in a Webots project [m], 0.1 by default."""
    robot: str | None = field(default=None, metadata=needs("--to bundle or webots"))
    """Robot of a Webots project in place of the bundle's: a file or `package.module:NAME`. For a bundle: the module
    that the run's config.json names as robot, typed again, since no module is run because a file names it."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> None:
    """Export what is asked for, and print where it is."""
    cfg = read_options(ExportCfg, arguments, "stiction export", DESCRIPTION)
    if cfg.to == "bundle":
        _to_bundle(cfg)
    else:
        _to_others(cfg, cfg.to)


def _to_bundle(cfg: ExportCfg) -> None:
    """Export one run as a bundle."""
    from stiction.evaluation.export import export_run
    from stiction.files.bundle import CONTRACT, shipped_bundles
    from stiction.learning.run import RunDirectory

    if (cfg.source / CONTRACT).exists() or str(cfg.source) in shipped_bundles():
        _, *others = get_args(Target)
        raise ConfigurationError(f"{cfg.source} is a policy bundle already; --to {', '.join(others)} takes one")
    RunDirectory(cfg.source).header()  # where there is no run, no folder is made for its bundle
    out = cfg.out or cfg.source / "bundle"

    def say(note: str) -> None:
        print(f"stiction export: {note}", file=sys.stderr)

    with replaced_folder(out):
        asked = (cfg.wear, cfg.joints, cfg.joint_map, say, cfg.robot, cfg.maker_targets)
        check = export_run(cfg.source, out, *asked, corrected=not cfg.uncorrected)
    if cfg.json:
        print(json.dumps(check.summary() | {"path": str(out)}, indent=2))
    else:
        print(f"{out}: {check.bundle.size / 1e6:.2f} MB, {check.steps} golden steps, digest {check.bundle.digest}")
        print(f"check it with `stiction verify {out}`", file=sys.stderr)


def _to_others(cfg: ExportCfg, to: Literal["webots", "deploy.yaml", "rl_sar", "mjlab"]) -> None:
    """Export one bundle as a Webots project, or as another runtime deploys it."""
    from stiction.files.bundle import find_bundle

    source = find_bundle(cfg.source)
    settings = {
        name: getattr(cfg, name) for name in ("friction_level", "step_height") if getattr(cfg, name) is not None
    }
    out = cfg.out or Path(f"{to.removesuffix('.yaml')}-{_bundle_name(source)}")
    with replaced_folder(out):
        if to == "webots":
            # Its robot is built with the simulator, which no other target asks for.
            from stiction.exchange.webots.export import WebotsCfg, export_webots

            done = export_webots(source, out, WebotsCfg(**settings), cfg.robot)
        else:
            from stiction.exchange.policies.exporter import export_to

            done = export_to(source, out, to)
    if cfg.json:
        print(json.dumps(done.summary(), indent=2))
        return
    for note in done.notes:
        print(f"stiction export: {note}", file=sys.stderr)
    print(f"{done.path}: {len(done.files)} files for {done.robot}, digest {done.bundle.digest}")


def _bundle_name(folder: Path) -> str:
    """Return what a bundle is called: its folder's name, within a run that of the run."""
    folder = folder.resolve()
    return folder.parent.name if folder.name == "bundle" else folder.name
