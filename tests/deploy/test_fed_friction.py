"""Friction that a robot is fed forward: its line, its report, and each file that is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bundles import make_contract
from stiction.core.errors import FileError
from stiction.deploy.fed_friction import read_fed_friction
from stiction.files.joints import FRICTION_REACHES_ZERO, Estimate, Finding, JointRecord, JointsFile
from stiction.files.plain import write_object

CONTRACT = make_contract()
"""Hips and thighs of 25 N m, shanks of 45 N m."""


def joint(friction: float, **fields: Any) -> JointRecord:
    """Return a record with dry friction [N m]."""
    return JointRecord(coulomb_friction=Estimate(friction, 0.1, (friction - 0.2, friction + 0.2)), **fields)


def read(folder: Path, **changed: JointRecord):
    """Return the friction of a file with a record of each kind, and of the joints that are changed."""
    records = {"hip": joint(2.0), "thigh": joint(2.5, torque_limit=25.2), "shank": joint(4.0)} | changed
    write_object(folder / "joints.json", JointsFile(records).to_dict())
    return read_fed_friction(folder / "joints.json", CONTRACT)


def loaded(friction: float, load: float) -> JointRecord:
    """Return a record with friction without load [N m], and a coefficient of load [1]."""
    return joint(
        friction,
        load_coefficient=Estimate(load, 0.01, (load, load)),
        friction_law={"coulomb_friction": Estimate(friction, 0.1, (friction, friction)).to_dict()},
    )


def test_friction_is_told_by_kind_from_least_to_most_and_reported_by_joint(tmp_path: Path) -> None:
    """FL_hip has 2.2 N m, the other hips 2; thighs also 0.1 times the torque."""
    fed = read(tmp_path, FL_hip=joint(2.2), thigh=loaded(2.5, 0.1))
    kinds = "hip 2 to 2.2, thigh 2.5, shank 4 N m, and of at most 0.1 times the torque"
    assert fed.sentence(CONTRACT.kinds) == f"friction fed forward: 75 % of {kinds}"
    report = fed.summary()
    assert (report["way"], report["share"]) == ("measured", 0.75)
    assert list(report["friction"].values())[:4] == [2.2, 2.5, 4.0, 2.0] and report["load"]["FL_thigh"] == 0.1
    # In motion, under 10 N m: 0.75 (2.5 + 0.1 10).
    still, moving = np.zeros(CONTRACT.num_joints), np.ones(CONTRACT.num_joints)
    torque = fed.controller(0.002).torque(still, still, moving, 10.0 * moving)
    np.testing.assert_allclose(torque[:4], [1.65, 2.625, 3.0, 1.5])


REFUSED: dict[str, tuple[JointRecord, str]] = {
    "far too much": (joint(1000.0), r"got dry friction of 1e\+03 N m at full torque, expected at most 11.2 N m, 45 %"),
    "too much": (joint(11.3), "got dry friction of 11.3 N m at full torque"),
    "too much under load": (loaded(5.0, 0.3), "got dry friction of 12.5 N m at full torque"),
    "negative": (joint(-0.5), "got dry friction of -0.5 N m, expected none that is negative"),
    "another motor": (
        joint(2.0, torque_limit=23.5),
        "got a torque limit of 23.5 N m, expected 25 N m as in the bundle",
    ),
    "linear axis": (joint(2.0, axis="linear"), "got a linear axis"),
    "not identified": (JointRecord(), "coulomb_friction of joint 'FL_hip' is null"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_friction_of_another_robot_or_too_much_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    """Names the joint, what came and what was expected."""
    record, message = REFUSED[name]
    with pytest.raises(FileError, match=message) as caught:
        read(tmp_path, FL_hip=record)
    assert "FL_hip" in str(caught.value) and "\n" not in str(caught.value)


def test_friction_that_reaches_zero_is_fed_as_zero(tmp_path: Path) -> None:
    """An estimate of -0.01 N m that identification itself calls negligible is none of another robot."""
    negligible = Estimate(0.0, 0.001, (-0.002, 0.002))
    finding = Finding(FRICTION_REACHES_ZERO, "friction reaches zero")
    assert read(tmp_path, hip=joint(-0.01, friction_ratio=negligible, findings=(finding,))).friction["FL_hip"] == 0.0
    assert read(tmp_path, FL_hip=joint(11.2)).friction["FL_hip"] == 11.2
