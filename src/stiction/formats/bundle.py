"""A policy bundle: a directory of five files that holds everything needed to run a policy, and to check it.

A sixth, wear.json, may hold a map from the policy's walk to the friction of its joints. SHA256SUMS guards against
damage and mix-ups. It is not a signature: whoever can write all files can write a consistent bundle of another policy.
Take bundles from where you trust, and compare `Bundle.digest` with what its maker published.

The golden vectors are recorded by `export` with the policy as training computes it, in torch; `verify` and robots
replay them with NumPy and onnxruntime. They also hold the SHA-256 of the bundle's other files, so that a contract or a
card edited afterwards no longer fits.
"""

from __future__ import annotations

import hashlib
import io
import stat
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from importlib import resources
from pathlib import Path

import numpy as np

from stiction.core.cache import publish
from stiction.core.errors import BundleError, LogError, unknown_name
from stiction.formats.contract import Contract, read_contract
from stiction.formats.tables import parse_npz
from stiction.formats.wear import WearModel, read_wear

MIN_STEPS = 500
"""Steps that golden vectors must have: ten seconds at 50 Hz."""

MAX_BYTES = 64 * 2**20
"""Largest size of a file, and of the golden vectors unpacked [B]: a small archive may not fill the memory."""


@dataclass(frozen=True)
class Golden:
    """A recorded rollout of one robot, T steps. Angles [rad], velocities [rad/s]."""

    joint_names: np.ndarray
    """Names of the joints, text, shape (J,)."""
    time: np.ndarray
    """Time since the start of the recording [s], shape (T,)."""
    reset: np.ndarray
    """True where the history starts anew before this step, bool, shape (T,)."""
    command: np.ndarray
    """Commanded velocity: forward, sideways [m/s], turn [rad/s], shape (T, 3)."""
    quaternion: np.ndarray
    """Measured orientation of the base, w x y z, shape (T, 4)."""
    angular_velocity: np.ndarray
    """Measured angular velocity in the base frame [rad/s], shape (T, 3)."""
    joint_position: np.ndarray
    """Measured joint angles [rad], shape (T, J)."""
    joint_velocity: np.ndarray
    """Measured joint velocities [rad/s], shape (T, J)."""
    observation: np.ndarray
    """Input of the network, float32, shape (T, observation size)."""
    action: np.ndarray
    """Output of the network after clipping, float32, shape (T, J)."""
    target: np.ndarray
    """Joint targets [rad], shape (T, J)."""

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.time)


BOUND = "sha256:"
"""Prefix of the arrays that hold the SHA-256 of the bundle's other files."""


def write_golden(golden: Golden, digests: Mapping[str, str]) -> bytes:
    """Return the bytes of golden.npz; `digests` maps the bundle's other files to their SHA-256 in hexadecimal."""
    arrays = {field.name: getattr(golden, field.name) for field in fields(Golden)}
    arrays |= {BOUND + name: np.array(digest) for name, digest in digests.items()}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def read_golden(data: bytes, observation_size: int, joint_names: tuple[str, ...]) -> tuple[Golden, dict[str, str]]:
    """Parse golden.npz and check it against the contract's sizes; return it and the digests that it binds.

    Raises:
        BundleError: not an NPZ, too large unpacked, an array missing, unknown, of the wrong shape or type, not finite,
            fewer than `MIN_STEPS` steps, fewer than two resets, or no reset at the first step.

    """
    try:
        arrays = parse_npz("golden.npz", data, MAX_BYTES)
    except LogError as error:
        raise BundleError(f"{error}; export the bundle again") from error
    digests = {name.removeprefix(BOUND): str(arrays.pop(name)) for name in list(arrays) if name.startswith(BOUND)}
    expected = {field.name for field in fields(Golden)}
    if arrays.keys() != expected:
        odd = sorted(arrays.keys() ^ expected)
        raise BundleError(f"golden.npz: the array {odd[0]!r} is missing or unknown; export the bundle again")
    golden = Golden(**arrays)
    _check(golden, observation_size, joint_names)
    return golden, digests


def _check(golden: Golden, observation_size: int, joint_names: tuple[str, ...]) -> None:
    """Check names, shapes, types and values."""
    if golden.joint_names.dtype.kind != "U" or tuple(golden.joint_names.tolist()) != joint_names:
        raise BundleError(f"golden.npz is for the joints {golden.joint_names.tolist()}, the contract has {joint_names}")
    steps, joints = golden.time.shape[0] if golden.time.ndim else 0, len(joint_names)
    widths = {"command": 3, "quaternion": 4, "angular_velocity": 3, "observation": observation_size}
    widths |= {"joint_position": joints, "joint_velocity": joints, "action": joints, "target": joints}
    shapes = {"time": (steps,), "reset": (steps,), **{name: (steps, width) for name, width in widths.items()}}
    for name, shape in shapes.items():
        array = getattr(golden, name)
        kinds = "b" if name == "reset" else "f"
        if array.shape != shape or array.dtype.kind not in kinds:
            raise BundleError(f"golden.npz: {name!r} is {array.dtype} {array.shape}; expected {shape}, kind {kinds!r}")
        if not np.isfinite(array).all():
            raise BundleError(f"golden.npz: {name!r} contains numbers that are not finite")
    if steps < MIN_STEPS:
        raise BundleError(f"golden.npz has {steps} steps; at least {MIN_STEPS} are needed")
    if not golden.reset[0] or golden.reset.sum() < 2:
        raise BundleError("golden.npz must start with a reset and contain at least one more")


POLICY, CONTRACT, GOLDEN, CARD, SUMS = "policy.onnx", "contract.json", "golden.npz", "card.md", "SHA256SUMS"

BOUND_FILES = (CONTRACT, POLICY, CARD)
"""Files whose SHA-256 the golden vectors repeat."""

FILES = (CARD, CONTRACT, GOLDEN, POLICY)
"""Files that SHA256SUMS lists, in its order; after them `WEAR`, where there is one."""

WEAR = "wear.json"
"""The map of the wear monitor, a file that a bundle may have."""


@dataclass(frozen=True)
class Bundle:
    """A bundle that was read whole, its checksums and its contract checked. What was hashed is what is used."""

    name: str
    """Name of the directory."""
    contract: Contract
    """What the policy expects of robot and runtime."""
    policy: bytes
    """The network, ONNX."""
    golden: Golden
    """The golden vectors."""
    card: str
    """Description for people, Markdown."""
    digest: str
    """SHA-256 of SHA256SUMS: one number that names the whole bundle."""
    size: int
    """Size of all files together [B]."""
    wear: WearModel | None = None
    """The map of the wear monitor, checked; None where there is none."""


def read_bundle(path: Path | str) -> Bundle:
    """Read a bundle; check the set of files, sizes, checksums, contract, and what the golden vectors bind.

    Raises:
        BundleError: a file missing, too many, a link, too large, malformed, or not what SHA256SUMS or golden.npz say
            it is.

    """
    folder = Path(path)
    contents = _read_files(folder)
    digests = {name: _sha256(contents[name]) for name in listed(contents)}
    sums = contents[SUMS]
    if sums != _sums(digests):
        _explain_sums(folder, sums, digests)
    contract = read_contract(contents[CONTRACT])
    golden, bound = read_golden(contents[GOLDEN], contract.observation.size, contract.joint_names)
    if bound.keys() != set(BOUND_FILES):
        raise BundleError(f"{folder}: golden.npz binds {sorted(bound)}; expected {sorted(BOUND_FILES)}")
    for name in BOUND_FILES:
        if bound[name] != digests[name]:
            raise BundleError(f"{folder}: {name} is not the file that golden.npz was recorded with; export it again")
    try:
        card = contents[CARD].decode("utf-8")
    except UnicodeDecodeError as error:
        raise BundleError(f"{folder}: {CARD} is not UTF-8 text: {error}") from error
    wear = read_wear(contents[WEAR]) if WEAR in contents else None
    if wear is not None and wear.joint_names != contract.joint_names:
        raise BundleError(f"{folder}: {WEAR} is for other joints than the contract; export it again")
    size = sum(map(len, contents.values()))
    return Bundle(folder.resolve().name, contract, contents[POLICY], golden, card, _sha256(sums), size, wear)


def listed(names: Collection[str]) -> tuple[str, ...]:
    """Return the files that SHA256SUMS lists, in its order, of a bundle that has the files `names`."""
    return (*FILES, WEAR) if WEAR in names else FILES


def write_bundle(
    path: Path | str, contract: Contract, policy: bytes, golden: Golden, card: str, wear: WearModel | None = None
) -> Path:
    """Write a bundle to a directory that does not exist yet, whole or not at all; return its path.

    Raises:
        BundleError: the directory exists already.

    """
    folder = Path(path)
    if folder.exists():
        raise BundleError(f"{folder} exists already; choose another --out or remove it")
    contents = {POLICY: policy, CONTRACT: contract.to_json().encode(), CARD: card.encode()}
    contents[GOLDEN] = write_golden(golden, {name: _sha256(data) for name, data in contents.items()})
    if wear is not None:
        contents[WEAR] = wear.to_json().encode()
    contents[SUMS] = _sums({name: _sha256(data) for name, data in contents.items()})
    with publish(folder) as partial:
        partial.mkdir()
        for name, data in contents.items():
            (partial / name).write_bytes(data)
    return folder


def _sha256(data: bytes) -> str:
    """Return a digest in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def _sums(digests: dict[str, str]) -> bytes:
    """Return the text of SHA256SUMS, as `sha256sum --check` reads it."""
    return "".join(f"{digests[name]}  {name}\n" for name in listed(digests)).encode()


def _read_files(folder: Path) -> dict[str, bytes]:
    """Read the five files, wear.json where there is one, and nothing but plain files of a bounded size."""
    if not folder.is_dir():
        what = "is not a directory" if folder.exists() else "does not exist"
        raise BundleError(f"{folder} {what}; expected a policy bundle, a directory with {', '.join((*FILES, SUMS))}")
    try:
        found = {entry.name: entry.lstat() for entry in folder.iterdir()}
    except OSError as error:
        raise BundleError(f"{folder}: cannot be listed: {error}") from error
    for name in (*FILES, SUMS):
        if name not in found:
            raise BundleError(f"{folder}: {name} is missing; a policy bundle has {', '.join((*FILES, SUMS))}")
    if extra := sorted(found.keys() - {*FILES, SUMS, WEAR}):
        raise BundleError(f"{folder}: {extra[0]} does not belong into a policy bundle; remove it or export again")
    for name, status in found.items():
        if not stat.S_ISREG(status.st_mode):
            raise BundleError(f"{folder}: {name} is not a plain file; links and directories are refused")
        if status.st_size > MAX_BYTES:
            raise BundleError(f"{folder}: {name} has {status.st_size} bytes; at most {MAX_BYTES} are read")
    try:
        return {name: (folder / name).read_bytes() for name in found}
    except OSError as error:
        raise BundleError(f"{folder}: cannot be read: {error}") from error


def _explain_sums(folder: Path, sums: bytes, digests: dict[str, str]) -> None:
    """Raise `BundleError` that names the first file that differs from SHA256SUMS."""
    lines = sums.splitlines()
    for name in listed(digests):
        if f"{digests[name]}  {name}".encode() not in lines:
            raise BundleError(
                f"{folder}: {name} does not match {SUMS}: it was altered or damaged; get the bundle again"
            )
    raise BundleError(
        f"{folder}: {SUMS} was altered: it must list exactly {', '.join(listed(digests))}; get the bundle again"
    )


def shipped_bundles() -> dict[str, Path]:
    """Return name -> directory of every shipped bundle, in alphabetical order; empty where none came along."""
    folder = Path(str(resources.files("stiction").joinpath("policies")))
    if not folder.is_dir():
        return {}
    return {entry.name: entry for entry in sorted(folder.iterdir()) if (entry / CONTRACT).is_file()}


def find_bundle(name: Path) -> Path:
    """Return the directory that `name` means: a path, or the name of a shipped bundle where no such path exists.

    Raises `BundleError` where a name, without folders before it, is neither.
    """
    if name.exists() or len(name.parts) > 1:
        return name
    shipped = shipped_bundles()
    if str(name) not in shipped:
        raise BundleError(f"{unknown_name('policy', str(name), shipped)}; or give the directory of a bundle")
    return shipped[str(name)]
