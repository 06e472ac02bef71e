"""Simulate logs of joints with known dry friction, and write each in a format that people have.

Uses public libraries only, nothing of stiction: the logs stay the same bytes whatever the package becomes. Friction is
integrated exactly within a step (the joint stops when friction can stop it), so a log never depends on a solver.
"""

from __future__ import annotations

import gzip
import json
import math
import sqlite3
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

Table = dict[str, np.ndarray]
"""Column -> samples, shape (num_samples,)."""

FLAGS = "--kp 20 --kd 1 --torque-limit 40 --torque-source motor_side --test-condition in_air"
"""True flags of the standard joint."""


@dataclass(frozen=True)
class Joint:
    """A joint under a PD controller."""

    inertia: float = 0.06
    """Inertia [kg m²]."""
    viscous: float = 0.12
    """Viscous friction [N m s/rad]."""
    coulomb: float = 0.9
    """Dry friction in motion [N m]."""
    static: float = 0.0
    """Extra dry friction at rest [N m], gone at some 0.1 rad/s."""
    gravity: float = 1.5
    """Torque that holds the link at pi/2 [N m]."""
    kp: float = 20.0
    """Proportional gain [N m/rad]."""
    kd: float = 1.0
    """Derivative gain [N m s/rad]."""
    amplitude: float = 0.5
    """Amplitude of the slower sine of the target [rad]."""
    frequencies: tuple[float, float] = (0.5, 2.1)
    """Frequencies of the target's sines [Hz]."""
    noise: float = 0.02
    """Standard deviation of the logged torque [N m]."""


def simulate(joint: Joint, seed: int, seconds: float = 6.0, rate: float = 200.0, name: str = "FL_calf") -> Table:
    """Return a canonical log of one joint: time, position, velocity, target and motor torque."""
    steps = 8
    dt = 1.0 / (rate * steps)
    position, velocity = 0.0, 0.0
    rows = []
    for sample in range(round(seconds * rate)):
        time = sample / rate
        slow, fast = (math.sin(2 * math.pi * frequency * time) for frequency in joint.frequencies)
        target = joint.amplitude * (slow + 0.4 * fast)
        for _ in range(steps):
            torque = joint.kp * (target - position) - joint.kd * velocity
            force = torque - joint.viscous * velocity - joint.gravity * math.sin(position)
            free = velocity + dt * force / joint.inertia
            dry = joint.coulomb + joint.static * math.exp(-abs(velocity) / 0.1)
            velocity = math.copysign(max(abs(free) - dt * dry / joint.inertia, 0.0), free)
            position += dt * velocity
        rows.append((time, position, velocity, target, joint.kp * (target - position) - joint.kd * velocity))
    time, position, velocity, target, torque = np.array(rows).T
    rng = np.random.default_rng(seed)
    encoder = 2 * math.pi / 2**14
    return {
        "time": time,
        f"position.{name}": np.round(position / encoder) * encoder,
        f"velocity.{name}": np.round(velocity + 0.005 * rng.standard_normal(len(time)), 5),
        f"target.{name}": np.round(target, 6),
        f"torque.{name}": np.round(torque + joint.noise * rng.standard_normal(len(time)), 4),
    }


def two_joints(seed: int = 0) -> Table:
    """Return a log of two joints."""
    hip = simulate(Joint(inertia=0.04, coulomb=0.5, gravity=0.0, frequencies=(0.7, 2.7)), seed + 100, name="FL_hip")
    return simulate(Joint(), seed) | {name: values for name, values in hip.items() if name != "time"}


def renamed(table: Table, **names: str) -> Table:
    """Return the table under other names, role -> name, without columns that are not named."""
    columns = {role: next(c for c in table if c.partition(".")[0] == role) for role in names}
    return {names[role]: table[column] for role, column in columns.items()}


def text(path: Path, table: Table, separator: str = ",", header: bool = True, comma: bool = False) -> Path:
    """Write a table as text; comma: a decimal comma."""
    lines = [separator.join(table)] if header else []
    for row in zip(*table.values(), strict=True):
        line = separator.join(f"{value:.9g}" for value in row)
        lines.append(line.replace(".", ",") if comma else line)
    content = ("\n".join(lines) + "\n").encode()
    path.write_bytes(gzip.compress(content, mtime=0) if path.suffix == ".gz" else content)
    return path


def iso(path: Path, table: Table) -> Path:
    """Write tabs, stamps of ISO 8601 and a column of words."""
    begin = datetime(2026, 1, 2, tzinfo=UTC)
    names = [name for name in table if name != "time"]
    lines = ["\t".join(("stamp", *names, "mode"))]
    for time, *row in zip(*table.values(), strict=True):
        stamp = (begin + timedelta(seconds=float(time))).isoformat()
        lines.append("\t".join((stamp, *(f"{value:.9g}" for value in row), "run")))
    path.write_text("\n".join(lines) + "\n")
    return path


def parquet(path: Path, table: dict[str, Any]) -> Path:
    """Write Parquet, a column of numbers or of lists each."""
    import pyarrow
    from pyarrow import parquet as file

    file.write_table(pyarrow.table(table), path)
    return path


def matrix(table: Table, role: str) -> np.ndarray:
    """Return the columns of one role side by side, shape (num_samples, num_joints)."""
    return np.column_stack([values for name, values in table.items() if name.startswith(f"{role}.")])


HEADER = (
    "\n" + "=" * 80 + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n" + "=" * 80
    + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)  # fmt: skip
STATE = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort" + HEADER
KIND = "sensor_msgs/msg/JointState"


def mcap(path: Path, table: Table) -> Path:
    """Write states and commands of all joints as an MCAP file of ROS 2."""
    from mcap_ros2.writer import Writer

    names = [name.partition(".")[2] for name in table if name.startswith("position.")]
    columns = [matrix(table, role).tolist() for role in ("position", "target", "torque")]
    with path.open("wb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef(KIND, STATE)
        for time, position, target, torque in zip(table["time"], *columns, strict=True):
            now = 1_700_000_000 * 10**9 + round(1e9 * float(time))
            for topic, at, angle, effort in (
                ("/joint_command", now - 10**6, target, []),
                ("/joint_states", now, position, torque),
            ):
                stamp = {"sec": at // 10**9, "nanosec": at % 10**9}
                message = {"header": {"stamp": stamp, "frame_id": ""}, "name": names}
                message |= {"position": angle, "velocity": [], "effort": effort}
                writer.write_message(topic, schema, message, log_time=at, publish_time=at)
        writer.finish()
    return path


def database(path: Path, table: Table) -> Path:
    """Write the same messages as a rosbag2 database."""
    from mcap.reader import make_reader

    packed = mcap(path.with_suffix(".packed"), table)
    base = sqlite3.connect(path)
    base.execute("CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
    base.execute("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    topics: dict[str, int] = {}
    with packed.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            if channel.topic not in topics:
                topics[channel.topic] = len(topics) + 1
                base.execute(
                    "INSERT INTO topics VALUES (?, ?, ?, ?)", (topics[channel.topic], channel.topic, KIND, "cdr")
                )
            row = (topics[channel.topic], message.log_time, message.data)
            base.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", row)
    base.commit()
    base.close()
    packed.unlink()
    return path


def tensors(path: Path, table: Table) -> Path:
    """Write PACE's tensors as torch does."""
    import torch

    arrays = {"time": table["time"], "dof_pos": matrix(table, "position"), "des_dof_pos": matrix(table, "target")}
    torch.save({name: torch.from_numpy(values).float() for name, values in arrays.items()}, path)
    return path


def matlab(path: Path, table: Table) -> Path:
    """Write matrices with wide names, MATLAB 5."""
    from scipy.io import savemat

    savemat(path, {"t": table["time"], "dof_pos": matrix(table, "position"), "des_dof_pos": matrix(table, "target")})
    return path


def sidecar(path: Path, **fields: Any) -> Path:
    """Write the sidecar of a log."""
    path.with_suffix(".json").write_text(json.dumps(fields))
    return path


def jsonl(path: Path, table: Table) -> Path:
    """Write a record a line, the joints in objects."""
    lines = []
    for row in zip(*table.values(), strict=True):
        record: dict[str, Any] = {"mode": "run"}
        for column, value in zip(table, row, strict=True):
            role, _, joint = column.partition(".")
            if joint:
                record.setdefault(role, {})[joint] = float(value)
            else:
                record[role] = float(value)
        lines.append(json.dumps(record))
    path.write_text("\n".join(lines) + "\n")
    return path


def walk_csv(path: Path, walk: Path) -> Path:
    """Write a walk that `evaluate --log` logged as a CSV with columns of its own."""
    with np.load(walk) as file:
        data = {name: file[name] for name in file.files}
    names = json.loads(str(data["header"]))["joint_names"]
    table: Table = {"time": data["time"]}
    for role, key in (("position", "joint_position"), ("velocity", "joint_velocity"), ("target", "joint_target")):
        table |= {f"{role}.{name}": data[key][:, index] for index, name in enumerate(names)}
    table |= {f"torque.{name}": data["joint_torque"][:, index] for index, name in enumerate(names)}
    for role, key, axes in (
        ("quaternion", "quaternion", "wxyz"),
        ("gyroscope", "angular_velocity", "xyz"),
        ("accelerometer", "specific_force", "xyz"),
    ):
        table |= {f"{role}.{axis}": data[key][:, index] for index, axis in enumerate(axes)}
    return text(path, table)


ARM = """<robot name="arm">
<link name="base"><inertial><mass value="5"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="upper"><inertial><origin xyz="0 0 -0.12"/><mass value="1.1"/>
<inertia ixx=".006" iyy=".006" izz=".001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0 0 -0.1"/><mass value="0.6"/>
<inertia ixx=".003" iyy=".003" izz=".0005" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0"/><axis xyz="0 1 0"/>
<limit lower="-2.5" upper="2.5" effort="30" velocity="15"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.25"/>
<axis xyz="0 1 0"/><limit lower="-2.5" upper="2.5" effort="30" velocity="15"/></joint>
</robot>
"""  # noqa: E501
"""URDF of an arm of two joints, hanging from a held base."""


def arm(path: Path, seed: int = 0, seconds: float = 8.0) -> Path:
    """Simulate the arm in MuJoCo with dry friction in both joints, and write a canonical CSV."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(ARM)
    model.opt.timestep = 0.001
    model.dof_armature[:], model.dof_damping[:], model.dof_frictionloss[:] = 0.02, (0.1, 0.08), (0.7, 0.4)
    data = mujoco.MjData(model)
    rng, rows = np.random.default_rng(seed), []
    for step in range(round(seconds * 1000)):
        time = step * 0.001
        target = np.array(
            [
                0.5 * math.sin(3.1 * time) + 0.2 * math.sin(13 * time),
                0.6 * math.sin(4.3 * time) + 0.25 * math.sin(17 * time),
            ]
        )
        data.qfrc_applied[:] = 25 * (target - data.qpos) - 0.8 * data.qvel
        mujoco.mj_step(model, data)
        if step % 4 == 0:
            rows.append((time, *data.qpos, *target, *(data.qfrc_applied + 0.02 * rng.standard_normal(2))))
    joints = ("shoulder", "elbow")
    names = ["time", *(f"{role}.{joint}" for role in ("position", "target", "torque") for joint in joints)]
    return text(path, dict(zip(names, np.array(rows).T, strict=True)))


@dataclass(frozen=True)
class Case:
    """One call of `stiction identify`."""

    name: str
    """Name of the case."""
    words: str
    """Words behind `identify`; the log first."""
    make: Callable[[Path], Any]
    """Writer of the log and of what lies beside it, into a folder."""


def cases() -> list[Case]:
    """Return logs of joints in every format and state that identification knows."""
    joint, both = simulate(Joint(), 1), two_joints(2)
    roles = {"joint_pos": "position", "joint_pos_target": "target", "joint_vel": "velocity", "tau_est": "torque"}
    wide = {f"{name}_{index}": matrix(both, role)[:, index] for name, role in roles.items() for index in range(2)}
    odd = renamed(joint, time="t", position="q", target="qd", torque="amp")
    odd = {"t": 1e3 * odd["t"], "q": np.degrees(odd["q"]), "qd": np.degrees(odd["qd"]), "amp": odd["amp"] / 2.5}
    middle = len(joint["time"]) // 2
    halves = [{name: values[:middle] for name, values in joint.items()}]
    halves.append({name: values[middle:] for name, values in joint.items()})
    lists = {"timestamp": both["time"], "observation.state": list(matrix(both, "position")),
             "action": list(matrix(both, "target"))}  # fmt: skip
    no_torque = {name: values for name, values in joint.items() if not name.startswith("torque")}
    hot = simulate(replace(Joint(), coulomb=0.7), 5)
    gains = "--kp 20 --kd 1 --torque-limit 40 --test-condition in_air"
    return [
        Case("csv", f"log.csv {FLAGS}", lambda f: text(f / "log.csv", joint)),
        Case("json-summary", f"log.csv {FLAGS} --json", lambda f: text(f / "log.csv", joint)),
        Case("csv-sidecar", "log.csv", lambda f: sidecar(text(f / "log.csv", both), kp=20, kd=1, torque_limit=40,
             torque_source="motor_side", test_condition="in_air", joints={"calf": {"torque_limit": 45}})),
        Case("csv-one-joint-of-two", f"log.csv {FLAGS} --joint FL_hip", lambda f: text(f / "log.csv", both)),
        Case("csv-semicolons-decimal-comma", f"log.csv {FLAGS}",
             lambda f: text(f / "log.csv", joint, separator=";", comma=True)),
        Case("tsv-iso-stamps", f"log.tsv {FLAGS}", lambda f: iso(f / "log.tsv", joint)),
        Case("csv-gz", f"log.csv.gz {FLAGS}", lambda f: text(f / "log.csv.gz", joint)),
        Case("csv-no-header", f"log.csv --columns time=0 position=1 velocity=2 target=3 torque=4 --names knee {FLAGS}",
             lambda f: text(f / "log.csv", joint, header=False)),
        Case("csv-other-names-and-units", "log.csv --columns time=t position=q target=qd torque=amp --time-scale 1e-3 "
             f"--position-scale 0.017453292519943295 --torque-scale 2.5 {FLAGS}", lambda f: text(f / "log.csv", odd)),
        Case("csv-wide-without-time", f"log.csv --rate 200 --names hip knee {FLAGS}",
             lambda f: text(f / "log.csv", wide)),
        Case("npz", f"log.npz {FLAGS}", lambda f: np.savez(f / "log.npz", **both)),
        Case("parquet", f"log.parquet {FLAGS}", lambda f: parquet(f / "log.parquet", joint)),
        Case("parquet-lerobot", f"log.parquet {gains}", lambda f: parquet(f / "log.parquet", lists)),
        Case("json", f"log.json {FLAGS}",
             lambda f: (f / "log.json").write_text(json.dumps({n: v.tolist() for n, v in joint.items()}))),
        Case("jsonl", f"log.jsonl {FLAGS}", lambda f: jsonl(f / "log.jsonl", joint)),
        Case("mcap", f"run.mcap {FLAGS}", lambda f: mcap(f / "run.mcap", both)),
        Case("db3", f"run.db3 {FLAGS}", lambda f: database(f / "run.db3", both)),
        Case("pt-pace", f"traj.pt {gains}", lambda f: tensors(f / "traj.pt", both)),
        Case("mat", f"log.mat {gains}", lambda f: matlab(f / "log.mat", both)),
        Case("position-only", f"log.csv {gains}", lambda f: text(f / "log.csv", no_torque)),
        Case("repeat", f"log.csv --repeat hot.csv {FLAGS}",
             lambda f: (text(f / "log.csv", joint), text(f / "hot.csv", hot))),
        Case("two-runs", f"log.csv hot.csv {FLAGS}", lambda f: (text(f / "log.csv", joint), text(f / "hot.csv", hot))),
        Case("join", f"log_0.csv log_1.csv --join {FLAGS}",
             lambda f: [text(f / f"log_{index}.csv", half) for index, half in enumerate(halves)]),
        Case("from-to", f"log.csv --from 1 --to 5 {FLAGS}", lambda f: text(f / "log.csv", joint)),
        Case("static-friction", f"log.csv {FLAGS}",
             lambda f: text(f / "log.csv", simulate(replace(Joint(), static=0.6, amplitude=0.25), 3))),
        Case("no-friction", f"log.csv {FLAGS}",
             lambda f: text(f / "log.csv", simulate(replace(Joint(), coulomb=0.0), 4))),
        Case("one-slow-sine", f"log.csv {FLAGS}",
             lambda f: text(f / "log.csv", simulate(replace(Joint(), amplitude=0.02, frequencies=(0.3, 0.3)), 6))),
        Case("linear-axis", f"log.csv --axis linear {FLAGS}", lambda f: text(f / "log.csv", joint)),
        Case("output-side", f"log.csv {FLAGS.replace('motor_side', 'output_side')}",
             lambda f: text(f / "log.csv", joint)),
        Case("nothing-known", "log.csv", lambda f: text(f / "log.csv", joint)),
        Case("cut-off", f"log.csv {FLAGS}",
             lambda f: text(f / "log.csv", joint).write_bytes((f / "log.csv").read_bytes()[:40_000])),
        Case("limb", "arm.csv --robot arm.urdf --torque-source motor_side --kp 25 --kd 0.8",
             lambda f: ((f / "arm.urdf").write_text(ARM), arm(f / "arm.csv"))),
    ]  # fmt: skip
