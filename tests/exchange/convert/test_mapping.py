"""Which record each joint of a model takes."""

from __future__ import annotations

import pytest

from stiction.core.errors import StictionError
from stiction.files.joint_map import map_joints, parse_joint_map
from stiction.files.joints import JointRecord, JointsFile

MODEL = ["FL_hip_joint", "FL_calf_joint", "FR_calf_joint", "FL_shank"]
FILE = JointsFile({"shank": JointRecord(), "FL_hip": JointRecord()})


def test_pairs_go_first_and_the_rest_is_matched_by_name_or_kind() -> None:
    """`FL_shank` is a shank; the hip needs its pair."""
    found = map_joints(FILE, parse_joint_map(["FL_hip=FL_hip_joint"]), MODEL)
    assert found == {"FL_hip_joint": "FL_hip", "FL_shank": "shank"}


def test_a_mapped_record_goes_where_it_was_sent_only() -> None:
    """Both calves, by a wildcard; the joint of the record's own kind is left alone."""
    found = map_joints(FILE, parse_joint_map(["shank=*_calf_joint", "FL_hip=FL_hip_joint"]), MODEL)
    assert found == {"FL_calf_joint": "shank", "FR_calf_joint": "shank", "FL_hip_joint": "FL_hip"}


@pytest.mark.parametrize(
    ("pairs", "said"),
    [
        (["shank"], "RECORDED=MODEL"),
        (["=x"], "RECORDED=MODEL"),
        (["knee=FL_shank"], "unknown record 'knee'; known: shank, FL_hip"),
        (["shank=RR_*"], "unknown joint 'RR_*'; known: FL_hip_joint"),
        (["shank=FL_*", "FL_hip=FL_hip_joint"], "mapped to the records 'shank' and 'FL_hip'"),
        (["shank=FL_calf_joint"], "takes the record 'FL_hip'"),
    ],
)
def test_what_does_not_fit_is_refused(pairs: list[str], said: str) -> None:
    """A record that went nowhere would be friction lost without a word."""
    with pytest.raises(StictionError, match=said.replace("*", r"\*")):
        map_joints(FILE, parse_joint_map(pairs), MODEL)
