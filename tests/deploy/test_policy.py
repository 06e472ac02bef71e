"""The network and the policy around it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bundles import linear_network, make_contract, make_network
from stiction.core.errors import BundleError, PolicyError, StictionError
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import Network, load_policy
from stiction.files.contract import Contract
from stiction.files.contract_rules import COMMAND_CORRECTION
from stiction.files.observation import proprioception

onnx = pytest.importorskip("onnx", reason="the package onnx, of the extra 'train', is needed to make test networks")


def standing_still(contract: Contract, batch: tuple[int, ...] = ()) -> Sensors:
    """Readings of robots that stand in the standing pose."""
    quaternion = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (*batch, 4))
    position = np.broadcast_to(contract.array("standing"), (*batch, contract.num_joints))
    return Sensors(quaternion, np.zeros((*batch, 3)), position, np.zeros((*batch, contract.num_joints)))


def test_targets_by_hand(contract: Contract) -> None:
    """The target is standing + scale * clip(action); the newest command alone drives this network."""
    weights = np.zeros((contract.observation.size, 18), np.float32)
    newest_command = 10 * contract.observation.frame_size + 6
    weights[newest_command, 0], weights[newest_command, 1] = 2.0, -100.0
    policy = load_policy(contract, linear_network(onnx, weights))
    step = policy.step(standing_still(contract), np.array([0.5, 0.0, 0.0]))
    expected = contract.array("standing").copy()
    expected[0] += 0.25 * 1.0
    expected[1] -= 0.25 * 4.0
    np.testing.assert_allclose(step.target, expected)
    assert step.action.shape == (18,)
    assert step.observation.shape == (715,)


def test_last_action_returns_clipped_and_a_reset_forgets_it(contract: Contract) -> None:
    """The observation holds the clipped action, as it was sent to the joints."""
    weights = np.zeros((contract.observation.size, 18), np.float32)
    weights[10 * contract.observation.frame_size + 6, 0] = 100.0
    policy = load_policy(contract, linear_network(onnx, weights), batch=(2,))
    sensors, command = standing_still(contract, (2,)), np.array([[0.5, 0.0, 0.0]] * 2)
    last_action = slice(contract.observation.frame_size - 19, contract.observation.frame_size - 1)
    assert policy.step(sensors, command).observation.reshape(2, 11, -1)[:, -1, last_action].max() == 0.0
    assert policy.step(sensors, command).observation.reshape(2, 11, -1)[:, -1, last_action].max() == 4.0
    policy.reset(np.array([True, False]))
    newest = policy.step(sensors, command).observation.reshape(2, 11, -1)[:, -1, last_action]
    assert newest.max(axis=1).tolist() == [0.0, 4.0]


def test_the_velocity_is_a_second_output_where_the_contract_asks_for_it(contract: Contract) -> None:
    """Rejects a network with one output too few or too many, of another name or size, or that returns NaN."""
    size, joints = contract.observation.size, contract.num_joints
    weights, two = np.zeros((size, joints), np.float32), np.ones((size, 2), np.float32)
    corrected = replace(contract, command_correction=COMMAND_CORRECTION)
    policy = load_policy(corrected, linear_network(onnx, weights, more={"velocity": two}), batch=(3,))
    step = policy.step(standing_still(contract, (3,)), np.full((3, 3), 0.1))
    assert step.velocity is not None and step.velocity.shape == (3, 2)
    np.testing.assert_allclose(step.velocity[:, 0], step.observation.sum(axis=1), rtol=1e-5)
    plain = linear_network(onnx, weights)
    assert load_policy(contract, plain).step(standing_still(contract), np.zeros(3)).velocity is None
    for asked, model, message in (
        (corrected, plain, "1 outputs; expected 2"),
        (contract, linear_network(onnx, weights, more={"velocity": two}), "2 outputs; expected 1"),
        (corrected, linear_network(onnx, weights, more={"speed": two}), "the output 'speed'"),
        (corrected, linear_network(onnx, weights, more={"velocity": two[:, :1]}), "the output 'velocity'"),
        (corrected, linear_network(onnx, weights, more={"velocity": two, "third": two}), "output"),
    ):
        with pytest.raises(BundleError, match=message):
            load_policy(asked, model)
    broken = load_policy(corrected, linear_network(onnx, weights, more={"velocity": np.inf * two}))
    with pytest.raises(PolicyError, match="not finite"):
        broken.step(standing_still(contract), np.full(3, 0.1))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"inputs": "obs"}, "input"),
        ({"batch": 1}, "input"),
        ({"weights": np.zeros((714, 18), np.float32)}, "715"),
        ({"weights": np.zeros((715, 12), np.float32)}, "18"),
    ],
)
def test_a_network_with_other_ports_is_refused(arguments: dict, message: str) -> None:
    """A network of another robot must not be run."""
    model = linear_network(onnx, **({"weights": np.zeros((715, 18), np.float32)} | arguments))
    with pytest.raises(BundleError, match=message):
        Network(model, 715, 18)


def test_a_network_with_weights_in_another_file_is_refused(tmp_path: Path) -> None:
    """The checksums do not cover what lies outside the bundle."""
    model = onnx.load_from_string(make_network(make_contract()))
    onnx.save(model, tmp_path / "policy.onnx", save_as_external_data=True, size_threshold=0)
    with pytest.raises(BundleError, match="other files"):
        Network((tmp_path / "policy.onnx").read_bytes(), 715, 18)


@pytest.mark.parametrize("name", ["quaternion", "angular_velocity", "joint_position", "joint_velocity", "command"])
def test_a_sensor_that_is_not_finite_is_named(contract: Contract, name: str) -> None:
    """A broken encoder must not be reported as a broken policy."""
    policy = load_policy(contract, make_network(contract))
    good = policy.step(standing_still(contract), np.zeros(3)).observation
    policy.reset()
    readings = {key: np.array(value, float) for key, value in standing_still(contract).arrays().items()}
    readings["command"] = np.zeros(3)
    readings[name][1] = np.nan
    command = readings.pop("command")
    with pytest.raises(PolicyError, match=name):
        policy.step(Sensors(**readings), command)
    after = policy.step(standing_still(contract), np.zeros(3)).observation
    np.testing.assert_array_equal(after, good, err_msg="what is not finite stays out of the history")


def test_a_policy_is_told_what_its_contract_says_unless_the_caller_knows_better() -> None:
    """The bench's numbers act without anyone passing them on; an evaluation passes others, one for each robot."""
    layout = proprioception(18, known_kinds=3)
    weights = np.zeros((layout.size, 18), np.float32)
    weights[-1, 0] = 1.0
    contract = make_contract(observation=layout, known_friction={"hip": 0.0, "thigh": 0.0, "shank": 0.2})
    model, still, command = linear_network(onnx, weights), standing_still(contract, (2,)), np.zeros((2, 3))
    cases = {"contract": None, "all": np.array([0.0, 0.0, 0.1]), "each": np.array([[0.0, 0.0, 0.3], [0.0, 0.0, 0.0]])}
    expected = {"contract": [1.0, 1.0], "all": [0.5, 0.5], "each": [1.5, 0.0]}
    for name, known in cases.items():
        step = load_policy(contract, model, (2,), known_friction=known).step(still, command)
        np.testing.assert_allclose(step.action[:, 0], expected[name], atol=1e-6)
    untold = load_policy(make_contract(observation=layout), model, (2,))
    with pytest.raises(StictionError, match="observes the friction of its joints"):
        untold.step(still, command)
