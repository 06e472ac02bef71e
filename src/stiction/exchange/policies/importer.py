"""A policy of others as a bundle: its network, what its files say of it, a robot, and a walk that was recorded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from stiction.core.errors import BundleError, ConfigurationError, FileError
from stiction.core.files import read_bounded
from stiction.core.provenance import git_revision
from stiction.core.yaml_files import SettingsLoader, read_yaml
from stiction.deploy.check import BundleCheck, check_bundle
from stiction.deploy.network_file import MOST_BYTES
from stiction.deploy.policy import check_model, load_policy
from stiction.evaluation.golden import record_golden
from stiction.exchange.policies.description import Said, contract_of, merged, require
from stiction.exchange.policies.holosoma import is_holosoma, said_by_holosoma
from stiction.exchange.policies.mjlab import is_mjlab, said_by_mjlab
from stiction.exchange.policies.onnx_file import ForeignNetwork, read_foreign
from stiction.exchange.policies.rl_sar import entries_of, is_rl_sar, said_by_rl_sar
from stiction.exchange.policies.settings import said_in_settings
from stiction.exchange.policies.unitree import is_deploy, said_in_deploy
from stiction.exchange.policies.values import take
from stiction.files.bundle import write_bundle
from stiction.files.contract import Contract
from stiction.robots.catalog import find_robot
from stiction.robots.model import Robot
from stiction.robots.named import check_named

CARD = """\
# {name}, imported

A policy for the robot `{robot}` that was trained elsewhere. Its network is `{network}` (SHA-256 {digest}), rewritten
with our names; how it observes and acts is in `contract.json`, as these files say: {files}.

What it met in training, ground, friction and randomisation, is not known: `terrain`, `method`, `seed` and the fields of
friction of the contract say nothing. The physics step is that of the evaluation here. Masses, torque limits, rotors'
inertia and the order of the maker's joints are those of the robot's file that was given.

`golden.npz` was recorded in MuJoCo with this network, onnxruntime and NumPy: it shows that another machine computes the
same, not that the files above say what the training did. {notes}

| | |
|---|---|
| joints | {joints} |
| control period | {period:g} s |
| observation | {observation} |
| made by | `{command}` |
"""


def read_network(path: Path) -> tuple[bytes, ForeignNetwork]:
    """Return the bytes and the content of an ONNX file of others. Raises `StictionError`."""
    data = read_bounded(path, "a network in ONNX", FileError, MOST_BYTES)
    return data, read_foreign(data, path.name)


def said_of(network: ForeignNetwork, name: str, settings: Sequence[Path], robot: Robot) -> Said:
    """Return what is said of a policy: by its network's metadata, then by files of settings, in their order.

    Args:
        network: as from `read_network`.
        name: of its file, for messages.
        settings: our settings, a deploy.yaml, or rl_sar's config.yaml and base.yaml.
        robot: whose maker's order of joints a deploy.yaml means.

    Raises `StictionError`: an entry that is not known or not to be held, or something that nobody says.

    """
    said, maker = Said(), None if robot.vendor is None else robot.vendor.order
    rl_sar: dict[str, Any] = {}
    if is_mjlab(network.metadata):
        said = said_by_mjlab(network.metadata, name)
    elif is_holosoma(network.metadata):
        said = said_by_holosoma(network.metadata, name)
    own: list[tuple[dict[str, Any], str]] = []
    for path in settings:
        plain = read_yaml(path, "settings of a policy", FileError, SettingsLoader)
        content = dict(take.mapping(plain, f"{path}: the file"))
        if is_deploy(content):
            said = merged(said, said_in_deploy(content, path.name, maker))
        elif is_rl_sar(content):
            # A policy's own entries stand over those of its robot, in whatever order the files are given; the
            # robot's, its base.yaml, is the one with `dt`.
            inner = entries_of(content, path.name)
            rl_sar = inner | rl_sar if "dt" in inner else rl_sar | inner
        else:
            own.append((content, path.name))
    if rl_sar:
        said = merged(said, said_by_rl_sar(rl_sar, "config.yaml and base.yaml"))
    for content, where in own:
        said = merged(said, said_in_settings(content, where))
    files = [name, *(path.name for path in settings)]
    require(said, f"{' and '.join(files)} {'do' if settings else 'does'}")
    return said


def import_policy(
    path: Path,
    robot: str,
    out: Path,
    settings: Sequence[Path] = (),
    command: str = "stiction import",
    say: Callable[[str], None] = lambda note: None,
) -> BundleCheck:
    """Write a policy of others as a bundle and check it.

    Args:
        path: its network, ONNX.
        robot: what it walks on, see `find_robot`.
        out: directory to make.
        settings: see `said_of`.
        command: the command line.
        say: called with what a user should know, a sentence each.

    Raises:
        StictionError: the network is not to be read, something is not said, robot and policy do not fit, `out` exists,
            or the bundle does not pass its own check.

    """
    if out.exists():
        raise BundleError(f"{out} exists already; choose another --out or remove it")
    data, network = read_network(path)
    spec = find_robot(robot)
    check_named(spec)
    said = said_of(network, path.name, settings, spec)
    for note in said.notes:
        say(note)
    contract = contract_of(said, spec, (path.name, data), git_revision(), command)
    if contract.robot != spec.name:
        say(f"gains or torque limits of the policy exceed those of {spec.name}; the bundle calls its robot "
            f"{contract.robot}")  # fmt: skip
    sizes = contract.observation.size, contract.num_joints
    if sizes != (network.observation_size, network.num_actions):
        raise ConfigurationError(
            f"{path.name} takes {network.observation_size} numbers and gives {network.num_actions}; what is said of it "
            f"makes {sizes[0]} ({_terms(contract)}) and {sizes[1]}: a term, a history or a joint is wrong"
        )
    model = network.write()
    check_model(model, *sizes)
    assert contract.anatomy is not None
    golden = record_golden(contract, load_policy(contract, model, (1,)), contract.anatomy)
    files = ", ".join(f"`{each.name}`" for each in (path, *settings))
    card = CARD.format(
        name=path.stem,
        robot=contract.robot,
        network=path.name,
        digest=(contract.imported or {})["sha256"],
        files=files,
        notes=" ".join(f"{note[0].upper()}{note[1:]}." for note in said.notes),
        joints=", ".join(contract.joint_names),
        period=contract.control_period,
        observation=_terms(contract),
        command=command,
    )
    return check_bundle(write_bundle(out, contract, model, golden, card))


def _terms(contract: Contract) -> str:
    """Return the terms of an observation with their sizes, in words."""
    layout = contract.observation
    return ", ".join(
        f"{term.name} {term.size}{f' x {layout.history_of(term)}' if layout.history_of(term) > 1 else ''}"
        for term in layout.terms
    )
