"""Small valid logs of every kind, for the tests of the readers and for those that damage them."""

from __future__ import annotations

import gzip
import io
import json
import sqlite3
import struct
import zipfile
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType
from mcap_ros2.writer import Writer as RosWriter
from rosbags.rosbag2 import Reader
from scipy.io import savemat

from stiction.files.log import JointSignals, Log, LogSetup, write_log

HEADER = """
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""

DEFINITIONS = {
    "sensor_msgs/msg/JointState": "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
    "float64[] effort" + HEADER,
    "trajectory_msgs/msg/JointTrajectory": "std_msgs/Header header\nstring[] joint_names\n"
    "trajectory_msgs/JointTrajectoryPoint[] points"
    + HEADER
    + "=" * 80
    + "\nMSG: trajectory_msgs/JointTrajectoryPoint\n"
    "float64[] positions\nfloat64[] velocities\nfloat64[] accelerations\nfloat64[] effort\n"
    "builtin_interfaces/Duration time_from_start\n",
    "std_msgs/msg/Float64MultiArray": "std_msgs/MultiArrayLayout layout\nfloat64[] data\n" + "=" * 80 + "\n"
    "MSG: std_msgs/MultiArrayLayout\nstd_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n" + "=" * 80 + "\n"
    "MSG: std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n",
}
"""Type -> its definition, the same in every ROS 2."""

SAMPLES = 24
TIME = np.arange(SAMPLES) * 0.005
POSITION = np.stack([np.sin(9 * TIME), np.cos(7 * TIME)], axis=1)
TARGET = POSITION + 0.01


def canonical(folder: Path, suffix: str) -> Path:
    """Write a canonical log of two joints and its sidecar."""
    path = folder / f"log{suffix}"
    joints = {
        name: JointSignals(position=POSITION[:, i], target=TARGET[:, i], torque=20 * (TARGET - POSITION)[:, i])
        for i, name in enumerate(("FL_hip", "FL_calf"))
    }
    setup = LogSetup(kp=20.0, torque_source="motor_side", joints={"calf": LogSetup(kp=25.0)})
    write_log(path, Log("x", TIME, joints, setup))
    return path


def wide_table() -> dict[str, np.ndarray]:
    """Return the columns of the scripts that log for actuator networks."""
    columns: dict[str, np.ndarray] = {}
    for name, values in (
        ("tau_cal", 21 * (TARGET - POSITION)),
        ("tau_est", 20 * (TARGET - POSITION)),
        ("joint_pos", POSITION),
        ("joint_pos_target", TARGET),
        ("joint_vel", np.gradient(POSITION, axis=0)),
    ):
        columns |= {f"{name}_{index}": values[:, index] for index in range(2)}
    return columns


def wide_csv(folder: Path, time: bool = True) -> Path:
    """Write that table as CSV."""
    table = ({"timestamps": TIME} if time else {}) | wide_table()
    path = folder / "motor.csv"
    np.savetxt(path, np.column_stack(list(table.values())), delimiter=",", header=",".join(table), comments="")
    return path


def matlab(folder: Path, compressed: bool = True) -> Path:
    """Write matrices with wide names."""
    path = folder / "log.mat"
    savemat(path, {"t": TIME, "dof_pos": POSITION, "des_dof_pos": TARGET, "note": "x"}, do_compression=compressed)
    return path


def state(stamp: int, names: list[str], position: list[float], effort: list[float] | None = None) -> dict[str, Any]:
    """Return a message of joint states, its stamp in nanoseconds."""
    header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": ""}
    return {"header": header, "name": names, "position": position, "velocity": [], "effort": effort or []}


Sent = tuple[str, str, int, dict[str, Any]]
"""Topic, type, time of receipt [ns], fields."""


def mcap(
    path: Path,
    sent: list[Sent],
    compression: CompressionType = CompressionType.ZSTD,
    crcs: bool = True,
    definitions: dict[str, str] = DEFINITIONS,
) -> Path:
    """Write messages as an MCAP file of ROS 2."""
    with path.open("wb") as file:
        writer = RosWriter(file, compression=compression, enable_crcs=crcs)
        schemas = {kind: writer.register_msgdef(kind, definitions[kind]) for kind in {kind for _, kind, _, _ in sent}}
        for topic, kind, received, fields in sent:
            writer.write_message(topic, schemas[kind], fields, log_time=received, publish_time=received)
        writer.finish()
    return path


def joint_messages() -> list[Sent]:
    """Return states and commands of two joints; the command comes in another order, 1 ms before each state."""
    sent: list[Sent] = []
    start = 1_700_000_000 * 10**9
    kind = "sensor_msgs/msg/JointState"
    for index, time in enumerate(TIME):
        now = start + round(1e9 * time)
        command = state(now - 10**6, ["b", "a"], TARGET[index, ::-1].tolist())
        effort = (20 * (TARGET - POSITION)[index]).tolist()
        sent.append(("/joint_command", kind, now - 10**6, command))
        sent.append(("/joint_states", kind, now, state(now, ["a", "b"], POSITION[index].tolist(), effort)))
    return sent


def ros(folder: Path, compression: CompressionType = CompressionType.ZSTD, crcs: bool = True) -> Path:
    """Write them as an MCAP file."""
    return mcap(folder / "run.mcap", joint_messages(), compression, crcs)


def bag(path: Path, sent: list[Sent], definitions: dict[str, str] = DEFINITIONS) -> Path:
    """Write messages as a rosbag2 database; they are encoded by a library that writes MCAP."""
    packed = mcap(path.with_suffix(".mcap"), sent, definitions=definitions)
    path.unlink(missing_ok=True)
    base = sqlite3.connect(path)
    base.execute("CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
    base.execute("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    base.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
    topics: dict[str, int] = {}
    with Reader(packed) as reader:
        for connection, received, data in reader.messages():
            name = connection.topic
            if name not in topics:
                topics[name] = len(topics) + 1
                row: tuple[Any, ...] = (topics[name], name, connection.msgtype, "cdr")
                base.execute("INSERT INTO topics VALUES (?, ?, ?, ?)", row)
            row = (topics[name], received, bytes(data))
            base.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", row)
    base.commit()
    base.close()
    packed.unlink()
    return path


def database(folder: Path) -> Path:
    """Write the states and commands of `ros` as a rosbag2 database."""
    return bag(folder / "run.db3", joint_messages())


def tabs(folder: Path) -> Path:
    """Write tabs, ISO 8601, a column of words and one of empty cells."""
    begin = datetime(2026, 1, 2, tzinfo=UTC)
    rows = ["stamp\tposition\tmode\tempty\ttorque"]
    for time, position, target in zip(TIME, POSITION[:, 0], TARGET[:, 0], strict=True):
        stamp = (begin + timedelta(seconds=float(time))).isoformat()
        rows.append(f"{stamp}\t{position:.9g}\trun\t\t{20 * (target - position):.9g}")
    path = folder / "log.tsv"
    path.write_text("\n".join(rows) + "\n")
    return path


def packed(folder: Path) -> Path:
    """Write the canonical CSV, packed."""
    path = folder / "log.csv.gz"
    path.write_bytes(gzip.compress(canonical(folder, ".csv").read_bytes(), mtime=0))
    (folder / "log.csv").unlink()
    return path


def records(folder: Path) -> Path:
    """Write a record a line."""
    path = folder / "log.jsonl"
    lines = [
        json.dumps({"time": float(time), "position": dict(zip("ab", map(float, row), strict=True)), "mode": "run"})
        for time, row in zip(TIME, POSITION, strict=True)
    ]
    path.write_text("\n".join(lines) + "\n")
    return path


def lists(folder: Path) -> Path:
    """Write Parquet with a list a row."""
    import pyarrow as arrow
    from pyarrow import parquet

    path = folder / "log.parquet"
    columns = {"timestamp": TIME, "observation.state": POSITION.tolist(), "action": TARGET.tolist()}
    parquet.write_table(arrow.table(columns), path, write_page_checksum=True)
    return path


def bomb_npz(folder: Path, size: int = 2**31) -> Path:
    """Write an NPZ file of a few kilobytes whose one array would inflate to `size` bytes of zeros."""
    path = folder / "bomb.npz"
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, {"descr": "<f8", "fortran_order": False, "shape": (size // 8,)})
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("time.npy", "w") as member:
        member.write(buffer.getvalue())
        for _ in range(8):
            member.write(bytes(2**20))
    data = bytearray(path.read_bytes())
    place = data.rindex(b"PK\x01\x02")
    data[place + 24 : place + 28] = struct.pack("<I", size - 1)
    path.write_bytes(data)
    return path


GO_HEAD = "uint8[2] head\nuint8 level_flag\nuint8 frame_reserve\nuint32[2] sn\nuint32[2] version\nuint16 bandwidth\n"
IMU = "float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\nfloat32[3] rpy\n"
LINE = "=" * 80
UNITREE = {
    "unitree_go/msg/LowState": GO_HEAD
    + f"unitree_go/IMUState imu_state\nunitree_go/MotorState[20] motor_state\nuint32 tick\n{LINE}\n"
    f"MSG: unitree_go/IMUState\n{IMU}int8 temperature\n{LINE}\nMSG: unitree_go/MotorState\n"
    "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\nfloat32 q_raw\nfloat32 dq_raw\n"
    "float32 ddq_raw\nint8 temperature\nuint32 lost\nuint32[2] reserve\n",
    "unitree_go/msg/LowCmd": GO_HEAD
    + f"unitree_go/MotorCmd[20] motor_cmd\nuint32 crc\n{LINE}\nMSG: unitree_go/MotorCmd\n"
    "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 tau\nfloat32 kp\nfloat32 kd\nuint32[3] reserve\n",
    "unitree_hg/msg/LowState": "uint32[2] version\nuint8 mode_pr\nuint8 mode_machine\nuint32 tick\n"
    f"unitree_hg/IMUState imu_state\nunitree_hg/MotorState[35] motor_state\nuint32 crc\n{LINE}\n"
    f"MSG: unitree_hg/IMUState\n{IMU}int16 temperature\n{LINE}\nMSG: unitree_hg/MotorState\n"
    "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\nint16[2] temperature\nfloat32 vol\n"
    "uint32[2] sensor\nuint32 motorstate\nuint32[4] reserve\n",
    "unitree_hg/msg/LowCmd": "uint8 mode_pr\nuint8 mode_machine\nunitree_hg/MotorCmd[35] motor_cmd\nuint32 crc\n"
    f"{LINE}\nMSG: unitree_hg/MotorCmd\n"
    "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 tau\nfloat32 kp\nfloat32 kd\nuint32 reserve\n",
}
"""Type -> its definition in the maker's files, up to what follows the motors."""


def chunk(path: Path, content: bytes, declared: int | None = None) -> Path:
    """Write an MCAP file of one compressed chunk that declares its size, or another."""
    import zstandard
    from mcap.data_stream import RecordBuilder
    from mcap.records import Chunk, DataEnd, Footer, Header

    builder = RecordBuilder()
    builder.write(b"\x89MCAP0\r\n")
    Header("ros2", "x").write(builder)
    size = len(content) if declared is None else declared
    for record in (Chunk("zstd", zstandard.compress(content), 0, 0, 0, size), DataEnd(0), Footer(0, 0, 0)):
        record.write(builder)
    builder.write(b"\x89MCAP0\r\n")
    path.write_bytes(builder.end())
    return path


def sidecar(path: Path, content: Any) -> Path:
    """Write a log's sidecar."""
    path.with_suffix(".json").write_text(json.dumps(content))
    return path


def pace(folder: Path, **more: Any) -> Path:
    """Write PACE's tensors as torch does."""
    import torch

    path = folder / "traj.pt"
    entries = {"time": TIME, "dof_pos": POSITION, "des_dof_pos": TARGET}
    torch.save({name: torch.from_numpy(value).float() for name, value in entries.items()} | more, path)
    return path
