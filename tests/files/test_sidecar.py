"""The sidecar: what holds for the log, for a kind of joint, and for one joint."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest

from stiction.core.errors import LogError
from stiction.files.log import LogSetup, setup_from_dict
from stiction.identification.setup import IdentifySetup

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
    """Takes settings of the joint, then of its kind, then of the whole log."""
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
    ("data", "message"),
    [
        ({"torque_calibrated": 1}, "torque_calibrated is '1'; expected true or false"),
        ({"delay": "2ms"}, "delay is 2ms; expected a finite number"),
        ({"names": ["a", "a"]}, "has 'a' twice"),
        ({"joints": {"calf": 3}}, "x.json: joint 'calf': expected an object"),
        ({"kp": 20, "torque_limt": 3}, "x.json: unknown field 'torque_limt'; did you mean 'torque_limit'"),
        ({"begin": 3}, "x.json: unknown field 'begin': write 'from'"),
        ({"joints": {"calf": {"from": 3}}}, "x.json: joint 'calf': from is of the whole log"),
    ],
)
def test_a_bad_field_is_named(data: dict, message: str) -> None:
    """A misspelt field that is ignored would silently cost what it was meant for."""
    with pytest.raises(LogError, match=message):
        setup_from_dict(data, "x.json")


def test_every_flag_of_a_joint_has_its_field(tmp_path: Path) -> None:
    """An arm in amperes is one run, not six: what can be said on the command line can be said of each joint."""
    flags = {item.name for item in fields(IdentifySetup)}
    assert flags <= {item.name for item in fields(LogSetup)}
    own = {
        **{"torque_scale": -0.12, "disturbance_scale": 35.1, "position_scale": 0.0174533, "velocity_delay": 0.001},
        **{
            "hanging_angle": 0.3,
            "gravity": True,
            "cutoff": 20.0,
            "unknowns": ["encoder_bias"],
            "torque_source": "motor_side",
        },
    }
    setup = setup_from_dict({"torque_scale": 2.0, "gravity": False, "joints": {"wrist": own}}, "x.json")
    assert setup_from_dict(setup.to_dict(), "x.json") == setup
    wrist = IdentifySetup().with_sidecar(setup.of_joint("wrist"))
    for name, value in own.items():
        assert getattr(wrist, name) == (tuple(value) if isinstance(value, list) else value)
    elbow = IdentifySetup(cutoff=5.0).with_sidecar(setup.of_joint("elbow"))
    assert (elbow.torque_scale, elbow.gravity, elbow.cutoff, elbow.unknowns) == (2.0, False, 5.0, ())
    assert IdentifySetup(torque_scale=1.0).with_sidecar(setup.of_joint("wrist")).torque_scale == 1.0
