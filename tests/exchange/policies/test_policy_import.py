"""Descriptions of foreign policies, and the bundles made of them."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from foreign import JOINTS, MJLAB, ROBOT, network, written
from quads import quad
from stiction.core.errors import StictionError
from stiction.deploy.check import check_bundle
from stiction.deploy.network_file import FLOAT, NetworkFile, Node, Port
from stiction.evaluation.summary import other_limits
from stiction.exchange.policies.description import PolicySpec, contract_of, merged, missing, require
from stiction.exchange.policies.importer import import_policy
from stiction.exchange.policies.mjlab import read_mjlab
from stiction.exchange.policies.onnx_file import constant, write_network
from stiction.exchange.policies.rl_sar import read_rl_sar
from stiction.exchange.policies.settings import read_settings
from stiction.exchange.policies.unitree import read_deploy
from stiction.robots.catalog import find_robot
from stiction.robots.named import reordered

OWN = "control_period: 0.02\naction_clip: none\n"


def test_a_policy_of_mjlab_becomes_a_bundle(tmp_path: Path) -> None:
    """Scales, clips, histories and gains are the metadata's, the rest is the user's."""
    model = written(tmp_path / "theirs.onnx", network(63, metadata=MJLAB))
    settings = written(tmp_path / "own.yaml", OWN)
    check = import_policy(model, ROBOT, tmp_path / "bundle", [settings])
    contract = check_bundle(tmp_path / "bundle").bundle.contract
    terms = {term.name: term for term in contract.observation.terms}
    assert [*terms] == [
        *("angular_velocity", "projected_gravity", "joint_position", "joint_velocity", "last_action", "command")
    ]
    assert terms["angular_velocity"].clip == 10.0 and terms["command"].scale == (2.0, 2.0, 0.25)
    assert contract.observation.size == 63 and contract.observation.layout == "term_major"
    assert contract.observation.history_of(terms["projected_gravity"]) == 3
    assert (contract.kp[0], contract.kd[0], contract.standing[:3]) == (25.0, 0.6, (0.0, 0.9, -1.8))
    assert contract.decimation == 4 and contract.imported is not None and contract.imported["name"] == "theirs.onnx"
    assert (contract.method, contract.terrain) == ("imported", "unknown") and check.action_error == 0.0


def test_what_nobody_says_is_asked_for_by_name(tmp_path: Path) -> None:
    """Asks by name for a missing scale, order or period."""
    model = written(tmp_path / "theirs.onnx", network(63, metadata=MJLAB))
    with pytest.raises(StictionError, match=r"control_period: time between two actions.*action_clip: bound"):
        import_policy(model, ROBOT, tmp_path / "bundle")
    bare = read_settings({"observation": [{"term": "last_action", "history": 3}], "action_clip": 5}, "own")
    asked = {"history_layout", "history_direction", "history_fill", "last_action", "kp", "joint_names"}
    assert asked <= set(missing(bare))
    with pytest.raises(StictionError, match="before it is cut off at 5"):
        require(full(last_action="raw", action_clip=5.0), "files")


def full(**changes) -> PolicySpec:
    """Return a policy of which all is said."""
    spec = merged(read_mjlab(MJLAB, "theirs"), read_settings(yaml.safe_load(OWN), "own"))
    return merged(spec, PolicySpec(**changes))


def test_a_wrong_size_says_what_was_made_of_the_words(tmp_path: Path) -> None:
    """A term too many is the first thing that goes wrong."""
    model = written(tmp_path / "theirs.onnx", network(60, metadata=MJLAB))
    settings = written(tmp_path / "own.yaml", OWN)
    with pytest.raises(StictionError, match=r"takes 60 numbers.*makes 63 \(angular_velocity 3, projected_gravity 3 x"):
        import_policy(model, ROBOT, tmp_path / "bundle", [settings])


DEPLOY = f"""
joint_ids_map: [3, 0, 6, 9, 4, 1, 7, 10, 5, 2, 8, 11]
step_dt: 0.02
stiffness: {[float(20 + n) for n in range(12)]}
damping: {[float(n) for n in range(12)]}
default_joint_pos: [0, 0, 0, 0, 0.8, 0.8, 1.0, 1.0, -1.5, -1.5, -1.5, -1.5]
commands: {{base_velocity: {{ranges: {{lin_vel_x: [-1, 1]}}}}}}
actions:
  JointPositionAction:
    {{clip: null, joint_names: [.*], scale: {[0.25] * 12}, joint_ids: null,
     offset: [0, 0, 0, 0, 0.8, 0.8, 1.0, 1.0, -1.5, -1.5, -1.5, -1.5]}}
observations:
  base_ang_vel: {{params: {{}}, clip: [-100, 100], scale: [0.2, 0.2, 0.2], history_length: 5}}
  velocity_commands: {{params: {{command_name: base_velocity}}, clip: null, scale: [1, 1, 1], history_length: 5}}
  gait_phase: {{params: {{period: 0.8}}, clip: null, scale: [1, 1], history_length: 1}}
"""
"""Settings of unitree_rl_lab: joints side by side, gains in the maker's order, leg by leg."""


def test_a_deploy_yaml_by_hand() -> None:
    """The policy's second joint is the maker's first, whose gain is the first; its clip is before the scale."""
    spec = read_deploy(yaml.safe_load(DEPLOY), "deploy.yaml", JOINTS)
    assert spec.joint_names is not None and spec.joint_names[:2] == (JOINTS[3], JOINTS[0])
    assert spec.kp == (23, 20, 26, 29, 24, 21, 27, 30, 25, 22, 28, 31)
    assert spec.observation is not None and spec.observation[0].bound() == pytest.approx(20.0)
    assert spec.observation[0].history == 5 and spec.action_clip == math.inf
    assert spec.clock is not None and (spec.clock.period, spec.clock.first) == (0.8, 1)


@pytest.mark.parametrize("entry", ["", "joint_ids_map: []", "joint_ids_map: 3", "joint_ids_map: [0, 0]"])
def test_a_deploy_yaml_without_its_joints_is_refused(entry: str, tmp_path: Path) -> None:
    """Names the entry: missing, empty, no list, a joint twice."""
    model = written(tmp_path / "theirs.onnx", network(63))
    settings = written(tmp_path / "deploy.yaml", re.sub("joint_ids_map: .*", entry, DEPLOY))
    with pytest.raises(StictionError, match=r"deploy.yaml: joint_ids_map is .*; expected (a list|different numbers)"):
        import_policy(model, ROBOT, tmp_path / "bundle", [settings])


def test_a_policy_with_another_order_gets_the_robot_in_its_order() -> None:
    """Joints side by side in place of leg by leg: each stays on its own link, with its own limits."""
    robot = find_robot(ROBOT)
    spec = merged(full(), read_deploy(yaml.safe_load(DEPLOY), "deploy.yaml", JOINTS))
    contract = contract_of(spec, robot, ("n", b""), "r", "c")
    assert contract.joint_names[:2] == (JOINTS[3], JOINTS[0]) and contract.anatomy is not None
    for name, link in zip(contract.joint_names, contract.anatomy.links, strict=True):
        assert link.origin == robot.links[robot.joint_names.index(name)].origin
        parent = robot.links[robot.joint_names.index(name)].parent
        expected = None if parent < 0 else robot.joint_names[parent]
        assert (None if link.parent < 0 else contract.joint_names[link.parent]) == expected
    assert contract.upper == tuple(robot.joints[robot.joint_names.index(n)].upper for n in contract.joint_names)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (JOINTS[:-1], "drives .*, which the policy does not move"),
        ((*JOINTS[:-1], "tail"), "the policy moves 'tail', which robot 'go2' does not drive"),
        ((JOINTS[1], JOINTS[0], *JOINTS[2:]), "stands before"),
    ],
)
def test_a_robot_that_does_not_fit_is_refused(names: tuple[str, ...], message: str) -> None:
    """A joint too few, one that there is not, and one before the joint that carries it."""
    with pytest.raises(StictionError, match=message):
        reordered(find_robot(ROBOT), names)


RL_SAR = {
    **{"dt": 0.005, "decimation": 4, "num_of_dofs": 12, "wheel_indices": [], "torque_limits": [33.5] * 12},
    **{"joint_names": [*JOINTS[3:6], *JOINTS[:3], *JOINTS[6:]]},
    **{"joint_mapping": [3, 4, 5, 0, 1, 2, 6, 7, 8, 9, 10, 11], "default_dof_pos": [0.0, 0.8, -1.5] * 4},
    **{"observations": ["ang_vel", "gravity_vec", "commands", "dof_pos", "dof_vel", "actions"], "clip_obs": 100.0},
    **{"observations_history": [5, 4, 3, 2, 1, 0], "observations_history_priority": "time"},
    **{"clip_actions_lower": [-100.0] * 12, "clip_actions_upper": [100.0] * 12},
    **{"action_scale": [0.125, 0.25, 0.25] * 4},
    **{"rl_kp": [20.0] * 12, "rl_kd": [0.5] * 12, "lin_vel_scale": 2.0, "ang_vel_scale": 0.25, "dof_pos_scale": 1.0},
    **{"dof_vel_scale": 0.05, "commands_scale": [2.0, 2.0, 0.25]},
}


def test_an_rl_sar_config_by_hand() -> None:
    """The policy's first joint is the fourth of the robot's list; six whole frames, the oldest first."""
    spec = read_rl_sar(RL_SAR, "config.yaml")
    require(spec, "config.yaml")
    assert spec.joint_names == JOINTS and spec.control_period == pytest.approx(0.02)
    contract = contract_of(spec, find_robot(ROBOT), ("n", b""), "r", "c")
    layout = contract.observation
    assert (layout.size, layout.layout, layout.direction, layout.fill) == (270, "frame_major", "oldest_first", "zero")
    assert contract.action_scale == (0.125, 0.25, 0.25) * 4 and contract.torque_limit == (33.5,) * 12
    assert contract.action_clip == 100.0 and layout.terms[2].scale == (2.0, 2.0, 0.25)
    np.testing.assert_allclose(layout.terms[4].clips, 100.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"observations": ["ang_vel", "phase"]}, "unknown observation term 'phase'"),
        ({"wheel_indices": [12]}, "wheels"),
        ({"observations_history": [0, 2, 4]}, "every frame from 0 on"),
        ({"clip_actions_upper": [100.0] * 11 + [50.0]}, "one bound of all actions"),
        ({"clip_actions_lower": []}, "one bound of all actions"),
        ({"observations": [None]}, "expected a name"),
        ({"joint_mapping": [0] * 12}, "12 different numbers"),
        ({"rl_kp": "20"}, "expected a list"),
    ],
)
def test_what_a_contract_cannot_hold_is_refused(change: dict, message: str) -> None:
    """Rejects a policy that a contract cannot hold completely."""
    with pytest.raises(StictionError, match=message):
        read_rl_sar(RL_SAR | change, "config.yaml")


def named(tmp_path: Path, **changes: object) -> list[Path]:
    """Return our settings of a policy of 45 inputs, as a file."""
    terms = ("angular_velocity", "projected_gravity", "command", "joint_position", "joint_velocity", "last_action")
    plain = {
        **{"joints": [*JOINTS], "control_period": 0.02, "kp": 30, "kd": 1, "action_scale": 0.25, "action_clip": "none"},
        "default_position": {".*_hip_joint": 0, ".*_thigh_joint": 0.9, ".*_calf_joint": -1.8},
        "observation": [{"term": name} for name in terms],
    }
    return [written(tmp_path / "own.yaml", yaml.safe_dump(plain | changes))]


def test_an_import_that_fails_leaves_nothing(tmp_path: Path) -> None:
    """A network that always asks for 9 runs a joint out of its limits; the message is of the policy, not of a file."""
    ports = (Port("obs", FLOAT, (1, 45)), Port("actions", FLOAT, (1, 12)))
    held = {"w": constant("w", np.zeros((45, 12), np.float32)), "b": constant("b", np.full(12, 9, np.float32))}
    far = write_network(NetworkFile((Node("Gemm", ("obs", "w", "b"), ("actions",), {}),), held, *ports), 13, 8)
    (tmp_path / "robot.xml").write_text(quad('armature="0.005"', '<position kp="35" forcerange="-30 30"', (-2.0, 2.0)))
    files = named(tmp_path, kp=35, kd=0, action_scale=0.5, default_position=0)
    with pytest.raises(StictionError, match=r"theirs.onnx does not walk.*kp 35 N m/rad and kd 0.*trained with"):
        import_policy(written(tmp_path / "theirs.onnx", far), str(tmp_path / "robot.xml"), tmp_path / "bundle", files)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["own.yaml", "robot.xml", "theirs.onnx"]


def test_frames_follow_from_the_size_of_the_input(tmp_path: Path) -> None:
    """135 inputs of 45 a frame are three; then only the order of the frames is asked for."""
    model = written(tmp_path / "theirs.onnx", network(135))
    with pytest.raises(StictionError, match=r"--settings: history.layout: .*; history.direction: .*; history.fill: "):
        import_policy(model, ROBOT, tmp_path / "bundle", named(tmp_path))
    one = written(tmp_path / "one.onnx", network(45))
    contract = import_policy(one, ROBOT, tmp_path / "bundle", named(tmp_path)).bundle.contract
    assert contract.observation.history_length == 1
    with pytest.raises(StictionError, match=r"history.length: frames"):
        import_policy(written(tmp_path / "odd.onnx", network(46)), ROBOT, tmp_path / "odd", named(tmp_path))


def test_torque_limits_that_replace_the_robots_are_told(tmp_path: Path) -> None:
    """23.5 N m at the calf, where the robot has 45.43: by import, on the card, and beside the levels of evaluate."""
    notes: list[str] = []
    model, out = written(tmp_path / "theirs.onnx", network(45)), tmp_path / "bundle"
    check = import_policy(model, ROBOT, out, named(tmp_path, torque_limit=23.5), say=notes.append)
    limits = "23.5 N m at FR_calf_joint and 3 more (of go2 45.43)"
    assert any("torque limits are" in note and limits in note for note in notes)
    card = (out / "card.md").read_text()
    assert limits in card and "| torque limits | 23.5 N m |" in card and "torque limits are the policy's" in card
    assert limits in other_limits([check.bundle])["bundle"]
    plain = import_policy(model, ROBOT, tmp_path / "plain", named(tmp_path), say=notes.append)
    assert other_limits([plain.bundle]) == {} and "torque limits too" in (tmp_path / "plain" / "card.md").read_text()
