"""Presets: observation and action of a trainer's standard velocity task, for networks without a description."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest

from foreign import JOINTS, MJLAB, network, numbers, written
from quads import quad
from stiction.cli.import_policy import Import
from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.exchange.policies.description import PolicySpec, contract_of
from stiction.exchange.policies.importer import describe_policy, read_network
from stiction.exchange.policies.presets import PRESETS, by_breadth, by_depth
from stiction.files.bundle import read_bundle
from stiction.files.contract import Contract
from stiction.robots.catalog import find_derived, find_robot

LEGS = {"maker": ("FR", "FL", "RR", "RL"), "name": ("FL", "FR", "RL", "RR")}
PARTS = ("hip", "thigh", "calf")
LIMBS = {legs: tuple(f"{leg}_{part}_joint" for leg in order for part in PARTS) for legs, order in LEGS.items()}
LEVELS = tuple(f"{leg}_{part}_joint" for part in PARTS for leg in LEGS["name"])


def spec_of(tmp_path: Path, preset: str, size: int, robot: str = "go2", own: str = "", **metadata: str) -> PolicySpec:
    """Return the description of a network, with or without metadata, and with our settings."""
    path = written(tmp_path / "net.onnx", network(size, metadata=metadata or None))
    settings = [written(tmp_path / "own.yaml", own)] if own else []
    return describe_policy(read_network(path)[1], path.name, settings, find_derived(robot), preset)


def contract(tmp_path: Path, preset: str, size: int, robot: str = "go2", own: str = "", **metadata: str) -> Contract:
    """Return the contract that follows."""
    return contract_of(spec_of(tmp_path, preset, size, robot, own, **metadata), find_robot(robot), ("n", b""), "r", "c")


def columns(made: Contract) -> list[tuple[str, list[float], list[float]]]:
    """Return name, scale and bound of each entry of a frame's terms; no bound: infinite."""
    return [
        (term.name, term.scales.tolist(), [math.inf if clip >= 1e6 else float(clip) for clip in term.clips])
        for term in made.observation.terms
    ]


def each(name: str, size: int, scale: Any = 1.0, clip: float = math.inf) -> tuple[str, list[float], list[float]]:
    """Return a term as `columns` does, by hand."""
    return name, list(scale) if isinstance(scale, tuple) else [scale] * size, [clip] * size


FLAT = ("base_linear_velocity", "angular_velocity", "projected_gravity", "command")
MOTION = ("joint_position", "joint_velocity", "last_action")


def test_the_flag_names_every_preset() -> None:
    """A trainer in the table that the command line does not know could not be asked for."""
    literal, _none = get_args(get_type_hints(Import)["preset"])
    assert set(get_args(literal)) == set(PRESETS)


def test_isaac_lab_by_hand(tmp_path: Path) -> None:
    """48 numbers without scales, joints side by side, 25 and 0.5 for gains: its Go2."""
    made = contract(tmp_path, "isaaclab", 48)
    assert columns(made) == [each(name, 3) for name in FLAT] + [each(name, 12) for name in MOTION]
    assert made.joint_names == LEVELS and made.action_clip == 1000.0 and made.action_scale == 0.25
    assert (made.control_period, made.decimation, set(made.kp), set(made.kd)) == (0.02, 4, {25.0}, {0.5})
    pose = [0.1, -0.1, 0.1, -0.1, 0.8, 0.8, 1.0, 1.0, -1.5, -1.5, -1.5, -1.5]
    np.testing.assert_allclose(made.standing, pose)


def test_isaac_lab_over_rough_ground(tmp_path: Path) -> None:
    """187 heights, cut off at 1 m: from behind to the front first, then from right to left; 0.5 m less."""
    layout = contract(tmp_path, "isaaclab", 235).observation
    assert columns(contract(tmp_path, "isaaclab", 235))[-1] == each("height_scan", 187, 1.0, 1.0)
    assert layout.heights is not None and layout.heights.offset == 0.5
    points = layout.heights.points
    assert (points[0], points[1], points[16], points[17]) == ((-0.8, -0.5), (-0.7, -0.5), (0.8, -0.5), (-0.8, -0.4))


def test_isaac_lab_with_a_history(tmp_path: Path) -> None:
    """144 inputs are three frames, of each term all of them, the oldest first; the first frame fills them."""
    layout = contract(tmp_path, "isaaclab", 144).observation
    stacked = layout.history_length, layout.layout, layout.direction, layout.fill
    assert stacked == (3, "term_major", "oldest_first", "first")


def test_legged_gym_by_hand(tmp_path: Path) -> None:
    """Scales 2, 0.25, (2, 2, 0.25) and 0.05, then a clip at 100; joints leg by leg, 20 and 0.5 for gains."""
    made = contract(tmp_path, "legged_gym", 48)
    scales = (2.0, 0.25, 1.0, (2.0, 2.0, 0.25), 1.0, 0.05, 1.0)
    sizes = (3, 3, 3, 3, 12, 12, 12)
    assert columns(made) == [
        each(name, size, scale, 100.0) for name, size, scale in zip((*FLAT, *MOTION), sizes, scales, strict=True)
    ]
    assert made.joint_names == LIMBS["name"] and made.action_clip == 100.0 and made.action_scale == 0.25
    assert (made.control_period, set(made.kp), set(made.kd)) == (0.02, {20.0}, {0.5})
    np.testing.assert_allclose(made.standing, [s for hip, t in ((0.1, 0.8), (-0.1, 0.8), (0.1, 1.0), (-0.1, 1.0))
                                               for s in (hip, t, -1.5)])  # fmt: skip
    rough = contract(tmp_path, "legged_gym", 235).observation
    assert rough.terms[-1].scale == 5.0 and rough.terms[-1].clip == 5.0 and rough.heights is not None
    assert rough.heights.points[1] == (-0.8, -0.4) and rough.heights.points[11] == (-0.7, -0.5)


def test_mjlab_by_hand(tmp_path: Path) -> None:
    """The command is last; gains of the Go1 follow from rotors of 1.118e-4 kg m² behind gears of 6 and 9."""
    made = contract(tmp_path, "mjlab", 48, "go1")
    sizes = (3, 3, 3, 12, 12, 12, 3)
    assert columns(made) == [each(name, n) for name, n in zip((*FLAT[:3], *MOTION, "command"), sizes, strict=True)]
    assert made.joint_names == LIMBS["maker"] and made.action_clip == 1000.0
    rotors, omega = 0.000111842 * np.array([36.0, 36.0, 81.0]), 2 * np.pi * 10
    np.testing.assert_allclose(made.kp[:3], rotors * omega**2, rtol=1e-3)
    np.testing.assert_allclose(made.kd[:3], 4 * rotors * omega, rtol=1e-3)
    scale = 0.25 * np.array([23.7, 23.7, 35.55]) / (rotors * omega**2)
    np.testing.assert_allclose(made.array("standing")[:3] * 0 + made.array("action_scale")[:3], scale, rtol=1e-3)
    np.testing.assert_allclose(made.standing[:6], [0.1, 0.9, -1.8, -0.1, 0.9, -1.8])
    rough = contract(tmp_path, "mjlab", 235, "go1").observation
    assert rough.terms[-1].scale == 0.2 and rough.heights is not None and rough.heights.offset == 0.0


def test_rl_sar_by_hand(tmp_path: Path) -> None:
    """No linear velocity, 0.25 and 0.05 for velocities, none for the command; the maker's joints, half for hips."""
    made = contract(tmp_path, "rl_sar", 45)
    sizes, scales = (3, 3, 3, 12, 12, 12), (0.25, 1.0, 1.0, 1.0, 0.05, 1.0)
    assert columns(made) == [
        each(name, n, scale, 100.0) for name, n, scale in zip((*FLAT[1:], *MOTION), sizes, scales, strict=True)
    ]
    assert made.joint_names == LIMBS["maker"] and made.action_scale == (0.125, 0.25, 0.25) * 4
    assert (set(made.kp), set(made.kd), made.action_clip, set(made.torque_limit)) == ({20.0}, {0.5}, 100.0, {23.5})
    np.testing.assert_allclose(made.standing, [0.0, 0.8, -1.5] * 4)
    with pytest.raises(StictionError, match=r"history.layout: .*; history.direction: [^;]*$"):
        spec_of(tmp_path, "rl_sar", 90)


def test_unitree_by_hand(tmp_path: Path) -> None:
    """Scales 0.2 and 0.05 of velocities behind a clip at 100: bounds of 20 and 5; joints side by side, 25 and 0.5."""
    made = contract(tmp_path, "unitree", 45)
    sizes, scales = (3, 3, 3, 12, 12, 12), (0.2, 1.0, 1.0, 1.0, 0.05, 1.0)
    assert columns(made) == [
        each(name, n, scale, 100.0 * scale) for name, n, scale in zip((*FLAT[1:], *MOTION), sizes, scales, strict=True)
    ]
    assert made.joint_names == LEVELS and (set(made.kp), set(made.kd), made.action_scale) == ({25.0}, {0.5}, 0.25)
    stacked = contract(tmp_path, "unitree", 225).observation
    assert (stacked.history_length, stacked.layout, stacked.direction) == (5, "term_major", "oldest_first")


@pytest.mark.parametrize(
    ("preset", "size", "message"),
    [
        ("isaaclab", 46, r"got a network of 46 inputs.* 48 \(flat\) or 235 \(rough.*or whole multiples"),
        ("isaaclab", 720 * 47, r"got a network of 33840 inputs"),
        ("legged_gym", 45, r"expected 48 \(flat\) or 235 \(rough[^:]*\); say the observation"),
        ("legged_gym", 96, "got a network of 96 inputs"),
        ("mjlab", 47, "got a network of 47 inputs"),
        ("rl_sar", 48, r"expected 45 \(flat\), or whole multiples"),
        ("unitree", 48, r"expected 45 \(flat\), or whole multiples"),
    ],
)
def test_a_size_that_does_not_fit_is_refused(tmp_path: Path, preset: str, size: int, message: str) -> None:
    """One term too many, or a history where the trainer has none; 33840 is a multiple of 48 and of 235."""
    with pytest.raises(StictionError, match=message):
        spec_of(tmp_path, preset, size)


def test_a_size_of_joints_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    """18 actions make other sizes: 66 and 253."""
    path = written(tmp_path / "net.onnx", network(48, 18))
    with pytest.raises(StictionError, match=r"48 inputs and 18 actions, expected 66 \(flat\) or 253"):
        describe_policy(read_network(path)[1], path.name, [], find_derived("saturn_lite"), "isaaclab")


def test_actions_of_another_robot_are_refused_first(tmp_path: Path) -> None:
    """18 actions for 12 joints: before any layout is sized by them, with a preset, without one, and by name."""
    path = written(tmp_path / "net.onnx", network(66, 18))
    one = written(tmp_path / "own.yaml", "joints: [FL_hip_joint]\n")
    for preset, settings, whose in (
        ("isaaclab", [], "go2 drives 12"),
        (None, [], "go2 drives 12"),
        ("isaaclab", [one], "its description names 1"),
    ):
        with pytest.raises(StictionError, match=f"net.onnx: the network gives 18 actions, {whose} joints; expected"):
            describe_policy(read_network(path)[1], path.name, settings, find_derived("go2"), preset)


def test_metadata_win_over_the_preset_and_settings_over_both(tmp_path: Path) -> None:
    """Gains of 25 of the metadata, not 15.9; the period of the settings, not 0.02; the clip alone is the preset's."""
    filled = spec_of(tmp_path, "mjlab", 63, "go1", "control_period: 0.01\nkd: 0.7\n", **MJLAB)
    assert filled.kp == (25.0,) * 12 and filled.kd == 0.7 and filled.control_period == 0.01
    assert filled.action_clip == math.inf and filled.observation is not None and len(filled.observation) == 6
    assert filled.assumed == {"preset": "mjlab", "assumed": "physics_timestep, action_clip"}
    told = [note for note in filled.notes if note.startswith("--preset")]
    assert told[0].startswith("--preset mjlab assumes physics_timestep 0.005") and len(told) == 2


def test_heights_of_metadata_come_from_the_preset(tmp_path: Path) -> None:
    """Metadata of mjlab name a height scan and have no points."""
    rough = MJLAB | {
        "observation_names": "base_ang_vel,height_scan",
        "observation_terms_scale": "1.000,0.200",
        "observation_terms_history_length": "0,0",
        "observation_terms_clip": "-inf;inf,-inf;inf",
    }
    made = contract(tmp_path, "mjlab", 190, "go1", **rough)
    assert made.observation.size == 190 and made.imported is not None and "heights" in made.imported["assumed"]


@pytest.mark.parametrize(
    ("metadata", "trainer"),
    [(MJLAB, "mjlab"), ({"dof_names": "[]", "kp": "[]", "kd": "[]"}, "holosoma")],
)
def test_a_preset_of_another_trainer_is_refused(tmp_path: Path, metadata: dict[str, str], trainer: str) -> None:
    """Rejects a preset of another trainer."""
    with pytest.raises(StictionError, match=f"got isaaclab, and the metadata of net.onnx are {trainer}'s"):
        spec_of(tmp_path, "isaaclab", 63, **metadata)


def test_gains_that_a_trainer_does_not_have_are_asked_for(tmp_path: Path) -> None:
    """Isaac Lab's Go1 has an Actuator Net; a shipped robot's gains are ours, and nobody's training."""
    for robot, asked in (("go1", r"--settings: kp: [^;]*; kd: [^;]*$"), ("g1", "kp: .*; kd: .*; default_position")):
        with pytest.raises(StictionError, match=asked):
            spec_of(tmp_path, "isaaclab", 48, robot)


def test_a_robots_own_file_says_its_gains(tmp_path: Path) -> None:
    """The servo has kp 35 and no kd, and a keyframe: mjlab alone has a rule for kd, 2 · 2 · 0.005 · 2π · 10."""
    robot = written(tmp_path / "robot.xml", quad('armature="0.005"', '<position kp="35" forcerange="-30 30"', (-2, 2)))
    with pytest.raises(StictionError, match=r"--settings: kd: derivative gains [^;]*$"):
        spec_of(tmp_path, "legged_gym", 48, str(robot))
    for preset, own, kd, scale in (("mjlab", "", 0.4 * np.pi, 0.25 * 30 / 35), ("isaaclab", "kd: 0.6", 0.6, 0.5)):
        filled = spec_of(tmp_path, preset, 48, str(robot), own)
        assert filled.kp == 35.0 and isinstance(filled.default_position, dict)
        assert (filled.kd, filled.action_scale) == (pytest.approx(kd), pytest.approx(scale))


def test_orders_of_joints(tmp_path: Path) -> None:
    """Level by level, and limb by limb; siblings by name, whatever the order in the file."""
    robot = find_robot("go2")
    assert by_breadth(robot) == LEVELS and by_depth(robot) == LIMBS["name"] != robot.joint_names == JOINTS


def test_the_command_prints_a_line_each_and_the_contract_keeps_their_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A network without metadata, a robot and a preset: a bundle that verifies, without a file of settings."""
    model, out = written(tmp_path / "net.onnx", network(48)), tmp_path / "bundle"
    assert main(["import", str(model), "--robot", "go2", "--preset", "legged_gym", "--out", str(out)]) == 0
    told = [line for line in capsys.readouterr().err.splitlines() if "--preset" in line]
    imported = read_bundle(out).contract.imported
    assert imported is not None and imported["preset"] == "legged_gym"
    fields = imported["assumed"].split(", ")
    assert len(told) == len(fields) == 11
    for field, line in zip(fields, told, strict=True):
        assert line.startswith(f"stiction import: --preset legged_gym assumes {field} "), line
    assert "assumes kp 20 (its go2)" in (out / "card.md").read_text()


def test_a_standard_deploy_yaml_and_the_preset_say_the_same(tmp_path: Path) -> None:
    """unitree_rl_lab's Go2 by its file, whose action is cut off at 100 rad, and by the preset."""
    pose, wide = [0.1, -0.1, 0.1, -0.1, 0.8, 0.8, 1.0, 1.0] + [-1.5] * 4, [[-100.0, 100.0]] * 12
    scales = {"base_ang_vel": 0.2, "projected_gravity": 1.0, "velocity_commands": 1.0}
    scales |= {"joint_pos_rel": 1.0, "joint_vel_rel": 0.05, "last_action": 1.0}
    action = {"clip": wide, "joint_names": [".*"], "scale": [0.25] * 12, "offset": pose, "joint_ids": None}
    deploy = {
        "joint_ids_map": [3, 0, 9, 6, 4, 1, 10, 7, 5, 2, 11, 8],
        **{"step_dt": 0.02, "stiffness": [25.0] * 12, "damping": [0.5] * 12, "default_joint_pos": pose},
        "actions": {"JointPositionAction": action},
        "observations": {
            name: {"params": {}, "clip": [-100, 100], "scale": [scale] * (3 if n < 3 else 12), "history_length": 1}
            for n, (name, scale) in enumerate(scales.items())
        },
    }
    own = json.dumps(deploy)
    by_file, by_preset = contract(tmp_path, "unitree", 45, own=own), contract(tmp_path, "unitree", 45)
    assert columns(by_file) == columns(by_preset)
    for name in ("joint_names", "kp", "kd", "standing", "action_scale", "action_clip", "control_period"):
        assert getattr(by_file, name) == getattr(by_preset, name), name
    action["clip"] = [*wide[:11], [-100.0, 1.0]]
    with pytest.raises(StictionError, match="got clip -100 to 1 rad"):
        contract(tmp_path, "unitree", 45, own=json.dumps(deploy))


def test_metadata_of_mjlab_and_the_preset_agree_on_its_go1(tmp_path: Path) -> None:
    """The preset equals the metadata of mjlab 1.6 for its flat Go1, rounded to three decimals."""
    metadata = MJLAB | {
        "joint_stiffness": ",".join(["15.895,15.895,35.764"] * 4),
        "joint_damping": ",".join(["1.012,1.012,2.277"] * 4),
        "default_joint_pos": ",".join(["0.100,0.900,-1.800,-0.100,0.900,-1.800"] * 2),
        "action_scale": ",".join(["0.373,0.373,0.249"] * 4),
        "observation_names": "base_lin_vel,base_ang_vel,projected_gravity,joint_pos,joint_vel,actions,command",
        "observation_terms_scale": numbers(1.0, 7),
        "observation_terms_history_length": numbers(0.0, 7),
        "observation_terms_clip": ",".join(["-inf;inf"] * 7),
    }
    by_file, by_preset = contract(tmp_path, "mjlab", 48, "go1", **metadata), contract(tmp_path, "mjlab", 48, "go1")
    assert columns(by_file) == columns(by_preset) and by_file.joint_names == by_preset.joint_names
    for name in ("kp", "kd", "standing", "action_scale"):
        np.testing.assert_allclose(by_file.array(name), by_preset.array(name), atol=6e-4, err_msg=name)
