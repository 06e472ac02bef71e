"""The policy on a machine: joints by name, times, refusals, and nothing that a caller could corrupt."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bundles import make_bundle, make_contract, make_network
from stiction.core.errors import BundleError, PolicyError, RobotError
from stiction.deploy.observation import Sensors
from stiction.deploy.plausibility import ImplausibleError
from stiction.deploy.policy import load_policy
from stiction.deploy.robot_policy import RobotPolicy, load_robot_policy
from stiction.files.bundle import read_bundle, shipped_bundles
from stiction.files.contract import Contract
from stiction.files.observation import proprioception
from stiction.robots.catalog import find_robot

onnx = pytest.importorskip("onnx", reason="the package onnx, of the extra 'train', is needed to make test networks")


def robot_policy(contract: Contract, joint_names: tuple[str, ...] | None = None, model: bytes | None = None, **limits
                 ) -> RobotPolicy:  # fmt: skip
    """Return a policy of a random network."""
    policy = load_policy(contract, make_network(contract) if model is None else model)
    return RobotPolicy(contract, policy, joint_names, limits)


def reading(contract: Contract, seed: int = 0) -> dict[str, Any]:
    """Return noisy readings of a standing robot, in the contract's order, and a command."""
    draw = np.random.default_rng(seed).standard_normal
    return {
        "quaternion": np.array([1.0, 0.0, 0.0, 0.0]),
        "angular_velocity": 0.01 * draw(3),
        "joint_position": contract.array("standing") + 0.01 * draw(contract.num_joints),
        "joint_velocity": 0.1 * draw(contract.num_joints),
        "command": np.array([0.3, 0.0, 0.0]),
    }


def by_name(contract: Contract, sensed: dict[str, Any]) -> dict[str, Any]:
    """Return a reading whose joints are mappings, in an order of no meaning."""
    names = sorted(contract.joint_names)
    place = {name: number for number, name in enumerate(contract.joint_names)}
    joints = {
        key: {name: float(sensed[key][place[name]]) for name in names} for key in ("joint_position", "joint_velocity")
    }
    return sensed | joints


def test_joints_come_by_name_in_any_order(contract: Contract) -> None:
    """Joints are matched by name, whatever their order in the library."""
    names = tuple(reversed(contract.joint_names))
    sensed = reading(contract)
    turned = sensed | {key: sensed[key][::-1] for key in ("joint_position", "joint_velocity")}
    plain = load_policy(contract, make_network(contract))
    command = sensed["command"]
    sensors = Sensors(*(sensed[key] for key in ("quaternion", "angular_velocity", "joint_position", "joint_velocity")))
    expected = plain.step(sensors, command).target
    listed = robot_policy(contract, names).step(0.0, **turned)
    named = robot_policy(contract).step(0.0, **by_name(contract, sensed))
    np.testing.assert_array_equal(listed.target, expected[::-1])
    assert named.targets() == listed.targets() == dict(zip(contract.joint_names, expected.tolist(), strict=True))


def test_joints_that_are_not_the_robots_are_named(contract: Contract) -> None:
    """Rejects a joint name that is misspelt, missing, repeated or unknown, in the order or in a reading."""
    names = list(contract.joint_names)
    wrong = {
        "did you mean 'FL_shank'": [*names[:2], "FL_shanc", *names[3:]],
        "'RR_shank' is missing": names[:-1],
        "twice, expected each once": [*names, names[0]],
    }
    sensed = reading(contract)
    for message, order in wrong.items():
        with pytest.raises(RobotError, match=message):
            robot_policy(contract, tuple(order))
        if message != "twice, expected each once":
            mapping = dict.fromkeys(order, 0.0)
            with pytest.raises(RobotError, match=message):
                robot_policy(contract).step(0.0, **sensed | {"joint_position": mapping})
    extra = by_name(contract, sensed)["joint_position"] | {"tail": 0.0}
    with pytest.raises(RobotError, match="unknown joint 'tail'"):
        robot_policy(contract).step(0.0, **sensed | {"joint_position": extra})
    with pytest.raises(PolicyError, match="without names"):
        robot_policy(contract).step(0.0, **sensed)
    with pytest.raises(PolicyError, match="expected one number for each"):
        robot_policy(contract, tuple(names)).step(0.0, **sensed | {"joint_position": sensed["joint_position"][:-1]})


def test_joints_that_are_held_may_be_in_the_order() -> None:
    """A G1 reports 29 joints; its policy moves 12, and the rest are held."""
    robot = find_robot("g1")
    assert robot.vendor is not None
    contract = make_contract("g1", anatomy=robot)
    sensed, order = reading(contract), robot.vendor.order
    place = {name: number for number, name in enumerate(contract.joint_names)}
    wide = {key: np.array([sensed[key][place[n]] if n in place else 0.5 for n in order])
            for key in ("joint_position", "joint_velocity")}  # fmt: skip
    targets = robot_policy(contract, order).step(0.0, **sensed | wide).targets()
    assert len(targets) == 29 and targets["left_elbow_joint"] == 1.28


@pytest.mark.parametrize("batch", [(), (2,)])
def test_a_zero_quaternion_is_not_level(contract: Contract, batch: tuple[int, ...]) -> None:
    """Rejects a quaternion of zeros, as a robot without an IMU sends it."""
    policy = load_policy(contract, make_network(contract), batch)
    standing = np.broadcast_to(contract.array("standing"), (*batch, 18))
    for quaternion in (np.zeros((*batch, 4)), np.full((*batch, 4), 0.7)):
        sensors = Sensors(quaternion, np.zeros((*batch, 3)), standing, np.zeros((*batch, 18)))
        with pytest.raises(PolicyError, match="has the length"):
            policy.step(sensors, np.zeros((*batch, 3)))


def test_what_is_refused_does_not_enter_the_policy(contract: Contract) -> None:
    """A rejected reading does not enter the history."""
    hit, spared = (robot_policy(contract, contract.joint_names) for _ in range(2))
    for policy in (hit, spared):
        policy.step(0.0, **reading(contract))
    bad = reading(contract, 1) | {"command": np.array([1e9, 0, 0])}
    with pytest.raises(ImplausibleError, match=r"command: 1e\+09 m/s forward, allowed 0\.8") as caught:
        hit.step(0.02, **bad)
    assert caught.value.violation.rule == "command"
    degrees = reading(contract, 2)
    degrees["joint_position"] = np.degrees(degrees["joint_position"])
    with pytest.raises(ImplausibleError, match="are angles in radians"):
        hit.step(0.03, **degrees)
    after = [policy.step(0.04, **reading(contract, 3)).policy.observation for policy in (hit, spared)]
    np.testing.assert_array_equal(*after)


def test_a_loop_at_another_rate_is_refused(contract: Contract) -> None:
    """At 500 Hz eleven frames are 22 ms in place of 0.22 s; a few missed ticks are none of this."""

    def steps(periods: list[float]) -> int:
        policy, time = robot_policy(contract, contract.joint_names), 0.0
        for count, period in enumerate(periods):
            time += period
            try:
                policy.step(time, **reading(contract, count))
            except ImplausibleError as error:
                assert error.violation.rule == "control period"
                return count
        return len(periods)

    assert steps([0.02] * 40) == 40
    assert steps([0.02, 0.02, 0.04, 0.02, 0.02, 0.02, 0.04, 0.02, 0.02] * 4) == 36
    assert steps([0.002] * 40) < 10
    assert steps([0.04] * 40) < 12


def test_after_a_reset_the_first_reading_counts_as_one(contract: Contract) -> None:
    """A reset forgets the clock and the readings before it."""
    policy = robot_policy(contract, contract.joint_names)
    first = policy.step(5.0, **reading(contract)).policy.observation
    policy.step(5.02, **reading(contract, 1))
    with pytest.raises(ImplausibleError, match="time jump"):
        policy.step(99.0, **reading(contract, 2))
    policy.reset()
    np.testing.assert_array_equal(policy.step(0.0, **reading(contract)).policy.observation, first)


def test_shapes_are_one_robots(contract: Contract) -> None:
    """Rejects a command of one number for three."""
    policy = robot_policy(contract, contract.joint_names)
    with pytest.raises(PolicyError, match="forward, sideways, turn"):
        policy.step(0.0, **reading(contract) | {"command": np.array([0.3])})
    with pytest.raises(PolicyError, match="expected those of one robot"):
        policy.step(0.0, **reading(contract) | {"quaternion": np.array([1.0, 0, 0])})


def test_a_policy_that_nobody_tells_its_friction_does_not_start() -> None:
    """Rejects a policy without the friction that it observes, before the first step."""
    contract = make_contract(observation=proprioception(18, known_kinds=3))
    with pytest.raises(PolicyError, match="observes the friction"):
        robot_policy(contract)


def test_a_directory_is_checked_before_it_runs(tmp_path: Path, contract: Contract) -> None:
    """A bundle passes `verify` and the owner's list before it runs."""
    path = make_bundle(tmp_path / "toy", contract)
    digest = read_bundle(path).digest
    policy = load_robot_policy(path, contract.joint_names, allowed=frozenset({digest}))
    assert policy.step(0.0, **reading(contract)).target.shape == (18,)
    with pytest.raises(BundleError, match="not among the 1 that are allowed"):
        load_robot_policy(path, allowed=frozenset({"0" * 64}))
    (path / "card.md").write_text("other")
    with pytest.raises(BundleError, match=r"card\.md"):
        load_robot_policy(path)


def test_a_shipped_policy_walks_through_it() -> None:
    """The safe step computes what the fast one does, on every recorded step."""
    bundle = read_bundle(shipped_bundles()["saturn_lite-flat-direct-0.2"])
    golden, policy = bundle.golden, load_robot_policy(bundle, bundle.contract.joint_names)
    assert policy.note is None
    names, worst = ("quaternion", "angular_velocity", "joint_position", "joint_velocity", "command"), 0.0
    for t in range(100):
        sensed = {name: getattr(golden, name)[t] for name in names}
        step = policy.step(float(golden.time[t]), **sensed, now=float(golden.time[t]) + 0.001)
        worst = max(worst, float(np.abs(step.target - golden.target[t]).max()))
    assert worst < 1e-4
