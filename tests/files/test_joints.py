"""`joints.json`: what is written is read, what is wrong is named, joints are found by name or kind."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from stiction.core.errors import FileError
from stiction.files.bam import load_joints
from stiction.files.joints import SCHEMA_VERSION, Estimate, Finding, JointRecord, JointsFile, warning

FRICTION = Estimate(0.442, 0.01, (0.42, 0.464))
RECORD = JointRecord(
    inertia=Estimate(0.0145, 1e-4, (0.0143, 0.0147)),
    viscous_friction=Estimate(-0.001, 0.002, (-0.005, 0.003)),
    coulomb_friction=FRICTION,
    offset=Estimate(-0.05, 0.001, (-0.052, -0.048)),
    friction_ratio=FRICTION.scaled(1 / 45),
    combinations={"viscous_friction + kd": Estimate(0.57, 0.01, (0.55, 0.59))},
    test_condition="bare_motor",
    kp=20.0,
    diagnostics={"blocks": 30},
    findings=(warning("", "something"),),
)


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    """Nothing of a record may be lost on the way to training."""
    written = JointsFile({"shank": RECORD, "FL_shank": JointRecord()})
    written.write(tmp_path / "joints.json")
    assert load_joints(tmp_path / "joints.json") == written


def test_findings_keep_their_severity_in_a_file() -> None:
    """An error is an objection and leads the warnings; a note is read again as a warning, an objection as an error."""
    error = Finding("units", "the position covers 57 rad", "run again with --position-scale")
    record = JointRecord(findings=(error, warning("kp", "no kp"), Finding("reading", "2 rows cut", severity="note")))
    data = record.to_dict()
    assert data["objections"] == [{"reason": "units", "seen": error.seen, "remedy": error.remedy}]
    assert data["warnings"] == ["the position covers 57 rad", "no kp", "2 rows cut"] and "findings" not in data
    read = JointRecord.from_dict(data, "x")
    assert read.findings == (error, warning("", "no kp"), warning("", "2 rows cut")) and read.to_dict() == data
    # Whatever else a file says of it, what stands among its objections makes the fit invalid.
    data["objections"][0]["severity"] = "note"
    assert JointRecord.from_dict(data, "x").objection_to("inertia") == error


def test_the_file_has_the_names_of_the_contract(tmp_path: Path) -> None:
    """Other programs read these names; changing one breaks them without a word."""
    JointsFile({"shank": RECORD}).write(tmp_path / "joints.json")
    data = json.loads((tmp_path / "joints.json").read_text())
    assert data["schema_version"] == SCHEMA_VERSION == 1
    assert data["warnings"] == ["shank: something"]
    shank = data["joints"]["shank"]
    assert shank["coulomb_friction"] == {"value": 0.442, "std": 0.01, "interval95": [0.42, 0.464]}
    names = {"inertia", "viscous_friction", "coulomb_friction", "offset", "static_friction", "stribeck_velocity"}
    names |= {"gravity_sin", "gravity_cos", "motor_strength", "encoder_bias", "delay"}
    names |= {"load_coefficient", "friction_ratio", "dead_band", "combinations", "friction_law", "axis"}
    names |= {"test_condition", "torque_source", "kp", "kd", "torque_limit", "diagnostics", "warnings"}
    names |= {"objections", "dynamic_ratio"}
    assert set(shank) == names
    assert shank["dead_band"] is None
    walking = replace(RECORD, kp=6.0, walking_kp=40.0)
    assert set(walking.to_dict()) == names | {"walking_kp"}
    assert (
        JointRecord.from_dict(walking.to_dict(), "x").used_kp == 40.0
        and replace(walking, walking_kp=None).used_kp == 6.0
    )
    for wrong in (-1.0, "x", [1.0]):
        with pytest.raises(FileError, match="walking_kp"):
            JointRecord.from_dict(walking.to_dict() | {"walking_kp": wrong}, "x")


def test_nominal_finds_by_name_then_by_kind_and_has_no_negative_friction() -> None:
    """`FL_shank` takes its own record if there is one, else that of `shank`; a simulator gets no negative damping."""
    own = JointRecord(inertia=Estimate(1.0, 0.1, (0.8, 1.2)))
    joints = JointsFile({"shank": RECORD, "FL_shank": own})
    assert joints.nominal(["FL_shank", "FR_shank"], "inertia") == (1.0, 0.0145)
    assert joints.nominal(["FR_shank"], "viscous_friction") == (0.0,)
    assert joints.nominal(["FR_shank"], "offset") == (-0.05,)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"inertia": {"value": 1, "std": 1}}, "shank: inertia"),
        ({"inertia": {"value": 3, "std": 1, "interval95": [0, 2]}}, "value within"),
        ({"inertia": {"value": 1e999, "std": 1, "interval95": [0, 2]}}, "not a JSON number"),
        ({"innertia": None}, "no field 'innertia'; did you mean 'inertia'?"),
        ({"test_condition": "wet"}, "bare_motor"),
        ({"friction_law": 1}, "friction_law"),
    ],
)
def test_a_wrong_field_is_named(tmp_path: Path, change: dict, message: str) -> None:
    """The user learns which field of which joint is wrong."""
    path = tmp_path / "joints.json"
    path.write_text(json.dumps({"schema_version": 1, "joints": {"shank": change}}))
    with pytest.raises(FileError) as caught:
        load_joints(path)
    assert message in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"schema_version": 2, "joints": {}}', '{"schema_version": 1}'])
def test_other_files_are_refused(tmp_path: Path, text: str) -> None:
    """A file of another kind or of a later schema must not be half understood."""
    path = tmp_path / "joints.json"
    path.write_text(text)
    with pytest.raises(FileError):
        load_joints(path)
    with pytest.raises(FileError, match="cannot read"):
        load_joints(tmp_path / "none.json")


def test_a_proposal_for_training_is_not_taken_for_joints(tmp_path: Path) -> None:
    """The two files lie side by side and are easily mixed up."""
    (tmp_path / "training.json").write_text('{"schema_version": 1, "friction": null, "joints": {}}')
    with pytest.raises(FileError, match=r"expected the joints.json in the same folder"):
        load_joints(tmp_path / "training.json")
