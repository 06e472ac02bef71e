"""The sidecar: what holds for the log, for a kind of joint, and for one joint."""

from __future__ import annotations

from pathlib import Path

import pytest

from stiction.core.errors import LogError
from stiction.formats.log import LogSetup, read_setup, setup_from_dict

WHOLE = {
    "kp": 20,
    "kd": 1.5,
    "torque_limit": 23.7,
    "torque_calibrated": False,
    "payload_mass": 0.5,
    "names": ["FL_hip", "FL_calf", "FR_calf"],
    "joints": {"calf": {"torque_limit": 45.43, "kp": 25}, "FR_calf": {"kp": 30, "motor_strength": 0.9}},
}


def test_a_joint_s_own_fields_go_before_its_kind_s_and_those_before_the_log_s() -> None:
    """What is not said for the joint holds as it does for all."""
    setup = setup_from_dict(WHOLE, "x.json")
    hip, left, right = (setup.of_joint(name) for name in ("FL_hip", "FL_calf", "FR_calf"))
    assert (hip.kp, left.kp, right.kp) == (20, 25, 30)
    assert (hip.torque_limit, left.torque_limit, right.torque_limit) == (23.7, 45.43, 45.43)
    assert right.motor_strength == 0.9 and left.motor_strength is None and right.torque_calibrated is False
    assert right.payload_mass == 0.5 and right.joints == {}


def test_what_is_written_is_read_again() -> None:
    """Nothing is lost, and nothing that was not said is written."""
    setup = setup_from_dict(WHOLE, "x.json")
    assert setup.to_dict() == WHOLE
    assert setup_from_dict(setup.to_dict(), "x.json") == setup
    assert LogSetup().to_dict() == {}


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"torque_calibrated": 1}, "torque_calibrated is '1'; expected true or false"),
        ({"delay": "2ms"}, "delay is '2ms'; expected a number"),
        ({"payload_angle": True}, "payload_angle is 'True'; expected a number"),
        ({"kp": float("inf")}, "expected a number"),
        ({"kp": 10**400}, "expected a number of a physical size"),
        ({"names": "a"}, "expected a list of joint names"),
        ({"names": ["a", "a"]}, "has 'a' twice"),
        ({"joints": []}, "expected an object"),
        ({"joints": {"calf": 3}}, "x.json: joint 'calf': expected an object"),
        ({"joints": {"calf": {"kP": 3}}}, "x.json: joint 'calf': expected an object with some of the fields kp"),
        ({"joints": {"calf": {"rate": 3}}}, "joint 'calf'.*got"),
        ({"joints": {"calf": {"axis": "bent"}}}, "joint 'calf': axis is 'bent'; expected one of rotary, linear"),
        ({"axis": {}}, "expected one of rotary"),
    ],
)
def test_a_bad_field_is_named(data: dict, said: str) -> None:
    """A misspelt field that is ignored would silently cost what it was meant for."""
    with pytest.raises(LogError, match=said):
        setup_from_dict(data, "x.json")


def test_a_sidecar_of_megabytes_is_refused(tmp_path: Path) -> None:
    """That is no sidecar."""
    (tmp_path / "x.json").write_text(" " * (2**20 + 1))
    with pytest.raises(LogError, match="over 1048576 bytes"):
        read_setup(tmp_path / "x.csv")
