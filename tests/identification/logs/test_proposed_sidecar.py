"""`stiction identify --init`: a sidecar that can be read as it is, with guesses and their reasons."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stiction.cli.main import main
from stiction.core.errors import ConfigurationError, FileError
from stiction.files.log import LogSetup, read_setup, write_log
from stiction.identification.example import example_log
from stiction.identification.logs import open_log
from stiction.identification.logs.sidecar import propose, write_sidecar
from stiction.identification.runs import make_run
from stiction.identification.setup import IdentifySetup

COUNT = 400


def table(folder: Path, names: str, *columns: np.ndarray) -> Path:
    """Write a CSV."""
    path = folder / "log.csv"
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=names, comments="", fmt="%.9g")
    return path


def test_what_is_guessed_can_be_read_and_is_said(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Columns by their names, gains by the torque, a limit by where the torque stops."""
    time = 0.002 * np.arange(COUNT)
    position = np.sin(9 * time)
    target, velocity = position + 0.2 * np.cos(5 * time), 9 * np.cos(9 * time)
    torque = np.clip(20 * (target - position) - 0.5 * velocity, -5.0, 5.0)
    path = table(tmp_path, "stamp,q,q_des,tau,dq", time, position, target, torque, velocity)
    assert main(["identify", str(path), "--init"]) == 0
    output = capsys.readouterr().out
    data = json.loads((tmp_path / "log.json").read_text())
    assert data["columns"] == {"time": "stamp", "position": "q", "target": "q_des", "torque": "tau", "velocity": "dq"}
    assert data["torque_limit"] == 5.0 and "torque_limit of joint" in output
    assert data["kp"] is None and data["test_condition"] is None
    log = open_log(path)
    assert list(log.joints) == ["joint"] and log.setup.torque_limit == 5.0 and log.setup.kp is None
    with pytest.raises(FileError, match="is there already"):
        write_sidecar(path)


def test_currents_degrees_and_numbered_joints(tmp_path: Path) -> None:
    """A current is not calibrated, hundreds are degrees, joint_0 wants a name."""
    wave = 90 * np.sin(np.arange(COUNT) / 20)
    path = table(tmp_path, "time,pos1,pos2,current1,current2", 0.002 * np.arange(COUNT), wave, wave, wave, wave)
    data, notes = propose(path)
    assert data["torque_calibrated"] is False and data["position_scale"] == 0.0174533
    assert data["names"] == ["joint_1", "joint_2"] and data["columns"]["position"] == "pos{joint}"
    assert set(data["joints"]) == {"joint_1", "joint_2"} and len(notes) == 4, notes
    path.with_suffix(".json").write_text(json.dumps(data))
    assert read_setup(path).of_joint("joint_2").position_scale == 0.0174533


def test_a_servo_s_duty_is_no_torque(tmp_path: Path) -> None:
    """A column called pwm is proposed as a duty, without gains; the supply voltage is asked for."""
    time = 0.002 * np.arange(COUNT)
    wave = np.sin(9 * time)
    path = table(tmp_path, "time,q,q_des,pwm", time, wave, wave + 0.1, np.full(COUNT, 2.0) * np.cos(9 * time))
    text = write_sidecar(path)
    data = json.loads((tmp_path / "log.json").read_text())
    assert data["torque_column"] == "duty" and "pwm is taken for a duty" in text and "torque_scale 0.01" in text
    fields = ("duty_voltage", "kt", "resistance", "ke", "pendulum_mass", "pendulum_length", "pendulum_angle", "kp")
    assert all(name in data and data[name] is None for name in fields)
    with pytest.raises(ConfigurationError, match="--duty-voltage"):
        make_run(open_log(path), None, IdentifySetup())


def test_what_was_declared_is_written_and_goes_before_what_is_guessed(tmp_path: Path) -> None:
    """`--init --kp 77 --torque-limit 9 --torque-scale 3` wrote kp 20, guessed, and null for the rest."""
    write_log(tmp_path / "swing.csv", example_log())
    (tmp_path / "swing.json").unlink()
    flags = "--kp 77 --torque-limit 9 --torque-scale 3 --from 2 --test-condition in_air --set unknowns=[encoder_bias]"
    assert main(["identify", str(tmp_path / "swing.csv"), "--init", *flags.split()]) == 0
    setup = read_setup(tmp_path / "swing.csv")
    assert (setup.kp, setup.torque_limit, setup.torque_scale, setup.begin) == (77, 9, 3, 2)
    assert (setup.test_condition, setup.unknowns) == ("in_air", ("encoder_bias",))
    # The one gain that was not declared is guessed, of the torque in N m: 0.5 times the scale.
    assert setup.kd == pytest.approx(1.5, rel=0.3)


def test_guesses_are_in_the_units_that_were_declared(tmp_path: Path) -> None:
    """Gains per radian, of a log in degrees whose torque has the other sign and half the unit; a limit as well."""
    time = 0.002 * np.arange(COUNT)
    position = np.sin(9 * time)
    target, velocity = position + 0.2 * np.cos(5 * time), 9 * np.cos(9 * time)
    torque = 20 * (target - position) - 0.5 * velocity
    degrees = 180 / np.pi
    names = "time,position,target,velocity,torque"
    columns = (time, *(degrees * one for one in (position, target, velocity)), -2 * torque)
    data, notes = propose(table(tmp_path, names, *columns), LogSetup(torque_scale=-0.5))
    assert data["position_scale"] == 0.0174533 and data["torque_scale"] == -0.5 and "joints" not in data
    assert (data["kp"], data["kd"]) == pytest.approx((20, 0.5), rel=1e-2) and any("kp of" in line for line in notes)
    clipped = (time, position, target, velocity, np.clip(torque, -5, 5) / 3)
    assert propose(table(tmp_path, names, *clipped), LogSetup(torque_scale=3.0))[0]["torque_limit"] == 5.0
