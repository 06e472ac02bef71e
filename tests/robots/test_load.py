"""A robot from its file and a few lines: what is derived, what is said, and what is refused by name."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from robot_files import MJCF, urdf, write
from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.robots.catalog import find_robot
from stiction.robots.load import load_robot
from stiction.robots.mirror import robot_mirror
from stiction.robots.mjcf import build_model


def test_everything_derivable_is_derived_by_hand(tmp_path: Path) -> None:
    """A motor of gear 2 and 12 N m gives 24; kp = 0.01 (20π)²; feet, groups, pose and height come from the file."""
    (tmp_path / "dog.xml").write_text(MJCF)
    derived = load_robot(tmp_path / "dog.xml")
    robot = derived.robot
    kp = 0.01 * (20 * np.pi) ** 2
    assert robot.name == "dog" and robot.mass == pytest.approx(6 + 4 * 1.95) and robot.num_joints == 12
    assert (robot.joint_values("torque_limit") == 24.0).all()
    assert robot.joint_values("kp") == pytest.approx(kp) and robot.joint_values("kd") == pytest.approx(0.8 * np.pi)
    assert robot.joint_values("action_scale") == pytest.approx(0.25 * 24 / kp)
    assert robot.joint_kinds == ("hip", "thigh", "calf")
    assert robot.foot_names == ("FL_foot", "FR_foot", "RL_foot", "RR_foot")
    assert robot.groups().tolist() == [0, 1, 1, 0]
    assert robot.joint_values("default_position")[:3].tolist() == [0.0, 0.8, -1.5]
    # Thigh and calf of 0.2 m at 0.8 and -0.7 rad from the vertical, and the ball's radius.
    assert robot.standing_height == pytest.approx(0.2 * np.cos(0.8) + 0.2 * np.cos(0.7) + 0.02)
    assert robot.base.size == pytest.approx((0.4, 0.1, 0.12))
    sources = {(origin.field, origin.source) for origin in derived.origins}
    assert ("torque_limit", "file: ctrlrange of its motor") in sources
    assert ("default_position", "file: keyframe 'home'") in sources


def test_what_is_said_wins_and_the_first_match_counts(tmp_path: Path) -> None:
    """Field by field: an expression that says less leaves the rest to the next one."""
    description = """
model: robot.xml
name: rex
joints:
  FL_hip_joint: {kp: 60}
  .*_(hip|thigh)_joint: {kp: 50, kd: 1e-1}
  .*: {kp: 40, torque_limit: 20, kind: leg}
pose: {.*_hip_joint: 0.05, .*_thigh_joint: 0.9, .*_calf_joint: -1.8}
feet: [RR_ball, RL_ball, FR_ball, FL_ball]
groups: [[RR_ball, RL_ball], [FR_ball, FL_ball]]
vendor: {order: [FR_calf_joint, FR_thigh_joint, FR_hip_joint, FL_hip_joint, FL_thigh_joint, FL_calf_joint,
  RL_hip_joint, RL_thigh_joint, RL_calf_joint, RR_hip_joint, RR_thigh_joint, RR_calf_joint],
  sign: {FR_.*: -1}, offset: {.*_calf_joint: 0.2}}
"""
    robot = load_robot(write(tmp_path, description)).robot
    assert robot.name == "rex" and robot.joint_kinds == ("leg",)
    assert robot.joint_values("kp")[:4].tolist() == [60.0, 50.0, 40.0, 50.0]
    assert robot.joint_values("kd")[0] == 0.1
    assert robot.joint_values("default_position")[:3].tolist() == [0.05, 0.9, -1.8]
    assert robot.foot_names[0] == "RR_ball" and robot.groups().tolist() == [0, 0, 1, 1]
    assert robot.vendor.order[0] == "FR_calf_joint"
    assert robot.vendor.sign[:4] == (-1.0, -1.0, -1.0, 1.0) and robot.vendor.offset[:2] == (0.2, 0.0)


def test_a_urdf_keeps_its_root_and_its_mass(tmp_path: Path) -> None:
    """MuJoCo would make the pelvis part of the world; its picture in a format nobody decodes is left out and named."""
    path = write(tmp_path, "model: robot.urdf\njoints: {.*: {armature: 0.02}}\n", urdf(), "robot.urdf")
    derived = load_robot(path)
    robot = derived.robot
    assert robot.mass == pytest.approx(12.0) and robot.base.mass == 5.0
    assert robot.joint_names == ("left_hip", "left_knee", "right_hip", "right_knee")
    assert robot.joint_values("torque_limit").tolist() == [60.0, 80.0, 60.0, 80.0]
    assert robot.foot_names == ("left_shank", "right_shank") and robot.groups() is None
    assert robot.standing_height == pytest.approx(0.05 + 0.3 + 0.32)
    assert robot_mirror(robot).joints.tolist() == [2, 3, 0, 1]
    assert any("floats here" in note for note in derived.notes)


def tetrahedron(path: Path) -> None:
    """Write a mesh with corners at 0.1, 0.2, 0.3 m along the axes and at the origin."""
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.3]], "<f4")
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *corners[list(face)].ravel(), 0) for face in faces)
    path.write_bytes(b"\0" * 80 + struct.pack("<I", 4) + body)


@pytest.mark.parametrize(
    "name", ["package://dog_description/meshes/foot.stl", "meshes/foot.stl", "/elsewhere/foot.STL"]
)
def test_a_mesh_is_found_wherever_its_package_lies(name: str, tmp_path: Path) -> None:
    """As a package, beside the file, or by its own name under the package's folder."""
    (tmp_path / "urdf").mkdir()
    (tmp_path / "meshes").mkdir()
    tetrahedron(tmp_path / "meshes" / "foot.stl")
    box = '<geometry><box size=".2 .08 .04"/></geometry>'
    model = urdf().replace(box, f'<geometry><mesh filename="{name}"/></geometry>')
    path = write(tmp_path / "urdf", "model: robot.urdf\njoints: {.*: {armature: 0.02}}\n", model, "robot.urdf")
    foot = load_robot(path).robot.feet[0]
    (shape,) = foot.shapes
    corners = np.array(shape.vertices) @ shape.rotation.T + shape.position
    np.testing.assert_allclose(np.ptp(corners, axis=0), [0.1, 0.2, 0.3], atol=1e-6)
    assert build_model(find_robot(str(path))).nmesh == 2


def test_a_complete_yaml_is_the_same_robot(tmp_path: Path) -> None:
    """`robot show` writes all that is known; loaded again with the model that is simulated, nothing has changed."""
    from stiction.robots.description import complete_text
    from stiction.robots.mjcf import build

    file = write(tmp_path)
    file.write_text(file.read_text() + "gait_period: 0.5\n")
    robot = load_robot(file).robot
    (tmp_path / "simulated.xml").write_text(build(robot).to_xml())
    (tmp_path / "complete.yaml").write_text(complete_text(robot, "simulated.xml"))
    again = load_robot(tmp_path / "complete.yaml").robot
    assert again.joint_names == robot.joint_names and again.foot_names == robot.foot_names
    for name in ("torque_limit", "armature", "kp", "kd", "lower", "upper", "default_position", "action_scale"):
        np.testing.assert_allclose(again.joint_values(name), robot.joint_values(name), rtol=1e-6)
    assert again.standing_height == pytest.approx(robot.standing_height, abs=1e-6)
    assert again.gait_period == robot.gait_period == 0.5
    assert again.mass == pytest.approx(robot.mass) and again.joint_kinds == robot.joint_kinds


@pytest.mark.parametrize("more", [[], ["--overwrite"]])
@pytest.mark.parametrize("apart", [False, True])
def test_a_robot_is_not_shown_into_its_own_files(
    tmp_path: Path, capsys: pytest.CaptureFixture, apart: bool, more: list[str]
) -> None:
    """`robot show robot.yaml --out .` replaced the user's own robot.yaml and model by the complete ones."""
    (tmp_path / "model").mkdir()
    file = write(tmp_path / "model")
    if apart:
        file = file.replace(tmp_path / "robot.yaml")
        file.write_text("model: model/robot.xml\n")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.*")}
    assert main(["robot", "show", str(file), "--out", str(tmp_path / "model"), *more]) == 1
    output = capsys.readouterr()
    assert "robot.xml is an input and would be overwritten; choose another --out" in output.err and output.out == ""
    assert output.err.count("\n") == 1 and {path: path.read_bytes() for path in tmp_path.rglob("*.*")} == before


@pytest.mark.parametrize(
    ("description", "message"),
    [
        ("model: other.xml", "there is no such .xml or .urdf file"),
        ("model: my_package:make", "is code, which no file may run"),
        ("model: robot.xml\njiont: {}", "unknown field 'jiont'; did you mean 'joints'"),
        ("model: robot.xml\njoints: {.*_hip: {kp: 1}}", r"unknown joint '\.\*_hip'"),
        ("model: robot.xml\njoints: {.*: {kp: fast}}", "kp is 'fast'; expected a number"),
        ("model: robot.xml\njoints: {.*: {torque_limit: 0}}", "has no torque limit"),
        ("model: robot.xml\njoints: {'a?a?a?a?a?aaaaa': {kp: 1}}", "could be slow"),
        ("model: robot.xml\njoints: {'[': {kp: 1}}", "not a regular expression"),
        ("model: robot.xml\npose: {.*_thigh_joint: 45}", "45 rad; is that in degrees"),
        ("model: robot.xml\npose: {.*_calf_joint: 1.0}", "outside its limits"),
        ("model: robot.xml\nkeyframe: hoem", "unknown keyframe 'hoem'; did you mean 'home'"),
        ("model: robot.xml\nbase: FL_calf", "against the body that floats"),
        ("model: robot.xml\ngroups: [[FL_foot], [FR_foot]]", "name each foot once|name each"),
        ("model: robot.xml\nmirror: {FL_hip: FR_hip_joint}", "unknown joint 'FL_hip'"),
        ("model: robot.xml\nvendor: {sign: {.*: 2}}", "expected 1 or -1"),
        ("model: robot.xml\ngait_period: 30", "gait_period is 30 s, with 4 feet; expected 0.2 to 3 s"),
        ("model: robot.xml\ngait_period: slow", "gait_period is 'slow'; expected a number"),
        ("model: robot.xml\nmodel: robot.xml", "'model' is given twice"),
        ("model: [robot.xml", "is not YAML"),
    ],
)
def test_what_is_wrong_is_said_by_name(description: str, message: str, tmp_path: Path) -> None:
    """A line that is not understood is never a value that is silently not taken."""
    with pytest.raises(StictionError, match=message):
        load_robot(write(tmp_path, description + "\n"))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('diaginertia="5e-3 5e-3 8e-4"', 'diaginertia="0 0 0"', "inertia"),
        ('<geom type="plane"', '<body><joint name="x"/><geom size="1"/></body><geom type="plane"', "2 of them do"),
        ("<freejoint/>", '<joint name="rail" type="slide"/>', "'rail' is a slide joint"),
        (
            "<actuator>",
            '<equality><joint joint1="FL_hip_joint" joint2="FR_hip_joint"/></equality><actuator>',
            "couples",
        ),
        ('<geom name="hull" type="box" size=".2 .05 .06"/>', '<geom type="mesh" mesh="gone"/>', "gone"),
        ("<mujoco", '<!DOCTYPE x [<!ENTITY a "b">]><mujoco', "entities"),
        ("</mujoco>", "", "is no XML"),
    ],
)
def test_a_broken_copy_is_refused_by_name(old: str, new: str, message: str, tmp_path: Path) -> None:
    """Reports a damaged copy in one line that names the element."""
    assert old in MJCF
    with pytest.raises(StictionError, match=message):
        load_robot(write(tmp_path, model=MJCF.replace(old, new, 12 if "ctrlrange" in old else 1)))


def test_a_mesh_that_is_needed_and_missing_is_refused(tmp_path: Path) -> None:
    """Its body has its mass from it: without it, it would be another robot; one that is only seen is left out."""
    seen = MJCF.replace("<worldbody>", '<asset><mesh name="m" file="m.dae"/></asset><worldbody>')
    seen = seen.replace('<geom name="hull"', '<geom class="seen" type="mesh" mesh="m"/><geom name="hull"')
    derived = load_robot(write(tmp_path, model=seen))
    assert any("'m.dae' is not there; it is left out" in note for note in derived.notes)
    needed = seen.replace('<inertial pos="0 0 0" mass="6" diaginertia=".02 .07 .08"/>', "")
    with pytest.raises(StictionError, match=r"'m.dae' is not there, and the body 'trunk' has its mass from it"):
        load_robot(write(tmp_path, model=needed))
