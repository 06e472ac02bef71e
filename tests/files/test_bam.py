"""BAM's parameter files become records and come back the same; what a record or BAM cannot hold is refused."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from motors import motor, number
from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.files.bam import bam_of_record, load_all_joints, load_joints, record_of_bam
from stiction.files.joints import ARMATURE, BRAKE, JointsFile

M1 = {"kt": 0.4, "R": 4.0, "armature": 0.002, "q_offset": 0.03, "friction_base": 0.012, "friction_viscous": 0.004}
STRIBECK = {"friction_stribeck": 0.008, "dtheta_stribeck": 2.5, "alpha": 1.4}
SERVOS = {
    "m1": M1,
    "m2": M1 | STRIBECK,
    "m3": M1 | {"load_friction_base": 0.12},
    "m4": M1 | STRIBECK | {"load_friction_base": 0.07, "load_friction_stribeck": 0.05},
}


def servo(model: str, actuator: str = "xl330") -> dict:
    """Return a parameter file of BAM."""
    return SERVOS[model] | {"model": model, "actuator": actuator}


@pytest.mark.parametrize("model", SERVOS)
def test_a_servo_comes_back_as_it_was(model: str, tmp_path: Path) -> None:
    """By way of a joints.json on the disk."""
    name, record = record_of_bam(servo(model), "m.json")
    JointsFile({name: record}).write(tmp_path / "joints.json")
    back = bam_of_record(name, load_joints(tmp_path / "joints.json").joints["xl330"])
    assert back == pytest.approx(servo(model))


def test_numbers_stand_under_their_names() -> None:
    """0.012 + 0.008 N m at rest; BAM's load is twice the motor's torque at rest, c = 2 x 0.07; 0.4**2 / 4 brakes."""
    record = record_of_bam(servo("m4"), "m.json")[1]
    assert record.coulomb_friction and record.coulomb_friction.value == 0.012
    assert record.static_friction and record.static_friction.value == pytest.approx(0.02)
    assert record.stribeck_velocity and record.stribeck_velocity.value == 2.5
    assert record.load_coefficient and record.load_coefficient.value == pytest.approx(0.14)
    assert record.load_regressor == "motor_torque" and record.combinations[ARMATURE].value == 0.002
    assert record.combinations[BRAKE].value == pytest.approx(0.004 + 0.04)
    assert any("no intervals" in text for text in record.warnings)


def test_a_motor_of_ours_becomes_a_file_of_bam() -> None:
    """m1 of a bare motor, m2 with friction at rest: 0.6 less 0.4, and our law's exponent."""
    plain = bam_of_record("hip", motor(torque_limit=45.0))
    assert plain["model"] == "m1" and plain["max_torque"] == 45.0 and plain["armature"] == 0.03
    assert (plain["friction_base"], plain["friction_viscous"]) == (0.4, 0.07)
    law = {"law": "stribeck", "parameters": {"coulomb_friction": number(0.4).to_dict()}}
    record = motor(static_friction=number(0.6), stribeck_velocity=number(0.1), friction_law=law)
    data = bam_of_record("hip", record)
    assert data["model"] == "m2" and data["friction_stribeck"] == pytest.approx(0.2) and data["alpha"] == 2.0


@pytest.mark.parametrize(
    ("record", "message"),
    [
        (motor(test_condition="in_air"), "got no rotor inertia"),
        (motor(viscous_friction=None), "got no viscous friction"),
        (motor(static_friction=number(0.6)), "got friction at rest and no Stribeck velocity"),
        (motor(friction_law={"law": "asymmetric"}), "got the law 'asymmetric'"),
    ],
)
def test_what_bam_cannot_hold_is_refused(record, message: str) -> None:
    """It would take a default of its own in its place."""
    with pytest.raises(StictionError, match=message):
        bam_of_record("hip", record)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"model": "m6"}, "got BAM's model 'm6', which has a load coefficient for each direction"),
        ({"model": "m9"}, "got BAM's model 'm9', expected one of m1, m2, m3, m4"),
        ({"alpha": 0.0}, "got 0 for armature, dtheta_stribeck or alpha"),
        ({"friction_base": -0.1}, "got friction_base -0.1"),
        ({"load_friction_base": "much"}, "got load_friction_base 'much'"),
        ({"actuator": ""}, "got actuator ''"),
        ({"actuator": 3}, "got actuator 3"),
    ],
)
def test_a_file_that_does_not_fit_is_refused(changes: dict, message: str) -> None:
    """One sentence that names the field."""
    with pytest.raises(StictionError, match=message):
        record_of_bam(servo("m4") | changes, "m.json")


def test_servos_become_one_file_and_files_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """As a user types it; two of one name would be one joint."""
    monkeypatch.chdir(tmp_path)
    Path("a.json").write_text(json.dumps(servo("m4")))
    Path("b.json").write_text(json.dumps(servo("m1", "mx64")))
    assert main(["convert", "a.json", "b.json", "--to", "joints", "--out", "joints.json"]) == 0
    assert set(load_joints(Path("joints.json")).joints) == {"xl330", "mx64"}
    assert main(["convert", "joints.json", "--to", "bam", "--out", "back"]) == 0
    assert json.loads(Path("back/xl330.json").read_text()) == pytest.approx(servo("m4"))
    assert main(["convert", "b.json", "--to", "mujoco"]) == 0
    assert 'frictionloss="0.012" armature="0.002"' in capsys.readouterr().out
    assert main(["convert", "joints.json", "--to", "bam"]) == 1
    assert "got 2 joints, a file each; expected --out FOLDER" in capsys.readouterr().err
    mapped = ["--joint-map", "xl330=../xl330", "--out", "back"]
    assert main(["convert", "joints.json", "--to", "bam", *mapped]) == 1
    assert "got no name of a file" in capsys.readouterr().err
    with pytest.raises(StictionError, match="got a second 'xl330'"):
        load_all_joints([Path("a.json"), Path("a.json")])


@pytest.mark.parametrize("more", [[], ["walk"]])
def test_identify_says_what_makes_a_joints_json_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, more: list[str]
) -> None:
    """Names a working command for a file without a log to identify."""
    monkeypatch.chdir(tmp_path)
    Path("m4.json").write_text(json.dumps(servo("m4")))
    options = ["--robot", "go2"] if more else []
    assert main(["identify", *more, "m4.json", *options]) == 1
    told = capsys.readouterr()
    (command,) = re.findall("this is a parameter file of BAM, identified already: `stiction (.*)`\n", told.err)
    assert told.out == "" and main(command.replace("FILE", "m4.json").split()) == 0
    assert set(load_joints(Path("joints.json")).joints) == {"xl330"}


@pytest.mark.parametrize("model", SERVOS)
def test_bam_itself_has_the_friction_of_the_file(model: str) -> None:
    """BAM's own budget at rest and in motion, under no load and under 0.3 N m that the motor holds."""
    models = pytest.importorskip("bam.model", reason="better-actuator-models is not installed")
    name, record = record_of_bam(servo(model), "m.json")
    theirs = models.load_model_from_dict(bam_of_record(name, record))
    law = record.friction_law or {}
    rest = (record.static_friction or record.coulomb_friction).value  # type: ignore[union-attr]
    load = 0.0 if record.load_coefficient is None else record.load_coefficient.value
    at_rest, damping = theirs.compute_frictions(0.0, 0.0, 0.0)
    assert at_rest == pytest.approx(rest) and damping == 0.004
    fast, _ = theirs.compute_frictions(0.3, -0.3, 1e3)
    assert fast == pytest.approx(record.coulomb_friction.value + load * 0.3)  # type: ignore[union-attr]
    slow, _ = theirs.compute_frictions(0.0, 0.0, 2.5)
    assert slow == pytest.approx(0.012 + (np.exp(-1.0) * 0.008 if law["law"] == "stribeck" else 0.0))


def test_every_file_that_bam_ships_comes_back() -> None:
    """m1 to m4 of each servo: BAM's own budget of the file and of its way through a record, at rest, slow and fast, and
    under load; m5 and m6 are refused.
    """
    models = pytest.importorskip("bam.model", reason="better-actuator-models is not installed")
    paths = sorted((Path(models.__file__).parent / "params").glob("*/m*.json"))
    kept = 0
    for path in paths:
        data = json.loads(path.read_text())
        if data["model"] in ("m5", "m6"):
            with pytest.raises(StictionError, match="a load coefficient for each direction"):
                load_joints(path)
            continue
        ((name, record),) = load_joints(path).joints.items()
        back = bam_of_record(name, record)
        ours, theirs = models.load_model_from_dict(back), models.load_model_from_dict(data)
        for motor_torque, external in ((0.0, 0.0), (0.3, -0.3), (0.0, 0.4), (-0.2, 0.1)):
            for speed in (0.0, 0.05, 2.0, -20.0):
                reference = ours.compute_frictions(motor_torque, external, speed)
                assert reference == pytest.approx(theirs.compute_frictions(motor_torque, external, speed)), path
        held = {field: value for field, value in back.items() if field in data}
        assert held == pytest.approx({field: data[field] for field in held}) and held.keys() >= FIELDS_BACK, path
        kept += 1
    assert kept >= 20 and len(paths) > kept


FIELDS_BACK = {"model", "actuator", "armature", "friction_base", "friction_viscous"}
"""Fields of every model that come back."""
