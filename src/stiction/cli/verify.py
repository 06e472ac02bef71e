"""`stiction verify BUNDLE`: every file, the contract, and the golden vectors, with onnxruntime and NumPy alone."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from stiction.core.errors import StictionError
from stiction.core.flags import ARGUMENT
from stiction.core.options import read_options

if TYPE_CHECKING:
    from stiction.files.golden import Exercise


@dataclass(frozen=True)
class VerifyCfg:
    """Check a policy bundle as a robot's computer can."""

    bundle: Annotated[Path, ARGUMENT]
    """Directory of the bundle, or the name of one that comes with the package."""
    against: Path | None = None
    """Your own model of the robot, a MuJoCo (.xml) or URDF (.urdf) file: axes, places, limits, masses and order of the
    joints must be those of the policy's robot."""
    key: Path | None = None
    """Public key of the maker, a PEM file: the bundle must have this key's signature. Needs the extra sign."""
    expect_digest: str | None = None
    """Digest that the bundle must have, as its maker published it: 64 hexadecimal digits."""
    allow: Path | None = None
    """Text file of the digests that may run, one a line, comments behind #: the bundle's must be there."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> None:
    """Check one bundle; raise `StictionError` at the first thing that is wrong."""
    cfg = read_options(VerifyCfg, arguments, "stiction verify", DESCRIPTION)
    from stiction.api.policy import verified

    try:
        found = verified(cfg.bundle, cfg.against, cfg.key, cfg.expect_digest, cfg.allow)
    except StictionError as error:
        if cfg.json:
            print(json.dumps({"ok": False, "bundle": cfg.bundle.name, "error": str(error)}, indent=2))
        raise
    if cfg.json:
        print(json.dumps(found.to_dict(), indent=2))
    else:
        _print(
            found.check, "expected" if cfg.expect_digest is not None else "allowed" if cfg.allow is not None else None
        )


def _print(check, known: str | None) -> None:
    """Print what was checked as a table; `known`: whether its digest was `expected`, or `allowed`."""
    from rich.table import Table

    from stiction.deploy.check import TOLERANCE, target_limits_text
    from stiction.files.golden import exercise_of
    from stiction.files.known_friction import known_friction_text
    from stiction.files.onset import golden_motion, predict_onset
    from stiction.report.terminal import Terminal

    bundle, contract = check.bundle, check.bundle.contract
    unchecked = "there is one, of whom was not checked: name the maker's public key, --key"
    signature = f"by the key {check.signer}" if check.signer else "none" if bundle.signature is None else unchecked
    rows = {
        "files": f"{5 + (bundle.wear is not None)}, {bundle.size / 1e6:.2f} MB, as SHA256SUMS says",
        "digest": bundle.digest + ("" if known is None else f", as {known}"),
        "signature": signature,
        "contract": f"{contract.robot}, {contract.num_joints} joints, every {contract.control_period:g} s; "
        f"trained with {contract.method!r}, nominal friction {100 * contract.friction_level:g} % of the torque limit",
        "network": f"observation {contract.observation.size} -> action {contract.num_joints}, nothing outside the file",
        "replay": f"{check.steps} steps; largest difference {check.observation_error:.1e} in the observation, "
        f"{check.action_error:.1e} in the action, {check.target_error:.1e} rad in the target (allowed {TOLERANCE:g})",
    }
    rows["exercised"] = _exercise(exercise_of(bundle.golden, contract))
    rows["target limits"] = target_limits_text(contract)
    if not contract.met_friction:
        predicted = predict_onset(contract, golden_motion(bundle.golden, contract))
        walk = "its recording has friction: stiction evaluate walks without"
        rows["predicted"] = walk if predicted is None else predicted.text
    if contract.known_friction is not None:
        file = contract.known_friction_file
        source = "nominal in its training" if file is None else f"as {file['name']} says"
        rows["told friction"] = f"{known_friction_text(contract.known_friction)}, {source}"
    if bundle.wear is not None and not bundle.wear_bound:
        rows["wear monitor"] = "not bound to the policy by its recording, as in bundles of older versions"
    table = Table(title=f"{bundle.name}: every check passed", title_justify="left", show_header=False)
    for name, text in rows.items():
        table.add_row(name, text)
    console = Terminal()
    console.print(table)
    if check.signer is None and known is None:
        console.print(
            "Checksums find accidents, signatures find authors: --key, or --expect-digest, says whose bundle this is."
        )


def _exercise(found: Exercise) -> str:
    """Return what a recording exercises, and what it says nothing of, in words."""
    shown = [f"{found.resets} resets on the way"]
    shown += ["a history that rolls over"] if found.rolls_over else []
    text = "; ".join([*shown, *found.reached])
    if not found.missed:
        return text
    return f"{text}. Not: {', '.join(found.missed)}; of those the replay says nothing (bundles of today have them)"


DESCRIPTION = (
    "Check a policy bundle: the set of files and their digests, the contract, the network's operators, sizes and work, "
    "its first run in a process with little memory and time, and a replay of the recorded sensors. Checksums find "
    "accidents, signatures find authors: --key. Needs neither torch nor a simulator.\n\n"
    "Examples:\n  stiction verify runs/mine/bundle\n  stiction verify bundle --key maker.pub --against robot.xml"
)
