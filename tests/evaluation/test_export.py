"""Export: the network is unchanged by ONNX, the contract describes the training, and no private data leaves."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bundles import make_contract
from stiction.core.errors import BundleError, StictionError
from stiction.deploy.check import BundleCheck
from stiction.deploy.policy import Network
from stiction.evaluation.export import (
    contract_of,
    export_network,
    export_policy,
    export_run,
    with_bench,
    write_card,
)
from stiction.files.contract import Contract, read_contract
from stiction.files.contract_rules import COMMAND_CORRECTION
from stiction.files.contract_training import RISE
from stiction.files.joints import Estimate, JointRecord, JointsFile
from stiction.joints.friction import Law
from stiction.learning.config import StudentCfg, TrainCfg
from stiction.robots.catalog import find_robot
from stiction.task.config import CommandCfg, TaskCfg
from stiction.task.friction import FrictionCfg
from stiction.task.terrain import TerrainCfg

torch = pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to export")
pytest.importorskip("rsl_rl", reason="the package rsl_rl, of the extra 'train', is needed to export")

from stiction.learning.run import RunDirectory, save_checkpoint  # noqa: E402

HEADER = {
    "command": "/home/somebody/.venv/bin/stiction train --seed 3 --out /tmp/a",
    "revision": "abc1234",
    "identified": None,
}


def make_module(contract: Contract):
    """Return a small student-like network."""
    torch.manual_seed(0)
    layers = torch.nn.Linear(contract.observation.size, 8), torch.nn.ELU(), torch.nn.Linear(8, contract.num_joints)
    return torch.nn.Sequential(*layers)


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> BundleCheck:
    """The bundle of the small network, with the contract that all tests have, and its check; nobody alters it."""
    contract = make_contract()
    return export_policy(make_module(contract), contract, tmp_path_factory.mktemp("exported") / "toy")


def test_onnxruntime_computes_what_torch_does_for_any_batch(contract: Contract, exported: BundleCheck) -> None:
    """The exported network computes torch's actions for any batch size."""
    module = make_module(contract)
    network = Network(exported.bundle.policy, contract.observation.size, 18)
    for batch in (1, 3):
        observation = np.random.default_rng(batch).standard_normal((batch, 715)).astype(np.float32)
        expected = module(torch.from_numpy(observation)).detach().numpy()
        np.testing.assert_allclose(network(observation), expected, atol=1e-5)


def test_an_exported_bundle_passes_its_check(tmp_path: Path, contract: Contract, exported: BundleCheck) -> None:
    """Export ends with the check that a user runs."""
    assert exported.steps >= 500
    assert exported.bundle.contract == contract
    assert exported.bundle.card == write_card(contract)
    (tmp_path / "toy").mkdir()
    with pytest.raises(BundleError, match="exists already"):
        export_policy(make_module(contract), contract, tmp_path / "toy")


def test_an_export_that_fails_leaves_no_folder(tmp_path: Path, contract: Contract) -> None:
    """A bundle with an unsupported operator fails its check and leaves no folder; the same command can be repeated."""
    module = torch.nn.Sequential(make_module(contract), torch.nn.Softmax(dim=-1))
    with pytest.raises(BundleError, match="operator 'Softmax'"):
        export_policy(module, contract, tmp_path / "toy")
    assert not any(tmp_path.iterdir())


def test_the_contract_of_a_run_says_what_was_trained() -> None:
    """`deception` at 20 % draws from 0 to 24 % of the torque limit."""
    task = TaskCfg(friction=FrictionCfg(method="deception", level=0.2))
    identified = {"file": "joints.json", "sha256": "0" * 64, "values": {"frictionloss": [0.9] * 18}}
    contract = contract_of(TrainCfg(task=task, seed=3), HEADER | {"identified": identified})
    assert contract.friction_level == 0.2
    assert contract.friction_range == pytest.approx((0.0, 0.24))
    assert (contract.method, contract.seed, contract.control_period) == ("deception", 3, 0.02)
    assert contract.command == "stiction train --seed 3 --out a"
    assert contract.revision == "abc1234"
    assert contract.joints_file == {"name": "joints.json", "sha256": "0" * 64}
    assert replace(contract, joints_file=None, friction_range=(0.0, 0.24)) == make_contract(
        method="deception",
        seed=3,
        phases=2,
        revision="abc1234",
        command="stiction train --seed 3 --out a",
        action_clip=5.0,
        anatomy=find_robot("saturn_lite"),
        command_range={"forward": (-0.8, 0.8), "sideways": (-0.3, 0.3), "turn": (-0.6, 0.6)},
        settings={"task.friction.level": 0.2},
        target_limits={"slew": 40.0, "margin": 0.02},
        command_correction=COMMAND_CORRECTION,
    )


def test_the_trained_commands_are_those_of_the_courses_too() -> None:
    """The command range contains the commands on courses, and standing."""
    task = TaskCfg(
        terrain=TerrainCfg("stairs", speed=(0.3, 1.1)), commands=CommandCfg((0.2, 0.8), (0.1, 0.3), (-0.1, 0.1))
    )
    command_range = contract_of(TrainCfg(task=task), HEADER).command_range
    assert command_range == {"forward": (0.0, 1.1), "sideways": (0.0, 0.3), "turn": (-0.6, 0.6)}
    flat = replace(task, terrain=TerrainCfg(), commands=replace(task.commands, standing_share=0.0))
    command_range = contract_of(TrainCfg(task=flat), HEADER).command_range
    assert command_range == {"forward": (0.2, 0.8), "sideways": (0.1, 0.3), "turn": (-0.1, 0.1)}


def test_a_coefficient_is_exported_as_one() -> None:
    """A coefficient is no share of the torque limit in contract and card; Stribeck friction keeps its shape."""
    friction = FrictionCfg("direct", 0.05, "load")
    contract = contract_of(TrainCfg(task=TaskCfg(friction=friction)), HEADER)
    assert (contract.friction_law, contract.friction_level, contract.friction) == ("load", 0.05, (0.05,) * 18)
    assert contract.friction_range == pytest.approx((0.04, 0.06)) and contract.stribeck is None
    card = write_card(contract)
    assert card.startswith("# saturn_lite, flat, direct, load c = 0.05\n") and "%" not in card
    assert "| nominal dry friction | c = 0.05 |" in card and "| 0.04 to 0.06 |" in card
    shaped = replace(friction, law="stribeck", level=0.1, static_ratio=2.0)
    contract = contract_of(TrainCfg(task=TaskCfg(friction=shaped)), HEADER)
    assert contract.stribeck == (2.0, 0.1) and contract.friction[0] == pytest.approx(2.5)
    assert "| nominal dry friction | 10 % of each joint's torque limit |" in write_card(contract)
    assert "0.08 to 0.12 of the torque limit; at rest 2 times that |" in write_card(contract)


def test_a_rise_that_was_drawn_goes_with_the_policy() -> None:
    """The law has the middle of the range, words and settings its ends; another middle is rejected."""
    shaped = FrictionCfg(level=0.1, law="stribeck", static_ratio=(1.2, 2.0), stribeck_velocity=(0.05, 0.15))
    contract = contract_of(TrainCfg(task=TaskCfg(friction=shaped)), HEADER)
    read = read_contract(contract.to_json().encode())
    assert read.law == Law("stribeck", 1.6, 0.1) and read.rise == (1.2, 2.0)
    assert read.trained == "at 0 to 12 % friction, 1.2 to 2 times that at rest"
    assert "; at rest 1.2 to 2 times that |" in write_card(read)
    for field, value in (("stribeck", [1.5, 0.1]), ("settings", contract.settings | {RISE[0]: [2.0, 1.2]})):
        data = json.loads(contract.to_json()) | {field: value}
        with pytest.raises(BundleError, match=r"stribeck|static-ratio"):
            read_contract(json.dumps(data).encode())


TOLD = TrainCfg(task=TaskCfg(friction=FrictionCfg("deception", 0.2), known_friction=True))


def bench(folder: Path, **joints: JointRecord) -> Path:
    """Write the joints.json of a bench."""
    JointsFile(joints).write(folder / "joints.json")
    return folder / "joints.json"


def record(friction: float | None) -> JointRecord:
    """Return a record with a known friction [N m], or none."""
    return JointRecord(coulomb_friction=None if friction is None else Estimate(friction, 0.1, (0.0, 9.0)))


def test_a_policy_that_is_told_its_friction_is_exported_with_a_number(tmp_path: Path) -> None:
    """The contract has the nominal friction of training until a bench replaces it: 1 of 25 N m, 2 of 25, 9 of 45."""
    contract = contract_of(TOLD, HEADER)
    assert contract.observes_friction and contract.known_friction == pytest.approx(
        {"hip": 0.2, "thigh": 0.2, "shank": 0.2}
    )
    assert "| hip 20 %, thigh 20 %, shank 20 % of the torque limit, from the nominal friction" in write_card(contract)
    path = bench(tmp_path, hip=record(1.0), thigh=record(2.0), shank=record(9.0))
    told = with_bench(contract, path)
    assert told.known_friction == pytest.approx({"hip": 0.04, "thigh": 0.08, "shank": 0.2})
    assert told.known_friction_file is not None and told.known_friction_file["name"] == "joints.json"
    assert "hip 4 %, thigh 8 %, shank 20 % of the torque limit, from joints.json, SHA-256" in write_card(told)
    assert replace(told, known_friction=None, known_friction_file=None) == replace(contract, known_friction=None)


def test_a_bench_that_has_no_effect_is_refused(tmp_path: Path, contract: Contract) -> None:
    """Rejects a bench for a policy that observes no friction, and a file without joints of this robot."""
    path = bench(tmp_path, hip=record(1.0))
    with pytest.raises(StictionError, match=r"policy trained with --task\.known-friction"):
        with_bench(contract, path)
    with pytest.raises(StictionError, match="has joints elbow, expected FL_hip, FL_thigh, FL_shank"):
        with_bench(contract_of(TOLD, HEADER), bench(tmp_path, elbow=record(1.0)))


def test_without_a_level_the_measured_friction_is_the_nominal_one() -> None:
    """Saturn Lite: 0.25/25 at hip and thigh, 0.442/45 at the shank; an identified shank of 0.9 N m makes 0.02 there."""
    cfg = TrainCfg(task=TaskCfg(friction=FrictionCfg(level=None)))
    assert contract_of(cfg, HEADER).friction_level == pytest.approx((0.01 + 0.01 + 0.442 / 45) / 3)
    identified = {"file": "joints.json", "sha256": "0" * 64, "values": {"frictionloss": [None, None, 0.9] * 6}}
    contract = contract_of(cfg, HEADER | {"identified": identified})
    assert contract.friction_level == pytest.approx((0.01 + 0.01 + 0.02) / 3)
    assert contract.friction == pytest.approx((0.25, 0.25, 0.9) * 6)


def test_the_contract_has_the_joints_of_training() -> None:
    """Identified values replace the robot's own, null keeps them; the level overrides dry friction."""
    spec = find_robot("saturn_lite")
    values = {"armature": [0.02, None, None] * 6, "damping": [None, 0.3, None] * 6, "frictionloss": [0.9] * 18}
    identified = {"file": "joints.json", "sha256": "0" * 64, "values": values}
    cfg = TrainCfg(task=TaskCfg(friction=FrictionCfg(level=0.1)))
    contract = contract_of(cfg, HEADER | {"identified": identified})
    assert contract.armature == (0.02, spec.kind("thigh").armature, spec.kind("shank").armature) * 6
    assert contract.damping == (spec.kind("hip").damping, 0.3, spec.kind("shank").damping) * 6
    assert contract.friction == pytest.approx((2.5, 2.5, 4.5) * 6)


def test_the_golden_vectors_are_those_of_torch(contract: Contract, exported: BundleCheck) -> None:
    """The bundle's network is replayed against the torch module; a tampered export fails."""
    golden = exported.bundle.golden
    actions = make_module(contract)(torch.from_numpy(golden.observation)).detach().clamp(-4.0, 4.0).numpy()
    np.testing.assert_allclose(golden.action, actions, atol=1e-6)


def test_an_export_that_changes_the_network_is_refused(
    contract: Contract, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rejects an export whose actions are off by a thousandth."""
    module = make_module(contract)
    other = make_module(contract)
    with torch.no_grad():
        other[2].bias += 1e-3
    network = export_network(other, contract.observation.size)
    monkeypatch.setattr("stiction.evaluation.export.export_network", lambda *_: network)
    with pytest.raises(BundleError, match="replay differs"):
        export_policy(module, contract, tmp_path / "toy")


@pytest.mark.parametrize(("iteration", "summary"), [(None, False), (50, False), (50, True), (80, False)])
def test_a_run_that_is_not_finished_is_refused(tmp_path: Path, iteration: int | None, summary: bool) -> None:
    """Rejects a run without summary.json."""
    cfg = TrainCfg(student=StudentCfg(iterations=80))
    run = RunDirectory.create(tmp_path / "run", cfg, "stiction train", None)
    if iteration is not None:
        save_checkpoint(run.checkpoints / f"student_{iteration:06d}.safetensors", {"iteration": iteration})
    if summary:
        (run.path / "summary.json").write_text("{}")
    with pytest.raises(StictionError, match=f"stiction train --resume {run.path}|finish the run again"):
        export_run(run.path, tmp_path / "bundle")
