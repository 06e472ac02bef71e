"""A policy bundle: a directory of five files that holds everything needed to run a policy, and to check it.

A sixth, wear.json, is there where the policy's own walk tells the friction of the joints. SHA256SUMS guards against
damage and mix-ups. It is not a signature: whoever can write all files can write a consistent bundle of another policy.
Take bundles from where you trust, and compare `Bundle.digest` with what its maker published.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from stiction.formats.contract import Contract, read_contract
from stiction.formats.errors import StictionError
from stiction.formats.golden import Golden, read_golden, write_golden
from stiction.formats.wear import WearModel, read_wear

POLICY, CONTRACT, GOLDEN, CARD, SUMS = "policy.onnx", "contract.json", "golden.npz", "card.md", "SHA256SUMS"

BOUND_FILES = (CONTRACT, POLICY, CARD)
"""Files whose SHA-256 the golden vectors repeat."""

FILES = (CARD, CONTRACT, GOLDEN, POLICY)
"""Files that SHA256SUMS lists, in its order; after them `WEAR`, where there is one."""

WEAR = "wear.json"
"""The map of the wear monitor, a file that a bundle may have."""

MAX_FILE_BYTES = 64 * 2**20
"""Largest file that is read [B]."""


class BundleError(StictionError):
    """A bundle that is incomplete, damaged or altered; the message says which file and what to do."""


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
    """The map of the wear monitor, checked; None where the policy's walk tells no friction."""


def read_bundle(path: Path | str) -> Bundle:
    """Read a bundle; check the set of files, sizes, checksums, contract, and what the golden vectors bind.

    Raises:
        BundleError: a file missing, too many, a link, too large, or not what SHA256SUMS or golden.npz say it is.
        ContractError: the contract is malformed.
        GoldenError: the golden vectors are malformed.

    """
    folder = Path(path)
    contents = _read_files(folder)
    digests = {name: hashlib.sha256(contents[name]).hexdigest() for name in listed(contents)}
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
    digest = hashlib.sha256(sums).hexdigest()
    return Bundle(folder.resolve().name, contract, contents[POLICY], golden, card, digest, size, wear)


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
    digests = {name: hashlib.sha256(data).hexdigest() for name, data in contents.items()}
    contents[GOLDEN] = write_golden(golden, digests)
    digests[GOLDEN] = hashlib.sha256(contents[GOLDEN]).hexdigest()
    if wear is not None:
        contents[WEAR] = wear.to_json().encode()
        digests[WEAR] = hashlib.sha256(contents[WEAR]).hexdigest()
    contents[SUMS] = _sums(digests)
    folder.parent.mkdir(parents=True, exist_ok=True)
    partial = folder.with_name(f".{folder.name}.partial-{os.getpid()}")
    partial.mkdir()
    try:
        for name, data in contents.items():
            with (partial / name).open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
        partial.rename(folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return folder


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
        if status.st_size > MAX_FILE_BYTES:
            raise BundleError(f"{folder}: {name} has {status.st_size} bytes; at most {MAX_FILE_BYTES} are read")
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
