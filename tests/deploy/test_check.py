"""`check_bundle` accepts what was exported and rejects what was altered, repaired checksums or not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bundles import make_bundle, make_contract, make_golden, make_network, make_wear, repair_sums
from stiction.core.errors import BundleError, FileError, StictionError
from stiction.deploy.check import TOLERANCE, check_bundle, check_for_simulation, read_allowed, record_notes
from stiction.files.bundle import read_bundle, write_bundle
from stiction.files.contract import Contract, robot_of


@pytest.mark.parametrize("robot", ["saturn_lite", "go1"])
def test_a_good_bundle_passes(tmp_path: Path, robot: str) -> None:
    """Six legs and four, on the machine that recorded the vectors."""
    check = check_bundle(make_bundle(tmp_path / robot, make_contract(robot)))
    assert check.steps == 500
    assert max(check.observation_error, check.action_error, check.target_error) <= TOLERANCE
    assert check.summary()["ok"] is True


def test_the_replay_alone_sees_another_policy(tmp_path: Path, contract: Contract) -> None:
    """Even where every digest was made anew, golden vectors of one policy do not fit another."""
    golden = make_golden(contract, make_network(contract))
    forged = write_bundle(tmp_path / "forged", contract, make_network(contract, seed=1), golden, "")
    read_bundle(forged)
    with pytest.raises(BundleError, match="differs"):
        check_bundle(forged)


def test_a_bundle_without_golden_vectors_walks_in_simulation_alone(bundle: Path) -> None:
    """Keeps the digest of the whole bundle, warns by name, and is refused wherever a replay is the proof."""
    whole = check_for_simulation(bundle)
    (bundle / "golden.npz").unlink()
    record = check_for_simulation(bundle)
    assert (record.digest, record.contract, record.policy) == (whole.digest, whole.contract, whole.policy)
    assert record_notes([whole]) == [] and bundle.name in record_notes([whole, record])[0]
    for read in (check_bundle, read_bundle, lambda path: record.golden):
        with pytest.raises(BundleError, match=r"golden\.npz is missing") as refused:
            read(bundle)
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", ["policy.onnx", "contract.json", "golden.npz"])
def test_a_record_that_was_altered_is_refused(bundle: Path, contract: Contract, name: str) -> None:
    """Holds network and contract to SHA256SUMS, which still has to list the golden vectors."""
    (bundle / "golden.npz").unlink()
    sums = bundle / "SHA256SUMS"
    if name == "golden.npz":
        sums.write_text("".join(line for line in sums.read_text().splitlines(True) if name not in line))
    else:
        (bundle / name).write_bytes((bundle / name).read_bytes() + b"\n")
    with pytest.raises(BundleError, match=f"{name} does not match SHA256SUMS"):
        check_for_simulation(bundle)


SEEN = ("command", "quaternion", "angular_velocity", "joint_position", "joint_velocity", "observation", "action")


@pytest.mark.parametrize("name", (*SEEN, "target"))
def test_a_number_of_the_recording_that_was_changed_is_rejected(name: str, tmp_path: Path, contract: Contract) -> None:
    """Damage that leaves a file of the right form, with every digest made anew, is left to the replay."""
    model = make_network(contract)
    golden = replace(make_golden(contract, model), torque=None)
    getattr(golden, name)[250, 0] += 0.01
    with pytest.raises(BundleError, match=r"differs|unit length"):
        check_bundle(write_bundle(tmp_path / "forged", contract, model, golden, ""))


@pytest.mark.parametrize("share", [0.8, 1.2])
def test_rounding_of_large_numbers_is_no_damage(share: float, tmp_path: Path, contract: Contract) -> None:
    """A network has seven digits: what is off by more than the tolerance, as a share of the largest, is damage."""
    model = make_network(contract)
    golden = replace(make_golden(contract, model), torque=None)
    largest = np.abs(golden.target).max()
    assert largest > 1.5
    golden.target[250, 0] += share * TOLERANCE * largest
    folder = write_bundle(tmp_path / "rounded", contract, model, golden, "")
    if share < 1.0:
        assert check_bundle(folder).target_error > TOLERANCE
    else:
        with pytest.raises(BundleError, match="differs"):
            check_bundle(folder)


@pytest.mark.parametrize(
    ("robot", "message"),
    [("go1@kp=0.5", "other gains kp"), ("go1@torque=2", "other torque limits"), ("saturn_lite", "has other joints")],
)
def test_a_robot_with_other_motors_is_none_to_walk_on(robot: str, message: str) -> None:
    """A policy learned to walk with its gains and limits; on others it says nothing of itself."""
    with pytest.raises(StictionError, match=message):
        robot_of(make_contract("go1"), robot)
    assert robot_of(make_contract(robot), robot).name == robot


def test_a_list_says_which_bundles_may_run(bundle: Path, tmp_path: Path) -> None:
    """A robot's owner keeps it; a digest that was cut off, or a list of something else, may not allow anything."""
    digest, path = read_bundle(bundle).digest, tmp_path / "allowed.txt"
    path.write_text(f"# robots of the lab\n{'1' * 64}\n\n{digest.upper()}  # toy, seed 0\n")
    allowed = read_allowed(path)
    assert allowed == {"1" * 64, digest} and check_bundle(bundle, allowed=allowed).steps == 500
    path.write_text("# none\n")
    with pytest.raises(BundleError, match=f"its digest {digest} is not among the 0 that are allowed"):
        check_bundle(bundle, allowed=read_allowed(path))
    for content in (digest[:63].encode(), b"toy " + digest.encode(), b"\xff" * 64, b"PK\x03\x04"):
        path.write_bytes(b"# list\n" + content)
        with pytest.raises(FileError, match=r"line 2: .* expected 64 hexadecimal digits"):
            read_allowed(path)
    path.write_bytes(b"#" * (2**20 + 1))
    with pytest.raises(FileError, match="over 1048576 bytes"):
        read_allowed(path)
    with pytest.raises(FileError, match="cannot read"):
        read_allowed(tmp_path)


def test_what_is_not_allowed_is_not_opened(bundle: Path) -> None:
    """A network of a stranger is refused by its digest, before any byte of it is interpreted."""
    (bundle / "contract.json").write_text("{")
    repair_sums(bundle)
    with pytest.raises(BundleError, match="that are allowed"):
        check_bundle(bundle, allowed=frozenset())


def test_a_map_that_nothing_binds_passes_in_an_older_bundle_alone(tmp_path: Path, contract: Contract) -> None:
    """A map without a check passes only in an older bundle, and `verify` says so."""
    model, wear = make_network(contract), make_wear(contract)
    whole = check_bundle(write_bundle(tmp_path / "new", contract, model, make_golden(contract, model), "", wear))
    assert whole.bundle.wear_bound
    golden = replace(make_golden(contract, model), torque=None, walked=None)
    older = write_bundle(tmp_path / "old", contract, model, golden, "")
    (older / "wear.json").write_text(wear.to_json())
    repair_sums(older)
    bundle = check_bundle(older).bundle
    assert bundle.wear is not None and bundle.golden.torque is None and not bundle.wear_bound
