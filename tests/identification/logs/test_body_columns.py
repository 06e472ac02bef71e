"""The body of a walking robot through the one door: its IMU and feet under the names that people have."""

import json
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import damage
import logfiles
from bounded import bounded, read_here
from stiction.core.errors import LogError
from stiction.files.log import BODY, Log
from stiction.files.tables import publish_npz, write_csv
from stiction.identification.logs import apart, open_log, parse_columns
from stiction.identification.logs.bags import IMU

SAMPLES = 40
TIME = 0.002 * np.arange(SAMPLES)
GENERATOR = np.random.default_rng(5)
QUATERNION = np.array([0.9, 0.1, 0.2, 0.3]) + 0.01 * GENERATOR.standard_normal((SAMPLES, 4))
GYROSCOPE = GENERATOR.standard_normal((SAMPLES, 3))
ACCELEROMETER = 9.81 + GENERATOR.standard_normal((SAMPLES, 3))
FEET = np.round(100 + 10 * GENERATOR.standard_normal((SAMPLES, 4)))
POSITION = GENERATOR.standard_normal((SAMPLES, 2))

SIGNALS = {"quaternion": QUATERNION, "gyroscope": GYROSCOPE, "accelerometer": ACCELEROMETER, "foot_force": FEET}


def joint_table() -> dict[str, np.ndarray]:
    """Return the columns of two joints."""
    return {"time": TIME, "position.a": POSITION[:, 0], "position.b": POSITION[:, 1]}


def spread(pattern: str, labels: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """Return a column a label."""
    return {pattern.format(label): column for label, column in zip(labels, values.T, strict=True)}


def expect(log: Log, roles: tuple[str, ...] = BODY, tolerance: float = 1e-6) -> None:
    """Expect the signals above, and nothing else."""
    assert log.body is not None
    for role in BODY:
        values = getattr(log.body, role)
        if role not in roles:
            assert values is None
        else:
            np.testing.assert_allclose(values, SIGNALS[role], rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize(
    ("quaternion", "letters", "gyroscope", "accelerometer", "feet"),
    [
        ("/low/imu_state/quaternion[{}]", "0123", "/low/imu_state/gyroscope[{}]", "/x/accelerometer.{}", "0123"),
        ("/imu/data/orientation/{}", "wxyz", "/imu/data/angular_velocity/{}", "/imu/data/linear_acceleration/{}", ""),
        ("field.orientation.{}", "wxyz", "field.angular_velocity.{}", "field.linear_acceleration.{}", ""),
        ("base_quat_{}", "0123", "base_ang_vel_{}", "imu_acc_{}", ""),
    ],
)
def test_usual_names(
    tmp_path: Path, quaternion: str, letters: str, gyroscope: str, accelerometer: str, feet: str
) -> None:
    """PlotJuggler's, rostopic's and training scripts' columns are found without a mapping."""
    axes = "012" if letters[0] == "0" else "xyz"
    table = joint_table() | spread(quaternion, letters, QUATERNION)
    table |= spread(gyroscope, axes, GYROSCOPE) | spread(accelerometer, axes, ACCELEROMETER)
    table |= spread("/lowstate/foot_force[{}]", feet, FEET) if feet else {}
    table |= spread("/lowstate/foot_force_est[{}]", feet, 0 * FEET) if feet else {}
    publish_npz(tmp_path / "walk.npz", table)
    roles = BODY if feet else BODY[:3]
    expect(open_log(tmp_path / "walk.npz", body=True), roles)


def test_a_mapping_goes_first_and_knows_every_role(tmp_path: Path) -> None:
    """A mapping takes precedence; an unknown role is named with the known ones."""
    table = joint_table() | spread("q{}", "xyzw", QUATERNION[:, [1, 2, 3, 0]]) | spread("rate{}", "012", GYROSCOPE)
    table |= spread("f_{}", "xyz", ACCELEROMETER) | spread("foot{}", "0123", FEET)
    write_csv(tmp_path / "walk.csv", table)
    words = ("quaternion=qw,qx,qy,qz", "gyroscope=rate0,rate1,rate2", "accelerometer=f_", "foot_force=foot")
    expect(open_log(tmp_path / "walk.csv", parse_columns(words), body=True))
    for word, message in (
        ("quaternion=qw,qx,qy", "names 3 columns; expected different ones, w x y z"),
        ("gyroscope=rate0,rate0,rate1", "names 3 columns; expected different ones, x y z"),
        ("gyroscope=rate0,rate1,rates", "no column 'rates' for gyroscope; the columns are"),
        ("accelerometer=g_", "no columns of accelerometer=g_; the columns are"),
    ):
        with pytest.raises(LogError, match=message):
            open_log(tmp_path / "walk.csv", parse_columns((word,)), body=True)
    with pytest.raises(LogError, match=r"accelerometer= is of a walking robot's body; .* identify walk"):
        open_log(tmp_path / "walk.csv", parse_columns(words))
    sidecar = {"columns": dict(word.split("=") for word in words)}
    (tmp_path / "walk.json").write_text(json.dumps(sidecar))
    expect(open_log(tmp_path / "walk.csv", body=True))


def test_two_imus_are_a_question(tmp_path: Path) -> None:
    """Asks which of two IMUs to use; a text column is rejected where it is used."""
    table = joint_table() | spread("/imu/a/angular_velocity/{}", "xyz", GYROSCOPE)
    write_csv(tmp_path / "walk.csv", table | spread("/imu/b/angular_velocity/{}", "xyz", GYROSCOPE))
    with pytest.raises(LogError, match=r"several columns could be the gyroscope, /imu/a/.* say which"):
        open_log(tmp_path / "walk.csv", body=True)
    columns = {"gyroscope": "/imu/b/angular_velocity"}
    expect(open_log(tmp_path / "walk.csv", columns, body=True), ("gyroscope",))
    text = "time,position.a,gyroscope.x,gyroscope.y,gyroscope.z\n" + "0.1,1,a,2,3\n" * 3
    (tmp_path / "words.csv").write_text(text)
    with pytest.raises(LogError, match=r"gyroscope\.x"):
        open_log(tmp_path / "words.csv", body=True)


def test_empty_cells_of_the_imu_are_interpolated(tmp_path: Path) -> None:
    """Tools that merge topics leave cells empty where the IMU had nothing to say."""
    gaps = GYROSCOPE.copy()
    gaps[5] = np.nan
    rows = ["time,position.a,gyroscope.x,gyroscope.y,gyroscope.z"]
    for time, angle, rate in zip(TIME, POSITION[:, 0], gaps, strict=True):
        rows.append(",".join("" if np.isnan(value) else repr(float(value)) for value in (time, angle, *rate)))
    (tmp_path / "walk.csv").write_text("\n".join(rows) + "\n")
    log = open_log(tmp_path / "walk.csv", body=True)
    assert log.body is not None and log.body.gyroscope is not None
    np.testing.assert_allclose(log.body.gyroscope[5], (GYROSCOPE[4] + GYROSCOPE[6]) / 2)
    assert any("body's signals" in note for note in log.notes)


def test_a_record_a_line_of_unitree_s(tmp_path: Path) -> None:
    """Lists in JSON, and motors that are not there, as the maker's messages have twenty of them."""
    rows = []
    for index in range(SAMPLES):
        motors = [{"q": angle, "dq": 1.0, "tau_est": 2.0} for angle in POSITION[index].tolist()]
        motors += [{"q": 0.0, "dq": 0.0, "tau_est": 0.0}] * 8
        imu = {name: SIGNALS[name][index].tolist() for name in BODY[:3]}
        row = {"time": TIME[index], "motor_state": motors, "imu_state": imu, "foot_force": FEET[index].tolist()}
        rows.append(json.dumps(row))
    (tmp_path / "walk.jsonl").write_text("\n".join(rows) + "\n")
    log = open_log(tmp_path / "walk.jsonl", names=("a", "b"), body=True)
    assert list(log.joints) == ["a", "b"]
    expect(log)
    assert any("8 motors say zero in every row" in note for note in log.notes)


VECTOR = "=" * 80 + "\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
DEFINITIONS_HERE = logfiles.DEFINITIONS | {
    IMU: "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
    "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
    "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n"
    + logfiles.DEFINITIONS["sensor_msgs/msg/JointState"].partition("float64[] effort")[2].lstrip("\n")
    + "=" * 80
    + "\nMSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
    + VECTOR
}
START = 1_700_000_000 * 10**9


def bag(path: Path, frame: str = "imu", imus: tuple[str, ...] = ("/imu/data",)) -> Path:
    """Write joint states at 500 Hz and an IMU 0.5 ms before each, at a stamp of its own."""
    sent: list[Any] = []
    for index in range(SAMPLES):
        now = START + round(1e9 * TIME[index])
        header = {"stamp": {"sec": now // 10**9, "nanosec": now % 10**9}, "frame_id": frame}
        w, x, y, z = QUATERNION[index].tolist() if index % 2 else (-QUATERNION[index]).tolist()
        message = {"header": header, "orientation": {"x": x, "y": y, "z": z, "w": w}}
        for name, values in (("angular_velocity", GYROSCOPE), ("linear_acceleration", ACCELEROMETER)):
            message[name] = dict(zip("xyz", values[index].tolist(), strict=True))
            message[f"{name}_covariance"] = [0.0] * 9
        message["orientation_covariance"] = [0.0] * 9
        sent += [(topic, IMU, now - 1, message) for topic in imus]
        state = logfiles.state(now, ["a", "b"], POSITION[index].tolist())
        sent.append(("/joint_states", "sensor_msgs/msg/JointState", now, state))
    return logfiles.bag(path, sent, DEFINITIONS_HERE)


@pytest.mark.parametrize("frame", ["", "imu", "imu_link", "a_longer_name_of_a_frame"])
def test_an_imu_beside_joint_states_in_a_bag(tmp_path: Path, frame: str) -> None:
    """The offsets of the numbers depend on the length of the frame's name; signs of quaternions jump in real bags."""
    log = open_log(bag(tmp_path / "walk.db3", frame), body=True)
    assert log.body is not None and log.body.quaternion is not None
    sign = np.sign(log.body.quaternion[0] @ QUATERNION[0])
    np.testing.assert_allclose(sign * log.body.quaternion, QUATERNION)
    np.testing.assert_allclose(log.body.gyroscope, GYROSCOPE)
    np.testing.assert_allclose(log.body.accelerometer, ACCELEROMETER)
    assert log.body.period == pytest.approx(0.002) and log.body.foot_force is None
    assert open_log(tmp_path / "walk.db3").body is None


def test_topics_of_imus_are_asked_for(tmp_path: Path) -> None:
    """Two IMUs are a question, an unknown topic an error, and columns have no topics."""
    path = bag(tmp_path / "walk.db3", imus=("/imu/a", "/imu/b"))
    with pytest.raises(LogError, match="which topic is the imu\\? Say imu=TOPIC; there are"):
        open_log(path, body=True)
    assert open_log(path, {"imu": "/imu/b"}, body=True).body is not None
    with pytest.raises(LogError, match="imu=/joint_states: expected a topic of sensor_msgs/msg/Imu or"):
        open_log(path, {"imu": "/joint_states"}, body=True)
    with pytest.raises(LogError, match="imu= is of a walking robot's body"):
        open_log(path, {"imu": "/imu/b"})
    nothing = open_log(logfiles.database(tmp_path), body=True).body
    assert nothing is not None and all(getattr(nothing, role) is None for role in BODY)


BATTERY = (
    "=" * 80 + "\nMSG: unitree_go/BmsState\nuint8 version_high\nuint8 version_low\nuint8 status\nuint8 soc\n"
    "int32 current\nuint16 cycle\nint8[2] bq_ntc\nint8[2] mcu_ntc\nuint16[15] cell_vol\n"
)


@pytest.mark.parametrize("feet", [True, False])
def test_unitree_s_state_holds_the_body_too(tmp_path: Path, feet: bool) -> None:
    """Encoded by another program from the maker's definition; the feet stand behind the battery, where they are."""
    kind = "unitree_go/msg/LowState"
    tail = "unitree_go/BmsState bms_state\nint16[4] foot_force\nint16[4] foot_force_est\nuint32 tick\n"
    definition = logfiles.UNITREE[kind].replace("uint32 tick\n", tail if feet else "") + (BATTERY if feet else "")
    battery = {"version_high": 1, "version_low": 2, "status": 3, "soc": 4, "current": -5, "cycle": 6}
    battery |= {"bq_ntc": [7, 8], "mcu_ntc": [9, 10], "cell_vol": [11] * 15}  # type: ignore[dict-item]
    rest = dict.fromkeys(("ddq", "q_raw", "dq_raw", "ddq_raw", "mode", "temperature", "lost"), 0) | {"reserve": [0, 0]}
    sent: list[Any] = []
    for index in range(SAMPLES):
        motors = [{**rest, "q": angle, "dq": 1.0, "tau_est": 2.0} for angle in POSITION[index].tolist()]
        motors += [{**rest, "q": 0.0, "dq": 0.0, "tau_est": 0.0}] * 18
        imu = {name: SIGNALS[name][index].tolist() for name in BODY[:3]} | {"rpy": [0.0] * 3, "temperature": 1}
        state = {"head": [1, 2], "level_flag": 3, "frame_reserve": 4, "sn": [5, 6], "version": [7, 8], "bandwidth": 9}
        state |= {"imu_state": imu, "motor_state": motors}
        state |= {"bms_state": battery, "foot_force": FEET[index].astype(int).tolist()} if feet else {}
        state |= {"foot_force_est": [0] * 4, "tick": index} if feet else {}
        sent.append(("/lowstate", kind, START + round(1e9 * TIME[index]), state))
    log = open_log(logfiles.bag(tmp_path / "go2.db3", sent, {kind: definition}), names=("a", "b"), body=True)
    expect(log, BODY if feet else BODY[:3], 1e-5)


def test_damaged_walks_are_read_whole_or_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stranger's or a broken file must end in a log or in one line, never in a crash."""
    monkeypatch.setattr(apart, "read_apart", apart.read_apart)
    read_here()
    table = joint_table() | spread("gyroscope.{}", "xyz", GYROSCOPE) | spread("quaternion.{}", "wxyz", QUATERNION)
    write_csv(tmp_path / "walk.csv", table)
    seen = {True: 0, False: 0}
    for path in (tmp_path / "walk.csv", bag(tmp_path / "walk.db3")):
        victim, whole = tmp_path / f"hurt{path.suffix}", path.read_bytes()
        for number in range(60):
            victim.write_bytes(damage.damaged(whole, random.Random(f"{path.suffix} {number}")))
            log, fault = bounded(lambda victim=victim: open_log(victim, body=True), damage.LONGEST)
            assert fault is None, (path.suffix, number, fault)
            seen[log is not None] += 1
            if log is not None:
                signals = (getattr(log.body, role) for role in BODY)
                assert {len(values) for values in signals if values is not None} <= {len(log.time)}
    assert min(seen.values()) > 5
