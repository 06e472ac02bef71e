"""Import of a policy of others as a bundle: its network, its description, a robot, and a recorded walk."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from stiction.core.errors import BundleError, ConfigurationError, FileError
from stiction.core.files import read_bounded
from stiction.core.provenance import git_revision
from stiction.core.yaml_files import SettingsLoader, read_yaml
from stiction.deploy.check import BundleCheck, write_checked
from stiction.deploy.network_file import MOST_BYTES
from stiction.deploy.policy import check_model, load_policy
from stiction.evaluation.golden import record_golden
from stiction.exchange.policies.description import PolicySpec, contract_of, merged, require, with_length
from stiction.exchange.policies.holosoma import is_holosoma, read_holosoma
from stiction.exchange.policies.mjlab import is_mjlab, read_mjlab
from stiction.exchange.policies.onnx_file import ForeignNetwork, read_foreign
from stiction.exchange.policies.presets import with_preset
from stiction.exchange.policies.rl_sar import entries_of, is_rl_sar, read_rl_sar
from stiction.exchange.policies.settings import read_settings
from stiction.exchange.policies.unitree import is_deploy, read_deploy
from stiction.exchange.policies.values import take
from stiction.files.contract import Contract, limits_text
from stiction.robots.catalog import find_derived
from stiction.robots.named import check_named
from stiction.robots.record import Derived

CARD = """\
# {name}, imported

A policy for the robot `{robot}` that was trained elsewhere. Its network is `{network}` (SHA-256 {digest}), rewritten
with our names; how it observes and acts is in `contract.json`, as these files say: {files}.

What it met in training, ground, friction and randomisation, is not known: `terrain`, `method`, `seed` and the fields of
friction of the contract say nothing. The physics step is that of the evaluation here. Masses, rotors' inertia
and the order of the maker's joints are those of the robot's file that was given{limits}.

`golden.npz` was recorded in MuJoCo with this network, onnxruntime and NumPy: it shows that another machine computes the
same, not that the files above say what the training did. {notes}

| | |
|---|---|
| joints | {joints} |
| torque limits | {torque} N m |
| control period | {period:g} s |
| observation | {observation} |
| made by | `{command}` |
"""


PLAIN = re.compile(r"[A-Za-z0-9_-][\w.+-]{0,199}", re.ASCII)
"""Names of files that a network may keep its numbers in: of its own folder."""


TRAINERS = (("mjlab", is_mjlab, read_mjlab), ("holosoma", is_holosoma, read_holosoma))
"""Trainer, detector of its metadata, and their reader."""


def read_network(path: Path) -> tuple[bytes, ForeignNetwork]:
    """Return the bytes and the content of an ONNX file of others. Raises `StictionError`."""

    def read_external(name: str) -> bytes:
        file = path.parent / name
        if not PLAIN.fullmatch(name):
            raise FileError(f"keeps its numbers in {name[:80]!r}; expected a plain name of a file beside it")
        if file.is_symlink() or not file.is_file():
            remedy = shlex.join(["python", "-c", f"import onnx; onnx.save(onnx.load({path.name!r}), 'one.onnx')"])
            raise FileError(
                f"keeps its numbers in {name!r}, which is no file beside it; put it there, or make one file where it "
                f"is: {remedy}"
            )
        return read_bounded(file, "the numbers of a network", FileError, MOST_BYTES)

    data = read_bounded(path, "a network in ONNX", FileError, MOST_BYTES)
    return data, read_foreign(data, path.name, read_external)


def describe_policy(
    network: ForeignNetwork, name: str, settings: Sequence[Path], derived: Derived, preset: str | None = None
) -> PolicySpec:
    """Return the description of a policy: by its network's metadata, then by files of settings, in their order.

    Args:
        network: as from `read_network`.
        name: of its file, for messages.
        settings: our settings, a deploy.yaml, or rl_sar's config.yaml and base.yaml.
        derived: robot whose maker's order of joints a deploy.yaml means.
        preset: name in `presets.PRESETS` of the preset that fills the gaps, or None.

    Raises `StictionError`: an entry that is not known or cannot be held, or a missing one.

    """
    vendor = derived.robot.vendor
    spec, maker = PolicySpec(), None if vendor is None else vendor.order
    rl_sar: dict[str, Any] = {}
    for trainer, known, read in TRAINERS:
        if known(network.metadata):
            if preset not in (None, trainer):
                raise ConfigurationError(f"--preset: got {preset}, and the metadata of {name} are {trainer}'s; leave "
                                         "it out, or name the trainer of this network")  # fmt: skip
            spec = read(network.metadata, name)
            break
    ours: list[tuple[dict[str, Any], str]] = []
    for path in settings:
        plain = read_yaml(path, "settings of a policy", FileError, SettingsLoader)
        content = dict(take.mapping(plain, f"{path}: the file"))
        if is_deploy(content):
            spec = merged(spec, read_deploy(content, path.name, maker))
        elif is_rl_sar(content):
            # A policy's own entries stand over those of its robot, in whatever order the files are given; the
            # robot's, its base.yaml, is the one with `dt`.
            inner = entries_of(content, path.name)
            rl_sar = inner | rl_sar if "dt" in inner else rl_sar | inner
        else:
            ours.append((content, path.name))
    if rl_sar:
        spec = merged(spec, read_rl_sar(rl_sar, "config.yaml and base.yaml"))
    for content, where in ours:
        spec = merged(spec, read_settings(content, where))
    joints = derived.robot.joint_names if spec.joint_names is None else spec.joint_names
    if len(joints) != network.num_actions:
        whose = f"{derived.robot.name} drives" if spec.joint_names is None else "its description names"
        raise ConfigurationError(
            f"{name}: the network gives {network.num_actions} actions, {whose} {len(joints)} joints; expected one "
            "action a joint: give the --robot that it was trained for"
        )
    if preset is not None:
        spec = with_preset(spec, preset, derived, network.observation_size, network.num_actions)
    spec = with_length(spec, network.observation_size, network.num_actions)
    files = [name, *(path.name for path in settings)]
    require(spec, f"{' and '.join(files)} {'do' if settings else 'does'}")
    return spec


def import_policy(
    path: Path,
    robot: str,
    out: Path,
    settings: Sequence[Path] = (),
    command: str = "stiction import",
    say: Callable[[str], None] = lambda note: None,
    preset: str | None = None,
) -> BundleCheck:
    """Write a policy of others as a bundle and check it.

    Args:
        path: its network, ONNX.
        robot: what it walks on, see `find_robot`.
        out: directory to make.
        settings: see `describe_policy`.
        command: the command line.
        say: called with each note for the user, a sentence.
        preset: see `describe_policy`.

    Raises:
        StictionError: the network is not supported, a field is missing, robot and policy do not fit, `out` exists,
            or the bundle does not pass its own check.

    """
    if out.exists():
        raise BundleError(f"{out} exists already; choose another --out or remove it")
    data, network = read_network(path)
    derived = find_derived(robot)
    spec = derived.robot
    check_named(spec)
    policy = describe_policy(network, path.name, settings, derived, preset)
    contract = contract_of(policy, spec, (path.name, data), git_revision(), command)
    outside = [f"the numbers of {path.name} lay in {', '.join(network.files)} beside it"] if network.files else []
    replaced = limits_text(contract, spec)
    notes = [*outside, *policy.notes, *([f"the policy's torque limits are {replaced}"] if replaced else [])]
    # Notes on the robot's file are not on the policy: the card leaves them out.
    for note in (*(f"{robot}: {note}" for note in derived.notes), *notes):
        say(note)
    if contract.robot != spec.name:
        say(f"gains or torque limits of the policy exceed those of {spec.name}; the bundle calls its robot "
            f"{contract.robot}")  # fmt: skip
    sizes = contract.observation.size, contract.num_joints
    if sizes != (network.observation_size, network.num_actions):
        raise ConfigurationError(
            f"{path.name} takes {network.observation_size} numbers and gives {network.num_actions}; its description "
            f"makes {sizes[0]} ({_terms(contract)}) and {sizes[1]}: a term, a history or a joint is wrong"
        )
    model = network.write()
    check_model(model, *sizes)
    assert contract.anatomy is not None
    golden = record_golden(contract, load_policy(contract, model, (1,)), contract.anatomy)
    names = tuple(each.name for each in (path, *settings))
    card = card_of(contract, names, notes, bool(replaced), command)
    try:
        return write_checked(out, contract, model, golden, card)
    except BundleError as error:
        if not str(error).startswith("golden.npz: "):
            raise
        raise ConfigurationError(
            f"{path.name} does not walk as a policy of this robot does, with kp {_span(contract.kp)} N m/rad and kd "
            f"{_span(contract.kd)} N m s/rad: {str(error).removeprefix('golden.npz: ')}; are gains, default_position "
            "and action_scale those that it was trained with?"
        ) from error


def card_of(contract: Contract, files: Sequence[str], notes: Sequence[str], limits: bool, command: str) -> str:
    """Return the card of an imported policy.

    files: names of the network and of its settings; limits: True if the policy's torque limits are not its robot's.
    """
    return CARD.format(
        name=Path(files[0]).stem,
        robot=contract.robot,
        network=files[0],
        digest=(contract.imported or {})["sha256"],
        files=", ".join(f"`{name}`" for name in files),
        limits="; torque limits are the policy's" if limits else ", torque limits too",
        torque=_span(contract.torque_limit),
        notes=" ".join(f"{note[0].upper()}{note[1:]}." for note in notes),
        joints=", ".join(contract.joint_names),
        period=contract.control_period,
        observation=_terms(contract),
        command=command,
    )


def _span(values: Sequence[float]) -> str:
    """Return the smallest and the largest of values."""
    low, high = min(values), max(values)
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def _terms(contract: Contract) -> str:
    """Return the terms of an observation with their sizes, in words."""
    layout = contract.observation
    return ", ".join(
        f"{term.name} {term.size}{f' x {layout.history_of(term)}' if layout.history_of(term) > 1 else ''}"
        for term in layout.terms
    )
