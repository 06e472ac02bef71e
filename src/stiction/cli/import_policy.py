"""`stiction import`: a policy that was trained elsewhere as a policy bundle."""

from __future__ import annotations

import json
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from stiction.core.flags import ARGUMENT
from stiction.core.lock import replaced_folder
from stiction.core.options import read_options

DESCRIPTION = """Read a policy that was trained elsewhere, a network in ONNX, as a policy bundle: `verify` and
`evaluate` take it like one of ours.

What its metadata say (mjlab, holosoma) is taken; what they do not say is asked for by name, and said in YAML files: a
deploy.yaml of unitree_rl_lab, rl_sar's config.yaml and base.yaml, or a few lines of your own (the page "Policies in and
out" of the documentation).
`--preset` fills what is still missing with the standard velocity task of a trainer, and names each value. The robot has
to drive the joints that the policy moves; its gains, pose and order of joints become the policy's.

Examples:
  stiction import policy.onnx --robot robot.yaml --out bundle
  stiction import policy.onnx --robot go2 --preset isaaclab --out bundle
  stiction import policy.onnx --robot go2 --settings config.yaml base.yaml mine.yaml --out bundle
  stiction evaluate bundle --friction-levels 0 0.1 0.2"""


@dataclass(frozen=True, kw_only=True)
class Import:
    """Options of the verb."""

    network: Annotated[Path, ARGUMENT]
    """The network: one ONNX file, one input of observations and one output of actions."""
    robot: str
    """The robot: its name, robot.yaml, MJCF or URDF."""
    settings: tuple[Path, ...] = ()
    """YAML files that say what the network's metadata do not; of what two say, the later one holds."""
    preset: Literal["isaaclab", "legged_gym", "mjlab", "rl_sar", "unitree"] | None = None
    """Trainer whose standard velocity task says what neither metadata nor settings do."""
    out: Path
    """Directory to make."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Import the policy, and print where it is."""
    cfg = read_options(Import, arguments, "stiction import", DESCRIPTION)
    from stiction.exchange.policies.importer import import_policy

    def say(note: str) -> None:
        print(f"stiction import: {note}", file=sys.stderr)

    command = shlex.join(["stiction", "import", *arguments])
    with replaced_folder(cfg.out):
        check = import_policy(cfg.network, cfg.robot, cfg.out, cfg.settings, command, say, cfg.preset)
    if cfg.json:
        print(json.dumps(check.summary() | {"path": str(cfg.out)}, indent=2))
    else:
        print(f"{cfg.out}: {check.bundle.size / 1e6:.2f} MB, {check.steps} golden steps, digest {check.bundle.digest}")
        print(f"how it walks under friction: stiction evaluate {cfg.out}", file=sys.stderr)
    return 0
