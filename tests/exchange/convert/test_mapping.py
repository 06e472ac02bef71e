"""Mapping of records to the joints of a model."""

from __future__ import annotations

from pathlib import Path

import pytest

from motors import motor
from stiction.core.errors import StictionError
from stiction.exchange.physics import Conversion
from stiction.exchange.targets import ConvertOptions, Target, convert
from stiction.files.joint_map import map_joints, parse_joint_map
from stiction.files.joints import JointRecord, JointsFile

MODEL = ["FL_hip_joint", "FL_calf_joint", "FR_calf_joint", "FL_shank"]
FILE = JointsFile({"shank": JointRecord(), "FL_hip": JointRecord()})


def test_pairs_go_first_and_the_rest_is_matched_by_name_or_kind() -> None:
    """`FL_shank` is a shank; the hip needs its pair."""
    mapping = map_joints(FILE, parse_joint_map(["FL_hip=FL_hip_joint"]), MODEL)
    assert mapping == {"FL_hip_joint": "FL_hip", "FL_shank": "shank"}


def test_a_mapped_record_goes_where_it_was_sent_only() -> None:
    """Both calves, by a wildcard; the joint of the record's own kind is left alone."""
    mapping = map_joints(FILE, parse_joint_map(["shank=*_calf_joint", "FL_hip=FL_hip_joint"]), MODEL)
    assert mapping == {"FL_calf_joint": "shank", "FR_calf_joint": "shank", "FL_hip_joint": "FL_hip"}


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        (["shank"], "RECORDED=MODEL"),
        (["=x"], "RECORDED=MODEL"),
        (["knee=FL_shank"], "unknown record 'knee'; known: shank, FL_hip"),
        (["shank=RR_*"], "unknown joint 'RR_*'; known: FL_hip_joint"),
        (["shank=FL_*", "FL_hip=FL_hip_joint"], "mapped to the records 'shank' and 'FL_hip'"),
        (["shank=FL_calf_joint"], "takes the record 'FL_hip'"),
    ],
)
def test_what_does_not_fit_is_refused(pairs: list[str], message: str) -> None:
    """Rejects a record without a joint."""
    with pytest.raises(StictionError, match=message.replace("*", r"\*")):
        map_joints(FILE, parse_joint_map(pairs), MODEL)


RECORDS = JointsFile({"x": motor(inertia=None)})
FIXED = """<robot name="r"><link name="a"/><link name="b"/><link name="c"/>
<joint name="FL_Knee" type="revolute"><parent link="a"/><child link="b"/></joint>
<joint name="FL_Ankle" type="fixed"><parent link="b"/><child link="c"/></joint></robot>"""
BACKLASH = """<mujoco><worldbody><body><joint name="knee"/><geom size=".1"/><body><joint name="play"/><geom size=".1"/>
</body></body><body><joint name="drop" type="free"/><geom size=".1"/></body></worldbody>
<actuator><motor joint="knee"/></actuator></mujoco>"""


def written(tmp_path: Path, name: str, text: str, pair: str) -> Conversion:
    """Convert the record `x` into a model in a file."""
    (tmp_path / name).write_text(text)
    to: Target = "urdf" if name.endswith(".urdf") else "mujoco"
    return convert(RECORDS, ConvertOptions(to=to, model=tmp_path / name, joint_map=(pair,)))


def test_a_pattern_takes_the_joints_that_can_have_friction(tmp_path: Path) -> None:
    """A fixed joint of a URDF is passed over; named in full it is refused by its type."""
    assert written(tmp_path, "r.urdf", FIXED, "x=*").joints == {"FL_Knee": "x"}
    with pytest.raises(StictionError, match=r"'FL_Ankle' is of type fixed"):
        written(tmp_path, "r.urdf", FIXED, "x=FL_Ankle")
    with pytest.raises(StictionError, match="matches FL_Ankle; expected a joint that moves as the record's rotary"):
        written(tmp_path, "r.urdf", FIXED, "x=*Ankle")


def test_a_pattern_leaves_out_what_no_motor_drives(tmp_path: Path) -> None:
    """A pattern leaves out joints without a motor, such as a backlash; a joint named in full takes the record."""
    done = written(tmp_path, "r.xml", BACKLASH, "x=*")
    assert done.joints == {"knee": "x"} and any("no actuator drives them: play" in note for note in done.notes)
    assert written(tmp_path, "r.xml", BACKLASH, "x=play").joints == {"play": "x"}
    bare = BACKLASH[: BACKLASH.index("<actuator>")] + "</mujoco>"
    assert written(tmp_path, "r.xml", bare, "x=*").joints == {"knee": "x", "play": "x"}
    pulled = bare.replace("</mujoco>", '<tendon><fixed name="t"><joint joint="play" coef="1"/></fixed></tendon>'
                          '<actuator><motor tendon="t"/></actuator></mujoco>')  # fmt: skip
    assert written(tmp_path, "r.xml", pulled, "x=*").joints == {"play": "x"}


def test_joints_of_an_included_file_are_pointed_at(tmp_path: Path) -> None:
    """A scene has no joints of its own; an include within an include counts, and one that is not there does not."""
    (tmp_path / "robot.xml").write_text(BACKLASH)
    (tmp_path / "mid.xml").write_text('<mujocoinclude><include file="robot.xml"/></mujocoinclude>')
    with pytest.raises(StictionError, match=r"robot.xml, which has knee, play, drop: give --model .*robot.xml"):
        written(tmp_path, "s.xml", '<mujoco><include file="none.xml"/><include file="mid.xml"/></mujoco>', "x=*")
