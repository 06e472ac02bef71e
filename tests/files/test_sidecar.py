"""The sidecar: what holds for the log, for a kind of joint, and for one joint."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest

from stiction.core.errors import LogError
from stiction.files.log import LogSetup, read_setup, setup_from_dict
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
        ({"delay": "2ms"}, "delay is 2ms; expected a finite number"),
        ({"payload_angle": True}, "payload_angle is True; expected a finite number"),
        ({"kp": float("inf")}, "expected a finite number"),
        ({"kp": 10**400}, "kp is a huge integer; expected a finite number"),
        ({"names": "a"}, "names is a; expected a list"),
        ({"names": ["a", "a"]}, "has 'a' twice"),
        ({"joints": []}, "expected an object"),
        ({"joints": {"calf": 3}}, "x.json: joint 'calf': expected an object"),
        ({"kp": 20, "torque_limt": 3}, "x.json: unknown field 'torque_limt'; did you mean 'torque_limit'"),
        ({"fron": 3}, "x.json: unknown field 'fron'; did you mean 'from'"),
        ({"begin": 3}, "x.json: unknown field 'begin': write 'from'"),
        ({"joints": {"calf": {"kP": 3}}}, "x.json: joint 'calf': unknown field 'kP'; did you mean 'kp'. known: kp, kd"),
        ({"joints": {"calf": {"from": 3}}}, "x.json: joint 'calf': from is of the whole log"),
        ({"axis": {}}, "expected rotary, linear"),
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


def test_every_flag_of_a_joint_has_its_field(tmp_path: Path) -> None:
    """An arm in amperes is one run, not six: what can be said on the command line can be said of each joint."""
    flags = {item.name for item in fields(IdentifySetup)}
    assert flags <= {item.name for item in fields(LogSetup)}
    own = {
        **{"torque_scale": -0.12, "disturbance_scale": 35.1, "position_scale": 0.0174533, "velocity_delay": 0.001},
        **{"hanging_angle": 0.3, "gravity": True, "cutoff": 20.0, "unknowns": ["delay"], "torque_source": "motor_side"},
    }
    setup = setup_from_dict({"torque_scale": 2.0, "gravity": False, "joints": {"wrist": own}}, "x.json")
    assert setup_from_dict(setup.to_dict(), "x.json") == setup
    wrist = IdentifySetup().with_sidecar(setup.of_joint("wrist"))
    for name, value in own.items():
        assert getattr(wrist, name) == (tuple(value) if isinstance(value, list) else value)
    elbow = IdentifySetup(cutoff=5.0).with_sidecar(setup.of_joint("elbow"))
    assert (elbow.torque_scale, elbow.gravity, elbow.cutoff, elbow.unknowns) == (2.0, False, 5.0, ())
    assert IdentifySetup(torque_scale=1.0).with_sidecar(setup.of_joint("wrist")).torque_scale == 1.0


def test_what_holds_for_the_file_is_said_once(tmp_path: Path) -> None:
    """Columns, the unit of time and the part to use; no joint has its own."""
    data = {"columns": {"position": "q_{joint}"}, "time_scale": 1e-3, "from": 1.0, "to": 2.5, "rate": 100.0}
    setup = setup_from_dict(data, "x.json")
    assert (setup.begin, setup.end, dict(setup.columns)) == (1.0, 2.5, data["columns"])
    assert setup.to_dict() == data
    for wrong, said in (
        ({"columns": ["q"]}, "expected an object"),
        ({"columns": {"position": 3}}, "columns: position is '3'; expected text"),
        ({"unknowns": ["dealy"]}, "did you mean 'delay'"),
        ({"gravity": 1}, "gravity is '1'; expected true or false"),
        ({"names": [f"j{i}" for i in range(300)]}, "names has 300 entries; expected at most 256"),
    ):
        with pytest.raises(LogError, match=said):
            setup_from_dict(wrong, "x.json")
