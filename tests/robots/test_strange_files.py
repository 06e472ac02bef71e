"""Robots' files as strangers write them: what was a traceback, a hang or another robot is right, or one line."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from robot_files import MJCF, URDF_LEG, urdf, write
from stiction.core.errors import StictionError
from stiction.robots.check import check_robot
from stiction.robots.load import load_robot

URDF_SAID = "model: robot.urdf\njoints: {.*: {armature: 0.02}}\n"
HIP = 'name="FL_hip_joint" axis="1 0 0" range="-0.9 0.9"'
FLAT = re.sub(r"<keyframe>.*</keyframe>", "", MJCF)
LOST = urdf().replace("</robot>", URDF_LEG.split("<joint")[0].format(s="lost") + "</robot>")
BALL = '<body name="ball"><freejoint/><geom size=".1" mass="1"/></body>'
BOX = '<geometry><box size=".2 .08 .04"/></geometry>'
HAND = """<link name="hand"><inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/>
</inertial><collision><geometry><sphere radius=".05"/></geometry></collision></link><joint name="arm" type="revolute">
<parent link="pelvis"/><child link="hand"/><origin xyz="0 0 .3"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="20" velocity="1"/></joint></robot>"""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('<joint name="FL_hip_joint" axis', "<joint axis", "a joint of the body 'FL_hip' has no name"),
        ('"FL_foot"', '"floor"', "the foot 'floor' has a name"),
        (HIP, HIP.replace("-0.9", "-inf"), "'FL_hip_joint' has a number that is none"),
        ('pos="0.2 0.05 0"', 'pos="1e308 0.05 0"', "the body 'FL_hip' has numbers"),
        ("0 .8 -1.5 ", "0 .8 nan ", "the keyframe 'home' has numbers"),
        ("<worldbody>", f"<include file='{'b' * 400}'/><worldbody>", "File name too long"),
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_it_is_refused_in_one_line(old: str, new: str, message: str, tmp_path: Path) -> None:
    """Each was a traceback of a library, or passed every check."""
    model = (
        MJCF.replace('<motor joint="FL_hip_joint" gear="2" ctrlrange="-12 12"/>', "") if "<joint axis" in new else MJCF
    )
    assert old in model
    with pytest.raises(StictionError, match=message):
        load_robot(write(tmp_path, model=model.replace(old, new)))


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (urdf().replace("right_knee", "left_knee"), "has no name, or another joint's"),
        (urdf().replace("<link ", '<mujoco><size nuser_geom="1000000000"/></mujoco><link ', 1), "nuser_geom"),
        (urdf().replace("<link ", '<xacro:include xmlns:xacro="x" filename="y"/><link ', 1), "written in xacro"),
        (urdf().replace("</robot>", HAND).replace(BOX, '<geometry><mesh filename="no.stl"/></geometry>'),
         "the outermost link 'left_shank' has no shape, or its mesh was left out"),
        (LOST, "its links weigh 14 kg"),
    ],
    ids=["one name twice", "memory", "xacro", "hands for feet", "a link that nothing carries"],
)  # fmt: skip
def test_a_urdf_is_refused_in_one_line(model: str, message: str, tmp_path: Path) -> None:
    """A robot that stood on its hands for want of a mesh passed as a biped; `<size>` in a URDF filled the memory."""
    with pytest.raises(StictionError, match=message):
        load_robot(write(tmp_path, URDF_SAID, model, "robot.urdf"))


@pytest.mark.parametrize(
    "description",
    ["joints: {.*: {kd: -5}}", "joints: {.*: {damping: -1}}", "joints: {.*: {frictionloss: -1}}",
     "joints: {.*: {action_scale: 0}}", "name: ../../x", "feet: [FL_foot, FL_ball, FR_foot]"],
)  # fmt: skip
def test_what_nothing_has_is_refused(description: str, tmp_path: Path) -> None:
    """A gain of the wrong sign trained for hours; a name of a file leaves its folder."""
    with pytest.raises(StictionError, match="expected"):
        load_robot(write(tmp_path, f"model: robot.xml\n{description}\n"))


@pytest.mark.parametrize(
    ("model", "note"),
    [
        (MJCF.replace(HIP, HIP.replace("-0.9 0.9", "0 0")), "no limits that hold for FL_hip_joint"),
        (MJCF.replace(HIP, HIP + ' stiffness="500"'), "springs at FL_hip_joint; they are not simulated"),
        (MJCF.replace('<body name="FL_hip"', '<body gravcomp="1" name="FL_hip"'), "the weight of FL_hip away"),
        (MJCF.replace("<actuator>", '<tendon><fixed name="t"><joint joint="FL_hip_joint" coef="1"/></fixed></tendon>'
                      "<actuator>"), r"tendons \(t\)"),
        (MJCF.replace('pos="0 0 .4"', 'pos="0 0 .4" quat=".7 0 0 .7"'), "the file has the base turned by 90"),
        (FLAT.replace("<worldbody>", f"<worldbody>{BALL}"), "beside the robot the file has 'ball'"),
        (FLAT.replace("</worldbody>", f"{BALL}</worldbody>"), "beside the robot the file has 'ball'"),
    ],
    ids=["range of zero", "spring", "weightless", "tendon", "turned", "ball before", "ball behind"],
)  # fmt: skip
def test_what_is_not_taken_is_said(model: str, note: str, tmp_path: Path) -> None:
    """The robot is another one without it; that is to be known."""
    derived = load_robot(write(tmp_path, model=model))
    assert derived.robot.mass == pytest.approx(13.8)
    assert any(re.search(note, text) for text in derived.notes)


def test_gains_of_a_geared_position_actuator_are_the_joints(tmp_path: Path) -> None:
    """Its position is gear times the joint's angle, and its force gear times as much there: the square."""
    geared = '<position joint="FL_hip_joint" kp="40" kv="1" gear="3" forcerange="-10 10"/>'
    joint = load_robot(
        write(tmp_path, model=MJCF.replace('<motor joint="FL_hip_joint" gear="2" ctrlrange="-12 12"/>', geared))
    ).robot.joints[0]
    assert (joint.torque_limit, joint.kp, joint.kd) == (30.0, 360.0, 9.0)


def test_a_urdf_keeps_the_names_of_feet_behind_fixed_joints(tmp_path: Path) -> None:
    """MuJoCo would make them one with the shank, and nobody could name them."""
    feet = "".join(
        f'<link name="{side}_foot"><collision><geometry><sphere radius=".03"/></geometry></collision></link>'
        f'<joint name="{side}_ankle" type="fixed"><parent link="{side}_shank"/><child link="{side}_foot"/>'
        '<origin xyz="0 0 -.31"/></joint>'
        for side in ("left", "right")
    )
    description = URDF_SAID + "feet: [left_foot, right_foot]\n"
    robot = load_robot(write(tmp_path, description, urdf().replace("</robot>", feet + "</robot>"), "robot.urdf")).robot
    assert robot.foot_names == ("left_foot", "right_foot") and robot.mass == pytest.approx(12.0)
    assert all(foot.is_ball for foot in robot.feet)


@pytest.mark.parametrize(
    ("description", "check", "words"),
    [
        ("mirror: {FL_hip_joint: RR_hip_joint}", "mirror", "0 joints named 'RR_hip_joint'"),
        ("joints: {.*: {frictionloss: 100}}", "motors", "it never moves"),
        ("feet: [FL_foot, FR_foot, RL_foot, RR_foot]", "size", "are lengths in millimetres"),
    ],
)
def test_the_check_finds(description: str, check: str, words: str, tmp_path: Path) -> None:
    """Each was a note at most, and the robot "can be used"."""
    model = MJCF.replace('pos="0.2 0.05 0"', 'pos="200 50 0"') if check == "size" else MJCF
    findings = check_robot(load_robot(write(tmp_path, f"model: robot.xml\n{description}\n", model)).robot)
    assert [words in one.text for one in findings if one.check == check and one.state == "bad"] == [True]


def test_radians_under_a_compiler_of_degrees_are_found(tmp_path: Path) -> None:
    """Ranges of a hundredth of a radian are none; without a keyframe the pose was inside them."""
    findings = check_robot(load_robot(write(tmp_path, model=FLAT.replace('"radian"', '"degree"'))).robot)
    assert any(one.check == "limits" and "compiler take degrees" in one.text for one in findings)


PLACES = {
    '<joint name="j" axis="0 1 0"/><joint name="k" typo="1"/>': ", line 3: <joint name='k'>",
    '<joint name="j" axis="0 1 0"/><joint name="k" axis="0 x 0"/>': ", line 3: <joint name='k'>",
    '<joint name="j" axis="0 0 0"/>': ", line 3: <joint name='j'>",
    '<joint name="j" class="soft"/>': ", line 3: <joint name='j'>",
    '<joint name="j"/><joint name="k" class="soft"/><joint name="l" class="soft"/>': "",
}


@pytest.mark.parametrize("joints", PLACES)
@pytest.mark.parametrize("scene", [False, True], ids=["alone", "included"])
def test_an_error_of_the_simulator_has_its_place(tmp_path: Path, joints: str, scene: bool) -> None:
    """File, line and element, in an included file too, of which MuJoCo says line 0; where several fit, the file."""
    model = f'<mujoco><worldbody><body name="base"><freejoint/><geom size=".1"/><body>\n\n{joints}<geom size=".1"/>'
    (tmp_path / "robot.xml").write_text(f"{model}</body></body></worldbody></mujoco>")
    (tmp_path / "scene.xml").write_text('<mujoco><include file="robot.xml"/></mujoco>')
    name = "scene.xml" if scene else "robot.xml"
    place = re.escape(f"; see robot.xml{PLACES[joints]}") if scene else "robot.xml.*line 3"
    with pytest.raises(StictionError, match=place):
        load_robot(tmp_path / name)
