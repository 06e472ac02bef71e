"""Robots' files as strangers write them: what was a traceback, a hang or another robot is right, or one line."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from robot_files import MJCF, URDF_LEG, urdf, write
from stiction.core.errors import StictionError
from stiction.robots.catalog import find_robot
from stiction.robots.check import check_robot
from stiction.robots.compare import check_against
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
        ('"FL_hip"', '"base"', "the link 'base' has a name that something else has"),
        ('"FL_hip_joint"', '"root"', "the joint 'root' has a name"),
        ('"FL_foot"', '"floor"', "the foot 'floor' has a name"),
        ('"FL_foot"', '"FR"', "the foot 'FR' has a name"),
        (HIP, HIP.replace("-0.9", "-inf"), "'FL_hip_joint' has a number that is none"),
        (HIP, HIP.replace("-0.9", "-1e308"), "the joint 'FL_hip_joint' has numbers that no robot has"),
        ('pos="0.2 0.05 0"', 'pos="1e308 0.05 0"', "the body 'FL_hip' has numbers"),
        ('mass="6"', 'mass="1e308"', "the body 'trunk' has numbers"),
        ('gear="2"', 'gear="1e308"', "torque_limit of joint 'FL_hip_joint' is inf"),
        ("0 .8 -1.5 ", "0 .8 nan ", "the keyframe 'home' has numbers"),
        ("0 0 .33 1 0 0 0", "0 0 .33 1 0 0", "the keyframe 'home' has 18 positions, the model 19"),
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
    "said",
    ["joints: {.*: {kd: -5}}", "joints: {.*: {damping: -1}}", "joints: {.*: {frictionloss: -1}}",
     "joints: {.*: {action_scale: 0}}", "name: ../../x", "feet: [FL_foot, FL_ball, FR_foot]"],
)  # fmt: skip
def test_what_nothing_has_is_refused(said: str, tmp_path: Path) -> None:
    """A gain of the wrong sign trained for hours; a name of a file leaves its folder."""
    with pytest.raises(StictionError, match="expected"):
        load_robot(write(tmp_path, f"model: robot.xml\n{said}\n"))


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


def test_a_keyframe_of_a_base_that_is_fixed_stands_as_it_says(tmp_path: Path) -> None:
    """MuJoCo fills its end with zeros, and each joint stood at the angle of the one seven places further on."""
    model = MJCF.replace("<freejoint/>", "").replace("0 0 .33 1 0 0 0 ", "")
    standing = load_robot(write(tmp_path, model=model)).robot.joint_values("default_position")
    assert standing.tolist() == [0.0, 0.8, -1.5] * 4


def test_gains_of_a_geared_position_actuator_are_the_joints(tmp_path: Path) -> None:
    """Its position is gear times the joint's angle, and its force gear times as much there: the square."""
    geared = '<position joint="FL_hip_joint" kp="40" kv="1" gear="3" forcerange="-10 10"/>'
    joint = load_robot(
        write(tmp_path, model=MJCF.replace('<motor joint="FL_hip_joint" gear="2" ctrlrange="-12 12"/>', geared))
    ).robot.joints[0]
    assert (joint.torque_limit, joint.kp, joint.kd) == (30.0, 360.0, 9.0)


def test_bodies_without_names_are_called_by_their_joints(tmp_path: Path) -> None:
    """MJCF needs no names of bodies; links without one had the same one."""
    robot = load_robot(write(tmp_path, model=re.sub(r"<body name=\"[^\"]*\"", "<body", MJCF))).robot
    assert robot.foot_names == tuple(f"{leg}_calf_joint" for leg in ("FL", "FR", "RL", "RR"))


def test_a_mesh_that_is_only_seen_may_be_broken(tmp_path: Path) -> None:
    """An STL written as text is common; a body that has its mass from it is refused."""
    (tmp_path / "m.stl").write_text("solid m\nendsolid m\n" + " " * 200)
    seen = MJCF.replace("<worldbody>", '<asset><mesh name="m" file="m.stl"/></asset><worldbody>')
    seen = seen.replace('<geom name="hull"', '<geom class="seen" type="mesh" mesh="m"/><geom name="hull"')
    derived = load_robot(write(tmp_path, model=seen))
    assert any("the mesh 'm.stl' cannot be decoded" in note for note in derived.notes)
    with pytest.raises(StictionError, match="'trunk' has its mass from it"):
        load_robot(
            write(tmp_path, model=seen.replace('<inertial pos="0 0 0" mass="6" diaginertia=".02 .07 .08"/>', ""))
        )


def test_a_mesh_is_rather_that_of_its_own_package(tmp_path: Path) -> None:
    """Beside it lies a cat with a foot of the same name; which file was taken is said."""
    from test_load import tetrahedron

    for animal in ("cat", "dog"):
        (tmp_path / "all" / animal / "meshes").mkdir(parents=True)
    tetrahedron(tmp_path / "all" / "dog" / "meshes" / "foot.stl")
    (tmp_path / "all" / "cat" / "meshes" / "foot.stl").write_bytes(b"cat")
    mesh = '<geometry><mesh filename="package://dog/meshes/foot.stl"/></geometry>'
    derived = load_robot(write(tmp_path, URDF_SAID, urdf().replace(BOX, mesh), "robot.urdf"))
    assert any("'foot.stl'" not in note and "dog/meshes/foot.stl' is taken" in note for note in derived.notes)


def test_a_urdf_keeps_the_names_of_feet_behind_fixed_joints(tmp_path: Path) -> None:
    """MuJoCo would make them one with the shank, and nobody could name them."""
    feet = "".join(
        f'<link name="{side}_foot"><collision><geometry><sphere radius=".03"/></geometry></collision></link>'
        f'<joint name="{side}_ankle" type="fixed"><parent link="{side}_shank"/><child link="{side}_foot"/>'
        '<origin xyz="0 0 -.31"/></joint>'
        for side in ("left", "right")
    )
    said = URDF_SAID + "feet: [left_foot, right_foot]\n"
    robot = load_robot(write(tmp_path, said, urdf().replace("</robot>", feet + "</robot>"), "robot.urdf")).robot
    assert robot.foot_names == ("left_foot", "right_foot") and robot.mass == pytest.approx(12.0)
    assert all(foot.is_ball for foot in robot.feet)


def test_a_urdf_is_one_whatever_its_file_is_called(tmp_path: Path) -> None:
    """As `.xml` its mass was not checked, and links without one had that of their shapes; capitals are no module."""
    said = "model: ROBOT.XML\njoints: {.*: {armature: 0.02}}\n"
    with pytest.raises(StictionError, match="its links weigh 14 kg"):
        load_robot(write(tmp_path, said, LOST, "ROBOT.XML"))
    (tmp_path / "DOG.XML").write_text(MJCF)
    assert find_robot(str(tmp_path / "DOG.XML")).num_joints == 12


def test_a_path_may_have_an_at(tmp_path: Path) -> None:
    """It was taken for a variation, and the folder's first half for the robot; and a folder is no module."""
    (tmp_path / "me@work").mkdir()
    path = write(tmp_path / "me@work")
    plain, varied = find_robot(str(path)), find_robot(f"{path}@kp=2")
    np.testing.assert_allclose(varied.joint_values("kp"), 2 * plain.joint_values("kp"))
    with pytest.raises(StictionError, match="is a folder; name the"):
        find_robot(str(tmp_path))


def test_a_function_of_ones_own_says_what_was_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its notes were lost, its own error was said to be a fault of stiction. And a folder hides no shipped robot."""
    from stiction.robots.catalog import find_derived

    (tmp_path / "go1").mkdir()
    (tmp_path / "robot.xml").write_text(MJCF)
    (tmp_path / "own_strange_robot.py").write_text(
        "import mujoco\ndef make():\n    return mujoco.MjSpec.from_file('robot.xml')\n"
        "def fail():\n    raise KeyError('leg')\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert any("claims frictionloss" in note for note in find_derived("own_strange_robot:make").notes)
    with pytest.raises(StictionError, match="its function fails: KeyError: 'leg'"):
        find_derived("own_strange_robot:fail")
    assert find_robot("go1").num_joints == 12


@pytest.mark.parametrize(
    ("said", "check", "words"),
    [
        ("mirror: {FL_hip_joint: RR_hip_joint}", "mirror", "0 joints named 'RR_hip_joint'"),
        ("joints: {.*: {frictionloss: 100}}", "motors", "it never moves"),
        ("feet: [FL_foot, FR_foot, RL_foot, RR_foot]", "size", "are lengths in millimetres"),
    ],
)
def test_the_check_finds(said: str, check: str, words: str, tmp_path: Path) -> None:
    """Each was a note at most, and the robot "can be used"."""
    model = MJCF.replace('pos="0.2 0.05 0"', 'pos="200 50 0"') if check == "size" else MJCF
    findings = check_robot(load_robot(write(tmp_path, f"model: robot.xml\n{said}\n", model)).robot)
    assert [words in one.text for one in findings if one.check == check and one.state == "bad"] == [True]


def test_radians_under_a_compiler_of_degrees_are_found(tmp_path: Path) -> None:
    """Ranges of a hundredth of a radian are none; without a keyframe the pose was inside them."""
    findings = check_robot(load_robot(write(tmp_path, model=FLAT.replace('"radian"', '"degree"'))).robot)
    assert any(one.check == "limits" and "compiler take degrees" in one.text for one in findings)


def test_an_order_that_differs_further_on_is_named(tmp_path: Path) -> None:
    """Wired by number, the second leg would be the third; the first joint alone was looked at."""
    robot = load_robot(write(tmp_path)).robot
    start, end = MJCF.index('<body name="FR_hip"'), MJCF.index('<body name="RL_hip"')
    after = MJCF.index('<body name="RR_hip"')
    other = MJCF[:start] + MJCF[end:after] + MJCF[start:end] + MJCF[after:]
    with pytest.raises(StictionError, match="its joint 4 is 'RL_hip_joint', the policy's 'FR_hip_joint'"):
        check_against(robot, write(tmp_path, model=other).with_name("robot.xml"))


def test_a_model_is_compared_in_the_frame_that_its_yaml_names(tmp_path: Path) -> None:
    """Every joint of a robot with `base:` was somewhere else; names with dots and dashes had no pose."""
    mount = '<body name="mount" pos=".1 0 .05"><geom size=".01" contype="0" conaffinity="0" mass=".01"/></body>'
    model = MJCF.replace("<freejoint/>", "<freejoint/>" + mount).replace("FL_calf_joint", "FL.calf-joint")
    path = write(tmp_path, "model: robot.xml\nbase: mount\n", model)
    robot = load_robot(path).robot
    assert check_against(robot, path) == 12
    with pytest.raises(StictionError, match="is at"):
        check_against(robot, tmp_path / "robot.xml")


def test_the_complete_yaml_of_a_robot_that_holds_joints_is_read_again(tmp_path: Path) -> None:
    """Of what is rigid the model has no joint; a line for it was a name that there is not."""
    from stiction.robots.description import complete_text
    from stiction.robots.mjcf import build

    robot = find_robot("g1")
    text = complete_text(robot, "simulated.xml")
    (tmp_path / "simulated.xml").write_text(build(robot).to_xml())
    (tmp_path / "complete.yaml").write_text(text)
    again = load_robot(tmp_path / "complete.yaml").robot
    assert again.joint_names == robot.joint_names and again.mass == pytest.approx(robot.mass, rel=1e-5)
    assert text.startswith("# held:") and robot.held[0].name in text


def test_a_folder_is_called_one(tmp_path: Path) -> None:
    """It was said not to be there."""
    (tmp_path / "dir.yaml").mkdir()
    with pytest.raises(StictionError, match=r"dir\.yaml' is a folder; name the robot\.yaml"):
        find_robot(str(tmp_path / "dir.yaml"))


@pytest.mark.parametrize(("said", "what"), [("", "the file is empty"), ("joints:\n", "joints is empty")])
def test_what_is_empty_is_called_so(said: str, what: str, tmp_path: Path) -> None:
    """If this failed, a message would name a type of Python's."""
    (tmp_path / "robot.yaml").write_text(said and f"model: robot.xml\n{said}")
    with pytest.raises(StictionError, match=f"robot.yaml: {what}; expected names with values"):
        load_robot(tmp_path / "robot.yaml")
