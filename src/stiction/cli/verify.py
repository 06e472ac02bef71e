"""`stiction verify BUNDLE`: every file, the contract, and the golden vectors, with onnxruntime and NumPy alone."""

from __future__ import annotations

import json
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from stiction.core.errors import StictionError
from stiction.core.flags import ARGUMENT
from stiction.core.options import read_options
from stiction.report.glance import Glance, print_glance
from stiction.report.terminal import Terminal

if TYPE_CHECKING:
    from stiction.deploy.check import BundleCheck


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
        verification = verified(cfg.bundle, cfg.against, cfg.key, cfg.expect_digest, cfg.allow)
    except StictionError as error:
        if cfg.json:
            print(json.dumps({"ok": False, "bundle": cfg.bundle.name, "error": str(error)}, indent=2))
        raise
    if cfg.json:
        print(json.dumps(verification.to_dict(), indent=2))
    else:
        known = "expected" if cfg.expect_digest is not None else "allowed" if cfg.allow is not None else None
        print_glance(Terminal(), _glance(verification.check, str(cfg.bundle), known))


def _glance(check: BundleCheck, bundle_path: str, known: str | None) -> Glance:
    """Return the glance at a valid bundle; bundle_path: as typed; known: digest `expected` or `allowed`, or None."""
    from stiction.deploy.check import target_limits_text
    from stiction.files.golden import exercise_of
    from stiction.files.known_friction import known_friction_text
    from stiction.files.onset import golden_motion, predict_standstill

    bundle, contract = check.bundle, check.bundle.contract
    notes, missed = [], exercise_of(bundle.golden, contract).missed
    if check.signer is None and known is None:
        nobody = "its signature was not checked, --key does" if bundle.signature else "it has no signature"
        notes.append(f"whose it is was not checked: {nobody}, or --expect-digest")
    if missed:
        notes.append(f"its recording, and so the replay, says nothing of: {', '.join(missed)}")
    if contract.target_limits is None:
        notes.append(f"target limits: {target_limits_text(contract)}")
    if not contract.met_friction:
        motion = golden_motion(bundle.golden, contract)
        why = "how much friction it bears is not predicted here: its recording has friction, or no torque"
        predicted = why if motion is None else f"predicted: {predict_standstill(contract, motion).text}"
        notes.append(f"trained without friction; {predicted}")
    if contract.known_friction is not None:
        file = contract.known_friction_file
        source = "nominal in its training" if file is None else f"as {file['name']} says"
        notes.append(f"it is told its joints' friction: {known_friction_text(contract.known_friction)}, {source}")
    if bundle.wear is not None and not bundle.wear_bound:
        notes.append("its wear monitor is not bound to the policy by its recording, as in bundles of older versions")
    files = 5 + (bundle.wear is not None)
    checked = f"{files} files, network, {check.steps} steps to {check.target_error:.1e} rad"
    signed = f", signed by the key {check.signer}" if check.signer else ""
    return Glance(
        f"{bundle.name}: {contract.robot}, trained {contract.trained}",
        "Verified",
        f"every check passed, {checked}{signed}",
        "good",
        f"stiction evaluate {shlex.quote(bundle_path)}",
        notes=tuple(notes),
        why=f"digest {bundle.digest}" + ("" if known is None else f", as {known}"),
    )


DESCRIPTION = (
    "Check a policy bundle: the set of files and their digests, the contract, the network's operators, sizes and work, "
    "its first run in a process with little memory and time, and a replay of the recorded sensors. Checksums find "
    "accidents, signatures find authors: --key. Needs neither torch nor a simulator.\n\n"
    "Examples:\n  stiction verify runs/mine/bundle\n  stiction verify bundle --key maker.pub --against robot.xml"
)
