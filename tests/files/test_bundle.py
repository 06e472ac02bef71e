"""A bundle in which anything was added, removed or altered is refused, and the message names the file."""

import hashlib
import io
import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bundles import make_golden, make_network, repair_sums
from stiction.core.errors import BundleError
from stiction.files.bundle import FILES, SIGNATURE, SUMS, read_bundle, write_bundle
from stiction.files.contract import Contract
from stiction.files.golden import read_golden, write_golden

EVERY_FILE = (*FILES, SUMS)


def test_a_fresh_bundle_reads_back(bundle: Path, contract: Contract) -> None:
    """Otherwise nothing that is exported could be used."""
    copy = read_bundle(bundle)
    assert copy.contract == contract
    assert copy.name == "toy"
    assert copy.card == "# Toy\n"
    assert len(copy.golden) == 500
    assert copy.digest == hashlib.sha256((bundle / SUMS).read_bytes()).hexdigest()
    assert copy.size == sum((bundle / name).stat().st_size for name in EVERY_FILE)


@pytest.mark.parametrize("position", [0, 0.5, -1])
@pytest.mark.parametrize("name", EVERY_FILE)
def test_a_flipped_byte_is_refused(bundle: Path, name: str, position: float) -> None:
    """A damaged download must not reach a robot."""
    data = bytearray((bundle / name).read_bytes())
    index = position if isinstance(position, int) else int(position * len(data))
    data[index] ^= 1
    (bundle / name).write_bytes(data)
    with pytest.raises(BundleError, match=name):
        read_bundle(bundle)


@pytest.mark.parametrize("name", EVERY_FILE)
def test_a_missing_file_is_named(bundle: Path, name: str) -> None:
    """Every one of the five files is needed."""
    (bundle / name).unlink()
    with pytest.raises(BundleError, match=f"{name} is missing"):
        read_bundle(bundle)


def test_a_folder_that_is_no_bundle_is_told_apart_from_one_that_is_damaged(bundle: Path) -> None:
    """Distinguishes a folder without a bundle, such as a run's, from a damaged bundle."""
    run = bundle.parent / "run"
    run.mkdir()
    with pytest.raises(BundleError, match=r"is not a policy bundle.*name the directory of one"):
        read_bundle(run)
    bundle.rename(run / "bundle")
    with pytest.raises(BundleError, match=r"is not a policy bundle.*did you mean .*bundle\?"):
        read_bundle(run)


@pytest.mark.parametrize(
    ("put", "message"),
    [
        (lambda folder: (folder / "policy.onnx.data").write_bytes(b"weights"), r"policy\.onnx\.data"),
        (lambda folder: (folder / "extra").mkdir(), "extra"),
        (lambda folder: (folder / SIGNATURE).write_bytes(bytes(63)), SIGNATURE),
        (lambda folder: (folder / SIGNATURE).write_bytes(bytes(65)), SIGNATURE),
        # A sparse file costs nothing to make, and would fill a robot's memory.
        (lambda folder: os.truncate(folder / "policy.onnx", 65 * 2**20), "at most"),
        (lambda folder: (folder / SUMS).symlink_to((folder / SUMS).rename(folder.parent / SUMS)), "plain file"),
    ],
    ids=["file", "folder", "63 bytes", "65 bytes", "large", "link"],
)
def test_what_no_checksum_covers_is_refused(bundle: Path, put: Callable[[Path], object], message: str) -> None:
    """A file or folder too many, a signature of another size, a link to another file, one that fills the memory."""
    put(bundle)
    with pytest.raises(BundleError, match=message):
        read_bundle(bundle)


@pytest.mark.parametrize("name", ["nothing", "file"])
def test_what_is_no_directory_is_refused(tmp_path: Path, name: str) -> None:
    """A wrong path must give one clear line."""
    (tmp_path / "file").write_text("")
    with pytest.raises(BundleError, match=name):
        read_bundle(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("contract.json", {"kp": [50.0] * 18}, "the torques of 'FL_hip'"),
        ("contract.json", {"seed": 7}, r"contract\.json is not the file"),
        ("card.md", None, r"card\.md is not the file"),
        ("policy.onnx", None, r"policy\.onnx is not the file"),
    ],
)
def test_a_file_changed_with_repaired_sums_is_refused(
    bundle: Path, name: str, change: dict | None, message: str
) -> None:
    """The replay sees neither gains, seed nor card; recorded torques see the gains, digests in golden.npz all."""
    content = (bundle / name).read_bytes()
    changed = content + b"\n" if change is None else json.dumps(json.loads(content) | change).encode()
    (bundle / name).write_bytes(changed)
    repair_sums(bundle)
    with pytest.raises(BundleError, match=message):
        read_bundle(bundle)


def test_an_existing_directory_is_never_overwritten(bundle: Path, contract: Contract) -> None:
    """A second export must not mix with the first, and leaves nothing half-written."""
    model = make_network(contract)
    with pytest.raises(BundleError, match="exists already"):
        write_bundle(bundle, contract, model, make_golden(contract, model), "")
    assert [entry.name for entry in bundle.parent.iterdir()] == ["toy"]


def test_pickled_golden_vectors_are_refused(tmp_path: Path, contract: Contract) -> None:
    """A pickle runs code when it is read."""
    np.savez(tmp_path / "golden.npz", time=np.array([{}], dtype=object))
    with pytest.raises(BundleError, match="not a readable NPZ file of plain arrays"):
        read_golden((tmp_path / "golden.npz").read_bytes(), contract)


def test_a_small_archive_that_unpacks_large_is_refused(tmp_path: Path, contract: Contract) -> None:
    """80 MB of zeros compress to 80 kB."""
    np.savez_compressed(tmp_path / "golden.npz", time=np.zeros(10_000_000))
    with pytest.raises(BundleError, match="would inflate to"):
        read_golden((tmp_path / "golden.npz").read_bytes(), contract)


def test_no_damage_of_golden_vectors_is_read(contract: Contract) -> None:
    """Whatever byte is damaged, it is noticed, and by the one kind of error that says so."""
    data = write_golden(make_golden(contract, make_network(contract)), {})
    for position in np.random.default_rng(0).integers(0, len(data), 60):
        damaged = bytearray(data)
        damaged[position] ^= 0xFF
        with pytest.raises(BundleError):
            read_golden(bytes(damaged), contract)


def test_no_damage_within_an_intact_archive_is_read(contract: Contract) -> None:
    """The checksums of the archive do not help where somebody packed damaged arrays on purpose."""
    golden = make_golden(contract, make_network(contract))
    generator = np.random.default_rng(0)
    with zipfile.ZipFile(io.BytesIO(write_golden(golden, {}))) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    for name, data in members.items():
        for _ in range(12):
            damaged = bytearray(data)
            for position in generator.integers(0, min(128, len(data)), 3):
                damaged[position] = generator.integers(0, 256)
            buffer = io.BytesIO()
            with zipfile.ZipFile(buffer, "w") as archive:
                for other, content in members.items():
                    archive.writestr(other, bytes(damaged) if other == name else content)
            with pytest.raises(BundleError):
                read_golden(buffer.getvalue(), contract)
