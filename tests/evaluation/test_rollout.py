"""Policy bundle on a fleet: the right robot, the right joints, and golden vectors that pass the check."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bundles import make_contract, make_network
from stiction.core.errors import StictionError
from stiction.deploy.check import check_bundle
from stiction.deploy.policy import PolicyStep, load_policy
from stiction.evaluation.golden import record_golden
from stiction.evaluation.rollout import Rollout, friction_at
from stiction.files.bundle import write_bundle
from stiction.files.contract import Contract, robot_of
from stiction.task.config import NoiseCfg

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

QUIET = NoiseCfg(0.0, 0.0, 0.0, 0.0)


def make_rollout(contract: Contract, levels: list[float], seeds: list[int], **options) -> Rollout:
    """Return robots driven by a nearly silent network."""
    generators = [np.random.default_rng(seed) for seed in seeds]
    policy = load_policy(contract, make_network(contract, gain=0.001), (len(levels),))
    return Rollout(contract, policy, robot_of(contract), friction_at(contract, levels), generators, **options)


@pytest.mark.parametrize("robot", ["saturn_lite", "go1"])
def test_recorded_golden_vectors_pass_the_check(tmp_path: Path, robot: str) -> None:
    """Recorded golden vectors replay one step at a time without physics."""
    contract = make_contract(robot)
    model = make_network(contract)
    golden = record_golden(contract, load_policy(contract, model, (1,)), robot_of(contract))
    check = check_bundle(write_bundle(tmp_path / robot, contract, model, golden, ""))
    assert check.steps >= 500
    assert golden.reset.sum() >= 3
    assert len(np.unique(golden.command[:, 0])) >= 10
    assert np.ptp(golden.joint_position, axis=0).min() > 0.01


def test_the_fleet_has_the_bundles_joints(contract: Contract) -> None:
    """Friction is a fraction of each joint's own torque limit, gains come from the contract."""
    changed = make_contract("saturn_lite@kp=0.16")  # kp 16 and, by the root of it, kd 1
    fleet = make_rollout(changed, [0.0, 0.2], [0]).fleet
    np.testing.assert_allclose(fleet.friction, [[0.0] * 18, list(0.2 * contract.array("torque_limit"))])
    fleet.step()
    fleet.set_targets(fleet.joint_position + 0.01)
    before = fleet.joint_position.copy(), fleet.joint_velocity.copy()
    fleet.simulation.step(1)
    expected = 16.0 * (fleet.targets - before[0]) - 1.0 * before[1]
    np.testing.assert_allclose(fleet.torque, expected, atol=1e-6)


def test_the_fleet_has_the_contracts_inertia_and_viscous_friction() -> None:
    """Inertia and viscous friction are the contract's, not the robot's: a run may train on identified joints."""
    fleet = make_rollout(make_contract(armature=(0.05,) * 18, damping=(0.7,) * 18), [0.0, 0.2], [0]).fleet
    assert (fleet.armature == 0.05).all()
    assert (fleet.damping == 0.7).all()
    assert fleet.stale_constants(1) < 1e-9


def test_a_delayed_target_arrives_late(contract: Contract) -> None:
    """A delay of 10 ms shifts the target by two physics steps of 5 ms; 40 ms is the longest."""
    late = make_rollout(contract, [0.0], [0], action_delay=0.010).fleet
    late.reset(np.array([0]))
    late.set_targets(late.standing + 0.3)
    torques = []
    for _ in range(3):
        late.simulation.step(1)
        torques.append(np.abs(late.torque).max())
    assert max(torques[:2]) < 5.0 < torques[2]
    make_rollout(contract, [0.0], [0], action_delay=0.04)
    with pytest.raises(StictionError, match=r"0 to 0\.04 s"):
        make_rollout(contract, [0.0], [0], action_delay=0.041)


def test_a_bundle_cannot_name_a_module_to_import() -> None:
    """A bundle is data: a name in it is not imported."""
    with pytest.raises(StictionError, match="--robot"):
        robot_of(replace(make_contract(), robot="os.path:sep"))


def test_another_robot_is_refused(contract: Contract) -> None:
    """Rejects Saturn Lite's policy on a Go1, and on other motors."""
    with pytest.raises(StictionError, match="joints"):
        robot_of(contract, "go1")
    with pytest.raises(StictionError, match="torque limits"):
        robot_of(make_contract(torque_limit=(30.0,) * 18))


def test_targets_that_are_limited_on_the_robot_are_limited_in_its_evaluation(contract: Contract) -> None:
    """20 ms at 1 rad/s from the standing pose are 0.02 rad, for every robot of a batch."""
    limited = replace(contract, target_limits={"slew": 1.0, "margin": 0.02})
    for each, moved in ((limited, 0.02), (contract, 0.5)):
        rollout = make_rollout(each, [0.0, 0.0], [0], noise=QUIET)
        policy = rollout.loop._policy
        asked = each.array("standing") + 0.5
        policy.step = lambda *_, far=asked: PolicyStep(np.zeros(0), np.zeros(0), np.tile(far, (2, 1)))  # type: ignore[method-assign]
        step = rollout.step(np.zeros((2, 3)))
        np.testing.assert_allclose(step.policy.target, np.tile(each.array("standing") + moved, (2, 1)), atol=1e-12)
        assert np.abs(rollout.fleet.targets - each.array("standing")).max() < moved + 1e-9
