"""Policy bundle: a directory of five files with everything needed to run a policy, and to check it.

A sixth, wear.json, may hold a map from the policy's walk to the friction of its joints. Checksums detect accidents:
anyone who can write all files can write a consistent bundle of another policy. Signatures prove authorship:
SHA256SUMS.sig, an optional seventh file, is the maker's Ed25519 signature of SHA256SUMS, which lists all others.
Without it, compare `Bundle.digest` with the digest that the maker published.

A policy record is a bundle without its golden.npz, the largest file next to the network. SHA256SUMS still lists it, so
that the digest stays the bundle's. A record walks in simulation; nothing proves that its network computes as recorded.
"""

from __future__ import annotations

import hashlib
import re
import shlex
import stat
from collections.abc import Callable, Collection
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from stiction.core.errors import BundleError, unknown_name
from stiction.core.files import publish, read_bounded
from stiction.files.contract import Contract, read_contract
from stiction.files.golden import Golden, read_golden, write_golden
from stiction.files.wear import WearModel, read_wear

POLICY, CONTRACT, GOLDEN, CARD, SUMS = "policy.onnx", "contract.json", "golden.npz", "card.md", "SHA256SUMS"

BOUND_FILES = (CONTRACT, POLICY, CARD)
"""Files whose SHA-256 the golden vectors repeat; `WEAR` follows, if present."""

FILES = (CARD, CONTRACT, GOLDEN, POLICY)
"""Files that SHA256SUMS lists, in its order; `WEAR` follows, if present."""

WEAR = "wear.json"
"""Map of the wear monitor, an optional file."""

SIGNATURE, SIGNATURE_SIZE = "SHA256SUMS.sig", 64
"""Maker's signature of SHA256SUMS, an optional file, and its size [B]. No checksum covers it."""

GOLDEN_LINE = re.compile(rb"^([0-9a-f]{64})  golden\.npz$", re.MULTILINE)
"""Line of SHA256SUMS for the golden vectors, also in a policy record."""

MAX_BYTES = {POLICY: 32 * 2**20, GOLDEN: 32 * 2**20, CONTRACT: 4 * 2**20, WEAR: 4 * 2**20, CARD: 2**20, SUMS: 4096}
MAX_BYTES |= {SIGNATURE: SIGNATURE_SIZE}
"""Maximum size of each file [B]: tens of times that of the shipped bundles, and small enough for a small computer."""


@dataclass(frozen=True)
class Bundle:
    """Bundle as read, with its checksums and its contract checked; all uses are of the hashed bytes."""

    name: str
    contract: Contract
    policy: bytes
    vectors: Golden | None
    card: str
    digest: str
    """SHA-256 of SHA256SUMS, which identifies the whole bundle."""
    size: int
    """Size of all files together [B]."""
    wear: WearModel | None = None
    """Map of the wear monitor, checked; or None."""
    wear_bound: bool = False
    """True if the golden vectors bind the map to this policy; in older bundles they do not."""
    sums: bytes = b""
    signature: bytes | None = None
    """SHA256SUMS.sig, not checked here; or None."""

    @property
    def golden(self) -> Golden:
        """Golden vectors; raises `BundleError` for a policy record."""
        if self.vectors is None:
            raise BundleError(_missing(self.name, GOLDEN))
        return self.vectors


Vouch = Callable[[bytes, bytes | None], None]
"""Function of SHA256SUMS and its signature, or None; raises `StictionError` for untrusted ones."""


def reread_bundle(path: Path | str, digest: str) -> Bundle:
    """Return a bundle that another process has checked; raise `BundleError` where its digest has changed since."""

    def compare(sums: bytes, signature: bytes | None) -> None:
        if (current := _sha256(sums)) != digest:
            raise BundleError(
                f"{path}: got digest {current[:12]}, expected {digest[:12]}: it has changed since it was checked; "
                "start again"
            )

    return read_bundle(path, compare)


def read_bundle(path: Path | str, vouch: Vouch = lambda sums, signature: None, allow_record: bool = False) -> Bundle:
    """Read a bundle; check the set of files, sizes, checksums, contract, and the bindings of the golden vectors.

    vouch: called once SHA256SUMS was compared with every file, before any of them is interpreted. allow_record: read a
    policy record too. Raises `BundleError`: a file missing, too many, a link, too large, malformed, or different from
    SHA256SUMS or golden.npz.
    """
    folder = Path(path)
    contents = _read_files(folder, allow_record)
    sums = contents[SUMS]
    digests = {name: _sha256(contents[name]) for name in listed(contents) if name in contents}
    if GOLDEN not in contents:
        line = GOLDEN_LINE.search(sums)
        digests[GOLDEN] = line[1].decode() if line else ""
    # Compared as a whole: another order, a comment or a name that stands twice is refused too.
    if sums != _sums(digests):
        _explain_sums(folder, sums, digests)
    vouch(sums, contents.get(SIGNATURE))
    contract = read_contract(contents[CONTRACT])
    golden: Golden | None = None
    bound: dict[str, str] = {}
    if GOLDEN in contents:
        golden, bound = read_golden(contents[GOLDEN], contract)
        expected = {*BOUND_FILES, *({WEAR} & contents.keys())}
        # Before torques were recorded, wear.json was not bound.
        if bound.keys() != expected and not (golden.torque is None and bound.keys() == set(BOUND_FILES)):
            raise BundleError(
                f"{folder}: golden.npz binds {sorted(bound)}; expected {sorted(expected)}; export it again"
            )
        for name in bound:
            if bound[name] != digests[name]:
                raise BundleError(
                    f"{folder}: {name} is not the file that golden.npz was recorded with; export it again"
                )
    try:
        card = contents[CARD].decode("utf-8")
    except UnicodeDecodeError as error:
        raise BundleError(f"{folder}: {CARD} is not UTF-8 text: {error}") from error
    wear = read_wear(contents[WEAR]) if WEAR in contents else None
    if wear is not None and wear.joint_names != contract.joint_names:
        raise BundleError(f"{folder}: {WEAR} is for other joints than the contract; export it again")
    return Bundle(
        name=folder.resolve().name,
        contract=contract,
        policy=contents[POLICY],
        vectors=golden,
        card=card,
        digest=_sha256(sums),
        size=sum(map(len, contents.values())),
        wear=wear,
        wear_bound=WEAR in bound,
        sums=sums,
        signature=contents.get(SIGNATURE),
    )


def listed(names: Collection[str]) -> tuple[str, ...]:
    """Return the files that SHA256SUMS lists, in its order, for a bundle with the files `names`."""
    return (*FILES, WEAR) if WEAR in names else FILES


def write_bundle(
    path: Path | str, contract: Contract, policy: bytes, golden: Golden, card: str, wear: WearModel | None = None
) -> Path:
    """Write a bundle to a new directory, atomically; return its path.

    Raises `BundleError`: the directory exists already.
    """
    folder = Path(path)
    if folder.exists():
        raise BundleError(f"{folder} exists already; choose another --out or remove it")
    contents = {POLICY: policy, CONTRACT: contract.to_json().encode(), CARD: card.encode()}
    if wear is not None:
        contents[WEAR] = wear.to_json().encode()
    contents[GOLDEN] = write_golden(golden, {name: _sha256(data) for name, data in contents.items()})
    contents[SUMS] = _sums({name: _sha256(data) for name, data in contents.items()})
    with publish(folder) as partial:
        partial.mkdir()
        for name, data in contents.items():
            (partial / name).write_bytes(data)
    return folder


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _sums(digests: dict[str, str]) -> bytes:
    return "".join(f"{digests[name]}  {name}\n" for name in listed(digests)).encode()


def _missing(folder: Path | str, name: str) -> str:
    if name == GOLDEN:
        return (
            f"{folder}: {GOLDEN} is missing: nothing proves that the network computes as recorded; export it again "
            "(without it a policy walks in evaluate and view alone)"
        )
    return f"{folder}: {name} is missing; a policy bundle has {', '.join((*FILES, SUMS))}"


def _read_files(folder: Path, allow_record: bool) -> dict[str, bytes]:
    """Read the five files, wear.json and signature if present, and only plain files of a bounded size.

    allow_record: golden.npz may be missing.
    """
    if not folder.is_dir():
        what = "is not a directory" if folder.exists() else "does not exist"
        raise BundleError(f"{folder} {what}; expected a policy bundle, a directory with {', '.join((*FILES, SUMS))}")
    try:
        # The status of what lies there itself: a link is seen as one, and not followed.
        entries = {entry.name: entry.lstat() for entry in folder.iterdir()}
    except OSError as error:
        raise BundleError(f"{folder}: cannot be listed: {error.strerror}") from error
    if not entries.keys() & {*FILES, SUMS}:
        inside = folder / "bundle"
        raise BundleError(
            f"{folder} is not a policy bundle: it has none of {', '.join((*FILES, SUMS))}; "
            + (f"did you mean {inside}?" if inside.is_dir() else "name the directory of one")
        )
    for name in (*FILES, SUMS):
        if name not in entries and not (name == GOLDEN and allow_record):
            raise BundleError(_missing(folder, name))
    if extra := sorted(entries.keys() - {*FILES, SUMS, WEAR, SIGNATURE}):
        raise BundleError(f"{folder}: {extra[0]} does not belong into a policy bundle; remove it or export again")
    for name, status in entries.items():
        if not stat.S_ISREG(status.st_mode):
            raise BundleError(f"{folder}: {name} is not a plain file; links and directories are refused")
        if name == SIGNATURE and status.st_size != SIGNATURE_SIZE:
            raise BundleError(
                f"{folder}: {name} has {status.st_size} bytes, a signature {SIGNATURE_SIZE}; sign it again"
            )
        if status.st_size > MAX_BYTES[name]:
            raise BundleError(f"{folder}: {name} has {status.st_size} bytes; at most {MAX_BYTES[name]} are read")
    # Bounded once more: a file may have grown meanwhile.
    return {name: read_bounded(folder / name, "what export wrote", BundleError, MAX_BYTES[name]) for name in entries}


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


def shipped_folder() -> Path:
    """Return the package's folder of bundles, which may be missing."""
    return Path(str(resources.files("stiction").joinpath("policies")))


def shipped_bundles() -> dict[str, Path]:
    """Return name -> directory of every shipped bundle, in alphabetical order; empty without any."""
    folder = shipped_folder()
    if not folder.is_dir():
        return {}
    return {entry.name: entry for entry in sorted(folder.iterdir()) if (entry / CONTRACT).is_file()}


def find_bundle(name: Path) -> Path:
    """Return the directory of `name`: a path, that of a run with its bundle in it, or the name of a shipped bundle.

    Raises `BundleError` for a name without folders that is none of these and, with the command that makes the bundle,
    for a run that was not exported and a bare network.
    """
    if name.suffix == ".onnx" and name.is_file():
        made = shlex.quote(name.stem)
        raise BundleError(
            f"{name}: got a bare network, expected the directory of a bundle; do: stiction import "
            f"{shlex.quote(str(name))} --robot ROBOT --out {made}, then give {made}"
        )
    if (name / "config.json").is_file() and not (name / CONTRACT).exists():
        if (name / "bundle" / CONTRACT).is_file():
            return name / "bundle"
        raise BundleError(
            f"{name}: got a training run that was not exported, expected a bundle; do: stiction export "
            f"{shlex.quote(str(name))}"
        )
    if name.suffix == ".onnx" and not name.exists():
        raise BundleError(f"{name}: got no such file, expected the directory of a bundle, or a network in ONNX")
    if name.exists() or len(name.parts) > 1:
        return name
    shipped = shipped_bundles()
    if str(name) not in shipped:
        raise BundleError(f"{unknown_name('policy', str(name), shipped)}; or give the directory of a bundle")
    return shipped[str(name)]
