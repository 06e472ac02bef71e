"""`stiction convert` as a user types it."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from stiction.cli.main import main
from stiction.files.joints import Estimate, JointRecord, JointsFile

MODEL = '<mujoco><worldbody><body><joint name="FL_calf_joint"/><geom size="1"/></body></worldbody></mujoco>'


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with an identification and a model."""
    friction = Estimate(0.4, 0.01, (0.38, 0.42))
    record = JointRecord(coulomb_friction=friction, viscous_friction=friction, test_condition="in_air")
    JointsFile({"shank": record}).write(tmp_path / "joints.json")
    (tmp_path / "robot.xml").write_text(MODEL)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("target", "word"),
    [
        *(("mujoco", "frictionloss"), ("urdf", "<dynamics"), ("isaaclab", "dynamic_friction")),
        *(("isaaclab_newton", "friction=0.4"), ("playground", "in_axes"), ("legged_gym", "JointFriction")),
        ("genesis", "set_dofs_frictionloss"),
        *(("webots", "staticFriction"), ("mjlab", "\nwith_joints(cfg, 'joints.json')\n")),
    ],
)
def test_every_target_has_a_snippet(folder: Path, capsys: pytest.CaptureFixture, target: str, word: str) -> None:
    """On standard output, and as JSON with what to mind."""
    assert main(["convert", "joints.json", "--to", target]) == 0
    text = capsys.readouterr().out
    assert word in text
    assert main(["convert", "joints.json", "--to", target, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["text"] == text and told["joints"] == {"shank": "shank"} and told["notes"] and told["to"] == target


LEGS = {f"{leg}_calf_joint" for leg in ("FL", "FR", "RL", "RR")}


@pytest.mark.parametrize("target", ["mujoco", "urdf", "webots", "playground", "legged_gym", "genesis", "joints"])
def test_a_wildcard_matches_the_joints_of_a_robot(folder: Path, capsys: pytest.CaptureFixture, target: str) -> None:
    """One record for four legs, without a model; or joint by joint, as the message says that refuses the wildcard."""
    options = ["convert", "joints.json", "--to", target, "--json", "--joint-map"]
    assert main([*options, "shank=*_calf_joint", "--robot", "go2"]) == 0
    assert json.loads(capsys.readouterr().out)["joints"] == dict.fromkeys(LEGS, "shank")
    assert main([*options, "shank=FL_calf_joint", "shank=FR_calf_joint"]) == 0
    assert json.loads(capsys.readouterr().out)["joints"] == dict.fromkeys(("FL_calf_joint", "FR_calf_joint"), "shank")


def test_mjlab_gets_the_names_of_its_joints(folder: Path, capsys: pytest.CaptureFixture) -> None:
    """At most three lines, with patterns as they were typed: there the robot's joints are known."""
    options = ["--to", "mjlab", "--joint-map", "shank=*_calf_joint", "--friction", "static"]
    assert main(["convert", "./joints.json", *options]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line]
    assert len(lines) == 3 and lines[0].startswith("# in mjlab's environment") and "docs/trainers.md says" in lines[0]
    assert lines[2] == "with_joints(cfg, 'joints.json', joint_map=('shank=*_calf_joint',), friction=\"static\")"


def test_a_model_is_patched_into_another_file(folder: Path, capsys: pytest.CaptureFixture) -> None:
    """The notes go to standard error; the model itself stays."""
    options = ["--to", "mujoco", "--model", "robot.xml", "--joint-map", "shank=*_calf_joint", "--out", "new.xml"]
    assert main(["convert", "joints.json", *options]) == 0
    told = capsys.readouterr()
    assert told.out == "" and "new.xml: FL_calf_joint" in told.err
    assert [line for line in told.err.splitlines() if line.startswith("note: written by")] and len(told.err) < 400
    assert 'frictionloss="0.4"' in (folder / "new.xml").read_text()
    assert (folder / "robot.xml").read_text() == MODEL
    (folder / "sub").mkdir()
    assert main(["convert", "joints.json", *options[:-1], "sub/new.xml", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["joints"] == {"FL_calf_joint": "shank"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--to", "mujoco", "--model", "none.xml"], "cannot read none.xml"),
        (["--to", "mujoco", "--model", "joints.json"], "not well-formed XML"),
        (["--to", "urdf", "--model", "robot.xml"], "expected <robot>"),
        (["--to", "mujoco", "--model", "robot.xml"], "no joint of the model takes the record 'shank'"),
        (["--to", "mujoco", "--joint-map", "shank=*_calf"], "add --robot NAME or --model FILE, or name each joint"),
        (["--to", "playground", "--joint-map", "shank=*_calf"], "add --robot NAME, or name each joint, as in --joint-"),
        (["--to", "genesis", "--joint-map", "shank=*_shin", "--robot", "go2"], "unknown joint '*_shin'"),
        (["--to", "isaaclab", "--joint-map", "shank=*_calf"], "'shank=*_calf': Isaac Lab takes a regular expression"),
        (["--to", "isaaclab_newton", "--robot", "go2"], "--robot: got a joints.json and --to isaaclab_newton, which"),
        (["--to", "mujoco", "--model", "robot.xml", "--robot", "go2"], "--robot and --model exclude each other"),
        (["--to", "bam", "--friction", "static"], "--friction requires a --to with one number for friction"),
        (["--to", "isaaclab", "--friction", "static"], "--friction requires a --to with one number for friction"),
        (["--to", "mujoco", "--timestep", "-1"], "timestep -1.0"),
        (["--to", "mujoco", "--assumed-load", "3"], "--assumed-load requires --to isaaclab"),
        (["--to", "isaaclab", "--model", "robot.xml"], "--model requires --to mujoco, urdf or webots"),
        (["--to", "webots", "--model", "robot.xml"], "the model has none with a name"),
        (["--to", "urdf", "--out", "joints.json/where"], "joints.json/where"),
        (["--to", "urdf", "--out", "./joints.json"], "would be overwritten"),
    ],
)
def test_what_a_user_can_mend_is_one_line(
    folder: Path, capsys: pytest.CaptureFixture, options: list[str], message: str
) -> None:
    """Status 1, nothing on standard output."""
    assert main(["convert", "joints.json", *options]) == 1
    told = capsys.readouterr()
    assert told.out == "" and message in told.err and told.err.count("\n") == 1


@pytest.mark.parametrize("link", [os.symlink, os.link])
def test_the_model_is_not_overwritten_under_another_name(folder: Path, capsys: pytest.CaptureFixture, link) -> None:
    """A link is the same file."""
    link("robot.xml", "other.xml")
    options = ["--to", "mujoco", "--model", "robot.xml", "--joint-map", "shank=FL_calf_joint", "--out", "other.xml"]
    assert main(["convert", "joints.json", *options]) == 1
    assert "would be overwritten" in capsys.readouterr().err and (folder / "robot.xml").read_text() == MODEL
