"""Export of a bundle for others: unitree_rl_lab's deploy.yaml, rl_sar's folder, a network with mjlab's metadata.

Everything is generated from the contract. The target's file holds what it can, with the bundle's network; the rest
goes into the network, see `adapter`; a part that neither can hold is rejected. The README next to it lists the
differences of the target's runtime.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from stiction import __version__
from stiction.core.errors import BundleError, PolicyError
from stiction.core.files import publish
from stiction.deploy.check import check_bundle
from stiction.deploy.network_file import NetworkFile
from stiction.exchange.policies import mjlab, rl_sar, unitree
from stiction.exchange.policies.adapter import adapted, clipped, plain_contract, with_names
from stiction.exchange.policies.description import UNBOUNDED
from stiction.exchange.policies.onnx_file import ForeignNetwork, read_foreign, write_network
from stiction.files.bundle import Bundle
from stiction.files.contract import Contract
from stiction.files.observation import ObservationLayout

Target = Literal["deploy.yaml", "rl_sar", "mjlab"]

LIMITATIONS = {"deploy.yaml": unitree.limitation, "rl_sar": rl_sar.limitation, "mjlab": mjlab.limitation}
"""Target -> function that returns the part of a layout that its file cannot hold."""

PORTS = ("obs", "actions")
"""Names of the network's input and output, as rsl_rl exports them."""

ZERO_FILL = {"deploy.yaml": False, "rl_sar": True, "mjlab": False}
"""Target -> True if its runtime begins with a history of zeros."""


@dataclass(frozen=True)
class Exported:
    """Result of an export, for any target."""

    path: Path
    bundle: Bundle
    """Checked bundle."""
    robot: str
    files: tuple[str, ...]
    """Paths of the files, relative to the folder."""
    notes: tuple[str, ...]
    """Differences of the target's runtime, a sentence each."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """Further plain data."""

    def summary(self) -> dict[str, Any]:
        """Return plain data for `--json`."""
        data = {"path": str(self.path), "robot": self.robot, "digest": self.bundle.digest}
        return data | {"files": list(self.files), "notes": list(self.notes)} | dict(self.facts)


def export_to(source: Path, out: Path, to: Target) -> Exported:
    """Write a bundle in a target's form.

    source: of the bundle, which is checked first; out: folder to make; to: the target. Raises `StictionError` where
    the bundle is invalid, the target cannot hold it, or `out` exists.
    """
    if out.exists():
        raise BundleError(f"{out} exists already; choose another --out or remove it")
    bundle = check_bundle(source).bundle
    contract, network, notes = expressed(bundle, to)
    name = _file_name(bundle.name)
    files = _files(contract, network, to, name, np.abs(bundle.golden.command).max(axis=0))
    text = README.format(
        target=to,
        robot=contract.robot,
        bundle=bundle.name,
        digest=bundle.digest,
        version=__version__,
        files="\n".join(f"* `{path}`" for path in files),
        notes="\n".join(f"* {note[0].upper()}{note[1:]}." for note in notes),
    )
    with publish(out) as partial:
        partial.mkdir()
        for path, content in (files | {"README.md": text.encode()}).items():
            (partial / path).parent.mkdir(parents=True, exist_ok=True)
            (partial / path).write_bytes(content)
    return Exported(out, bundle, contract.robot, (*files, "README.md"), tuple(notes))


def expressed(bundle: Bundle, to: Target) -> tuple[Contract, ForeignNetwork, list[str]]:
    """Return contract and network of a bundle in a form that a target can hold, and notes for the user.

    Raises `PolicyError` where it cannot.
    """
    contract, foreign = bundle.contract, read_foreign(bundle.policy, "policy.onnx")
    network = foreign.network
    if contract.compensation is not None:
        raise PolicyError("this policy's runtime adds friction to its targets (compensation); no other runtime does")
    notes = []
    lacks = LIMITATIONS[to](contract.observation)
    if lacks is None and to != "rl_sar" and contract.action_clip < UNBOUNDED:
        network, contract = clipped(contract, network), replace(contract, action_clip=UNBOUNDED)
        notes.append(f"{to} cuts no action off before it is observed: the clip is in the network")
    elif lacks is not None:
        plain = plain_contract(contract)
        if (still := LIMITATIONS[to](plain.observation)) is not None:
            raise PolicyError(f"--to {to} cannot say {lacks}, nor {still}; this bundle does not fit there")
        network, contract = adapted(contract, network), plain
        notes.append(
            f"{to} cannot say {lacks}: the network takes plain terms, and scales, clips and order of the bundle's "
            "observation are in it; do not scale them once more"
        )
    notes += _differences(bundle.contract, contract.observation, to)
    return replace(contract, command_correction=None), replace(foreign, network=network), notes


def _differences(contract: Contract, layout: ObservationLayout, to: Target) -> list[str]:
    """Return the differences between the target's runtime and ours."""
    notes = []
    if layout.depth > 1 and ZERO_FILL[to] != (layout.fill == "zero"):
        begins = {True: "zeros", False: "the first frame"}
        notes.append(
            f"its history begins with {begins[ZERO_FILL[to]]}, the bundle's with {begins[not ZERO_FILL[to]]}: the "
            f"first {layout.depth} steps differ; let the robot stand for that long"
        )
    if contract.command_correction is not None:
        notes.append(
            "the correction of commands is not in it: with friction in the joints the policy is slower than it is told"
        )
    if contract.observes_friction:
        notes.append("the friction that the policy is told is a constant in the network: of another robot export again")
    notes.append(
        "limits of joints, the check of golden vectors and what the bundle says of friction are not in its files"
    )
    if to == "mjlab":
        notes.append(f"the control period, {contract.control_period:g} s, has no entry in mjlab's metadata")
    if to == "deploy.yaml":
        notes.append("commands are kept within those of the bundle's golden recording, since it knows no others")
    return notes


def _files(contract: Contract, network: ForeignNetwork, to: Target, name: str, most: np.ndarray) -> dict[str, bytes]:
    """Return path -> content of the files of a target; name: of the policy; most: largest commands, shape (3,)."""
    model = _network_bytes(network, mjlab.metadata_of(contract) if to == "mjlab" else {})
    if to == "mjlab":
        return {f"{name}.onnx": model}
    if to == "deploy.yaml":
        deploy = _yaml(unitree.deploy_of(contract, most.tolist()))
        return {"exported/policy.onnx": model, "params/deploy.yaml": deploy}
    robot = _file_name(contract.robot)
    base, config = rl_sar.config_of(contract, "policy.onnx")
    return {
        f"{robot}/base.yaml": _yaml({robot: base}),
        f"{robot}/{name}/config.yaml": _yaml({f"{robot}/{name}": config}),
        f"{robot}/{name}/policy.onnx": model,
    }


def _network_bytes(foreign: ForeignNetwork, metadata: Mapping[str, str]) -> bytes:
    """Return the network with the names that others give its input and output."""
    network = foreign.network
    names = dict(zip((network.input.name, network.output.name), PORTS, strict=True))
    observed, acted = (replace(port, name=names[port.name]) for port in (network.input, network.output))
    renamed = NetworkFile(tuple(with_names(network.nodes, names)), network.constants, observed, acted)
    return write_network(renamed, foreign.opset, foreign.layout, metadata)


def _yaml(content: Mapping[str, Any]) -> bytes:
    """Return a mapping as YAML, lists in one line."""
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120, allow_unicode=True).encode()


def _file_name(name: str) -> str:
    """Return a name that a file can have everywhere."""
    return "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in name).strip(".") or "policy"


README = """\
# A policy for {robot}, as {target} takes it

Made from the bundle `{bundle}`, digest {digest}, by `stiction export --to {target}` {version}.
Every number is generated from the bundle's contract; change none here, export again. It has not run on a robot.

{files}

What is otherwise than with the bundle:

{notes}
"""
