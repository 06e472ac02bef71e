"""`stiction export RUN`: the student of a training run as a policy bundle."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class ExportCfg:
    """Turn a training run into a policy bundle that can be checked."""

    run: Annotated[Path, tyro.conf.Positional]
    """Directory of the run, as `stiction train` made it."""
    out: Path | None = None
    """Directory of the bundle to make; by default `bundle` within the run."""
    wear: Path | None = None
    """The RUN-wear.json that `stiction study adaptation` wrote for this run: the bundle then also watches for wear."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> None:
    """Export one run and print where its bundle is."""
    cfg = tyro.cli(ExportCfg, args=arguments, prog="stiction export", description=DESCRIPTION)
    from stiction.transfer.export import export_run

    out = cfg.out or cfg.run / "bundle"
    check = export_run(cfg.run, out, cfg.wear)
    if cfg.json:
        print(json.dumps(check.summary() | {"path": str(out)}, indent=2))
    else:
        print(f"{out}: {check.bundle.size / 1e6:.2f} MB, {check.steps} golden steps, digest {check.bundle.digest}")
        print(f"check it with `stiction verify {out}`", file=sys.stderr)


DESCRIPTION = (
    "Export the trained student as a policy bundle: the network as ONNX, the contract, golden vectors recorded in "
    "MuJoCo, digests and a card. What was written is checked at once, as `stiction verify` does."
)
