"""One motion of two simulated joints in the files of strangers: each command by command, and what came out.

    python tools/strangers.py            # writes results/identification/strangers.md and .csv, some minutes
    python tools/strangers.py FOLDER     # writes the files alone, to look at

Nothing of anybody's data is in it: every file is written here, in the form that such files have.
"""

from __future__ import annotations

import argparse
import csv
import gzip
import json
import os
import shlex
import sqlite3
import struct
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from stiction.identification.example import SATURN_LITE, Excitation, Motor, example_log
from stiction_experiments.flags.servo import Servo

START = 1_700_000_000
"""When the logs were made, in seconds since 1970."""

FRICTION = {"hip": 0.442, "knee": 0.8}
"""Joint -> dry friction that the files were simulated with [N m]."""

FLAGS = "--kp 20 --kd 0.5 --torque-limit 45 --torque-source motor_side --test-condition bare_motor"
"""Flags for facts that no log contains."""

OUT = Path(__file__).parents[1] / "results" / "identification"


def _motor(joint: str) -> Motor:
    """Return the motor of a joint."""
    friction = replace(SATURN_LITE.joint.friction, level=FRICTION[joint])
    return replace(SATURN_LITE, joint=replace(SATURN_LITE.joint, friction=friction))


def record(seed: int = 0, duration: float = 12.0) -> dict[str, np.ndarray]:
    """Return `time` and, for each joint, `position.<joint>`, `target.<joint>` and `torque.<joint>` at 500 Hz."""
    table: dict[str, np.ndarray] = {}
    for place, joint in enumerate(FRICTION):
        log = example_log(_motor(joint), Excitation(duration=duration), seed=2 * seed + place)
        signals = log.joints["shank"]
        table |= {"time": log.time, f"position.{joint}": signals.position, f"target.{joint}": signals.target}  # type: ignore[dict-item]
        table[f"torque.{joint}"] = signals.torque  # type: ignore[assignment]
    return table


DATA = record()
TIME = DATA["time"]
POSITION, TARGET, TORQUE = (
    np.column_stack([DATA[f"{role}.{joint}"] for joint in FRICTION]) for role in ("position", "target", "torque")
)
VELOCITY = np.gradient(POSITION, TIME, axis=0)


@dataclass(frozen=True)
class Stranger:
    """A file as somebody has it, and what to type."""

    form: str
    """Form of the log, for the table."""
    write: Callable[[Path], None]
    """Function that writes the log into a folder."""
    commands: tuple[str, ...]
    """Commands to type there, after `stiction identify`."""
    joints: tuple[str, ...] = ("hip", "knee")
    """The joints that must be found, by name."""
    unit: str = "N m"
    """Unit of what comes out: N m, or over the motor's strength."""


def rows(*columns: np.ndarray) -> np.ndarray:
    """Return columns side by side."""
    return np.column_stack(columns)


def text(path: Path, head: str, table: np.ndarray, mark: str = ",", fmt: str = "%.9g") -> None:
    """Write a table of text under a header."""
    with path.open("w", encoding="utf-8") as file:
        file.write(head)
        np.savetxt(file, table, delimiter=mark, fmt=fmt)


def lines(path: Path, head: str, body: list[str], encoding: str = "utf-8") -> None:
    """Write lines under a header."""
    path.write_text("\n".join([head, *body]) + "\n", encoding=encoding)


NAMES = [f"{role}.{joint}" for joint in FRICTION for role in ("position", "target", "torque")]
TABLE = rows(TIME, *(DATA[name] for name in NAMES))
ONE = rows(TIME, POSITION[:, 1], TARGET[:, 1], TORQUE[:, 1])
"""The knee alone."""


def canonical(folder: Path) -> None:
    """Names as this program has them."""
    text(folder / "log.csv", ",".join(["time", *NAMES]) + "\n", TABLE)


def headerless(folder: Path) -> None:
    """Numbers alone."""
    text(folder / "log.csv", "", rows(TIME, POSITION, TARGET, TORQUE))


def pandas_index(folder: Path) -> None:
    """Write a log as `DataFrame.to_csv` does: an index without a name in front."""
    body = [f"{index}," + ",".join(f"{value:.9g}" for value in row) for index, row in enumerate(TABLE)]
    lines(folder / "log.csv", "," + ",".join(["time", *NAMES]), body)


def r_table(folder: Path) -> None:
    """Write a log as `write.table` of R does: quoted names, a column of row names that has none."""
    body = [f'"{index + 1}" ' + " ".join(f"{value:.9g}" for value in row) for index, row in enumerate(TABLE)]
    lines(folder / "log.txt", " ".join(f'"{name}"' for name in ["time", *NAMES]), body)


def hash_header(folder: Path) -> None:
    """Write a log as `numpy.savetxt` does with a header."""
    text(folder / "log.txt", "# " + " ".join(["time", *NAMES]) + "\n", TABLE, " ")


def rostopic(folder: Path) -> None:
    """Write a log as `rostopic echo -p` does: a header after %, nanoseconds since 1970, names in every row."""
    head = "%time,field.header.seq,field.name0,field.name1,field.position0,field.position1,field.effort0,field.effort1"
    body = [
        f"{START * 10**9 + round(1e9 * time)},{index},hip,knee,{p[0]:.9g},{p[1]:.9g},{e[0]:.9g},{e[1]:.9g}"
        for index, (time, p, e) in enumerate(zip(TIME, POSITION, TORQUE, strict=True))
    ]
    lines(folder / "log.csv", head, body)


def decimal_comma(folder: Path) -> None:
    """Write a log as a spreadsheet does in a locale with decimal commas."""
    body = [";".join(f"{value:.9g}".replace(".", ",") for value in row) for row in TABLE]
    lines(folder / "log.csv", ";".join(["time", *NAMES]), body)


def unit_row(folder: Path) -> None:
    """Tabs, and a line of units under the names."""
    units = "\t".join(["s", *["rad", "rad", "Nm"] * 2])
    text(folder / "log.tsv", "\t".join(["time", *NAMES]) + "\n" + units + "\n", TABLE, "\t")


def titles(folder: Path) -> None:
    """Lines about the measurement above the table, blanks between the numbers."""
    text(folder / "log.txt", "Drive analyser 3.1\nserial 0042\n\n" + " ".join(["time", *NAMES]) + "\n", TABLE, "  ")


def packed(folder: Path) -> None:
    """Write the same log, compressed."""
    canonical(folder)
    content = (folder / "log.csv").read_bytes()
    (folder / "log.csv").unlink()
    (folder / "log.csv.gz").write_bytes(gzip.compress(content, mtime=0))


def iso_time(folder: Path) -> None:
    """Times as ISO 8601."""
    begin = datetime.fromtimestamp(START, UTC)
    body = [
        (begin + timedelta(seconds=float(row[0]))).isoformat() + "," + ",".join(f"{v:.9g}" for v in row[1:])
        for row in TABLE
    ]
    lines(folder / "log.csv", ",".join(["stamp", *NAMES]), body)


def milliseconds(folder: Path) -> None:
    """Whole milliseconds from the start."""
    body = [f"{round(1e3 * row[0])}," + ",".join(f"{value:.9g}" for value in row[1:]) for row in TABLE]
    lines(folder / "log.csv", ",".join(["time", *NAMES]), body)


def microseconds(folder: Path) -> None:
    """A clock of the controller that counts in tenths of a microsecond, and does not say so."""
    body = [f"{round(1e7 * row[0])}," + ",".join(f"{value:.9g}" for value in row[1:]) for row in TABLE]
    lines(folder / "log.csv", ",".join(["time", *NAMES]), body)


def nanoseconds(folder: Path) -> None:
    """Nanoseconds since 1970, in a column that says so."""
    body = [f"{START * 10**9 + round(1e9 * row[0])}," + ",".join(f"{value:.9g}" for value in row[1:]) for row in TABLE]
    lines(folder / "log.csv", ",".join(["timestamp_ns", *NAMES]), body)


def mixed_columns(folder: Path) -> None:
    """Modes, flags and empty cells beside the signals."""
    body = [
        ",".join(f"{value:.9g}" for value in row) + f",{'run' if index else 'init'},{'true' if index % 2 else 'false'},"
        for index, row in enumerate(TABLE)
    ]
    lines(folder / "log.csv", ",".join(["time", *NAMES, "mode", "enabled", "error"]), body)


def plotjuggler(folder: Path) -> None:
    """Topics merged on one axis of time, with empty cells where a topic had nothing to say."""
    head = ["__time", *(f"/joint_states/{joint}/{field}" for joint in FRICTION for field in ("position", "effort"))]
    body = []
    for index, time in enumerate(TIME):
        commands = f"{TARGET[index, 0]:.9g},{TARGET[index, 1]:.9g}"
        states = ",".join(f"{POSITION[index, j]:.9g},{TORQUE[index, j]:.9g}" for j in range(2))
        body += [f"{START + time - 1e-4:.6f},,,,,{commands}", f"{START + time:.6f},{states},,"]
    lines(folder / "log.csv", ",".join([*head, *(f"/joint_command/{joint}/position" for joint in FRICTION)]), body)


def utf16(folder: Path) -> None:
    """Write a log as the Unicode text of a spreadsheet."""
    body = ["\t".join(f"{value:.9g}" for value in row) for row in TABLE]
    lines(folder / "log.txt", "\t".join(["time", *NAMES]), body, "utf-16")


def wide(folder: Path) -> None:
    """The columns of scripts that log for actuator networks, without time."""
    head = [f"{name}_{index}" for name in ("joint_pos", "joint_pos_target", "tau_est") for index in range(2)]
    text(folder / "log.csv", ",".join(head) + "\n", rows(POSITION, TARGET, TORQUE))


def lerobot(folder: Path) -> None:
    """A LeRobot episode: lists of degrees, no torque, whole indices."""
    import pyarrow as arrow
    from pyarrow import parquet

    kind = arrow.list_(arrow.float32(), 2)
    columns = {
        "observation.state": arrow.array(np.rad2deg(POSITION).tolist(), kind),
        "action": arrow.array(np.rad2deg(TARGET).tolist(), kind),
        "timestamp": arrow.array(TIME, arrow.float32()),
        "frame_index": np.arange(len(TIME)),
        "episode_index": np.zeros(len(TIME), int),
        "task": ["swing"] * len(TIME),
    }
    parquet.write_table(arrow.table(columns), folder / "episode_000000.parquet")


def stamped_parquet(folder: Path) -> None:
    """Parquet with stamps of its own kind."""
    import pyarrow as arrow
    from pyarrow import parquet

    stamps = arrow.array(START * 10**9 + np.rint(1e9 * TIME).astype(np.int64), arrow.timestamp("ns"))
    parquet.write_table(arrow.table({"timestamp": stamps} | {n: DATA[n] for n in NAMES}), folder / "log.parquet")


def transposed_npz(folder: Path) -> None:
    """Joints by samples, among arrays that have nothing to do with the log."""
    np.savez(
        folder / "log.npz",
        **{"t": TIME, "dof_pos": POSITION.T, "des_dof_pos": TARGET.T, "tau": TORQUE.T, "gains": np.array([20.0, 0.5])},
        **{"camera": np.zeros((3, 4, 5)), "names": np.array(["hip", "knee"]), "calibration": np.eye(7)},
    )


def canonical_npz(folder: Path) -> None:
    """Names as this program has them."""
    np.savez_compressed(folder / "log.npz", **DATA)


def _cdr_state(stamp: int, position: np.ndarray, effort: np.ndarray) -> bytes:
    """Return a `JointState` of hip and knee, as ROS 2 lays it out."""
    data = struct.pack("<IIIB", stamp // 10**9, stamp % 10**9, 1, 0)
    data += bytes(-len(data) % 4) + struct.pack("<I", 2)
    for name in (b"hip\0", b"knee\0"):
        data += bytes(-len(data) % 4) + struct.pack("<I", len(name)) + name
    for values in (position, (), effort):
        data += bytes(-len(data) % 4) + struct.pack("<I", len(values))
        if len(values):
            data += bytes(-len(data) % 8) + struct.pack(f"<{len(values)}d", *values)
    return b"\0\x01\0\0" + data


def _motors(before: int, size: int, fields: dict[int, np.ndarray]) -> bytes:
    """Return a Unitree message of 20 motors: `before` bytes, then each motor's `size`; fields: place -> numbers."""
    data = bytearray(before + 20 * size + 200)
    for place, numbers in fields.items():
        for motor, number in enumerate(numbers):
            struct.pack_into("<f", data, before + motor * size + place, number)
    return b"\0\x01\0\0" + bytes(data)


Messages = list[tuple[str, str, int, bytes]]
"""Topic, type, time of receipt [ns], bytes."""


def _states() -> Messages:
    """Return joint states, and before each its command."""
    messages: Messages = []
    for index, time in enumerate(TIME):
        now = START * 10**9 + round(1e9 * float(time))
        for topic, when, values in (("command", now - 10**5, TARGET), ("states", now, POSITION)):
            data = _cdr_state(when, values[index], TORQUE[index] if topic == "states" else np.zeros(0))
            messages.append((f"/joint_{topic}", "sensor_msgs/msg/JointState", when, data))
    return messages


def _lowstates() -> Messages:
    """Return `LowState` and `LowCmd` of a Go2; a motor's numbers begin at multiples of four, its mode just before."""
    messages: Messages = []
    for index, time in enumerate(TIME):
        now = START * 10**9 + round(1e9 * float(time))
        gains = {16: np.full(2, 20.0), 20: np.full(2, 0.5)}
        command = _motors(20, 36, {4: TARGET[index]} | gains)
        state = _motors(76, 48, {4: POSITION[index], 8: VELOCITY[index], 16: TORQUE[index]})
        messages.append(("/lowcmd", "unitree_go/msg/LowCmd", now - 10**5, command))
        messages.append(("/lowstate", "unitree_go/msg/LowState", now, state))
    return messages


def _bag(path: Path, messages: Messages) -> None:
    """Write a rosbag2 database."""
    base = sqlite3.connect(path)
    base.execute("CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
    base.execute("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    topics = {name: (number, kind) for number, (name, kind) in enumerate({m[0]: m[1] for m in messages}.items(), 1)}
    base.executemany(
        "INSERT INTO topics VALUES (?, ?, ?, 'cdr')", [(n, name, kind) for name, (n, kind) in topics.items()]
    )
    base.executemany(
        "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)",
        [(topics[name][0], stamp, data) for name, _, stamp, data in messages],
    )
    base.commit()
    base.close()


def mcap_bag(folder: Path) -> None:
    """A bag of ROS 2 in its newer form."""
    from mcap.writer import Writer

    with (folder / "run_0.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", b"")
        channels: dict[str, int] = {}
        for topic, _, stamp, data in _states():
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[topic], stamp, data, stamp)
        writer.finish()


def database_bag(folder: Path) -> None:
    """A bag of ROS 2 in its older form."""
    _bag(folder / "run_0.db3", _states())


def unitree_bag(folder: Path) -> None:
    """A bag of a Go2's own messages."""
    _bag(folder / "go2.db3", _lowstates())


def unitree_json(folder: Path) -> None:
    """A `LowState` a line, as scripts around the maker's SDK print it."""
    body = []
    for index, time in enumerate(TIME):
        motors = [
            {"mode": 1, "q": p, "dq": v, "tau_est": e, "temperature": 31}
            for p, v, e in zip(POSITION[index], VELOCITY[index], TORQUE[index], strict=True)
        ]
        body.append(json.dumps({"tick": round(1e3 * float(time)), "level_flag": 255, "motor_state": motors}))
    lines(folder / "lowstate.jsonl", body[0], body[1:])


def unitree_csv(folder: Path) -> None:
    """Write the same log as a table, with names as PlotJuggler gives them."""
    head = [f"/lowstate/motor_state[{j}]/{name}" for j in range(2) for name in ("q", "dq", "tau_est")]
    table = rows(START + TIME, *(array[:, j] for j in range(2) for array in (POSITION, VELOCITY, TORQUE)))
    text(folder / "log.csv", ",".join(["__time", *head]) + "\n", table, fmt="%.13g")


def json_arrays(folder: Path) -> None:
    """One object of arrays."""
    data = {"robot": "two joints", "time": TIME.tolist()} | {name: DATA[name].tolist() for name in NAMES}
    (folder / "log.json").write_text(json.dumps(data))


def json_records(folder: Path) -> None:
    """A list of records, each joint an object."""
    roles = {"position": POSITION, "target": TARGET, "torque": TORQUE}
    samples = [
        {"time": float(time)}
        | {role: {joint: float(values[index, j]) for j, joint in enumerate(FRICTION)} for role, values in roles.items()}
        for index, time in enumerate(TIME)
    ]
    (folder / "log.json").write_text(json.dumps({"samples": samples}))


def matlab(folder: Path) -> None:
    """A workspace saved by MATLAB."""
    from scipy.io import savemat

    savemat(folder / "log.mat", {"t": TIME, "q": POSITION[:, 1], "u": TORQUE[:, 1], "note": "bench", "K": np.eye(3)})


def pace(folder: Path) -> None:
    """A dictionary of tensors, as PACE saves it."""
    import torch

    entries = {"time": TIME, "dof_pos": POSITION, "des_dof_pos": TARGET}
    torch.save({name: torch.from_numpy(values) for name, values in entries.items()}, folder / "chirp.pt")


def several_runs(folder: Path) -> None:
    """Three runs of 12 s."""
    for number in range(3):
        data = record(number)
        text(folder / f"run{number}.csv", ",".join(data) + "\n", rows(*data.values()))


def parts(folder: Path) -> None:
    """One log that its logger cut into three files."""
    for number, part in enumerate(np.array_split(TABLE, 3)):
        text(folder / f"log_{number}.csv", ",".join(["time", *NAMES]) + "\n", part)


def arm_in_amperes(folder: Path) -> None:
    """Currents, with a torque constant of each joint in the sidecar."""
    table = rows(TIME, POSITION, TARGET, TORQUE / np.array([1.5, -2.5]))
    text(folder / "arm.csv", "t,q_hip,q_knee,cmd_hip,cmd_knee,i_hip,i_knee\n", table)
    sidecar = {
        **{"kp": 20, "kd": 0.5, "torque_limit": 45, "torque_source": "motor_side", "test_condition": "bare_motor"},
        "columns": {"position": "q_{joint}", "target": "cmd_{joint}", "torque": "i_{joint}"},
        "joints": {"hip": {"torque_scale": 1.5}, "knee": {"torque_scale": -2.5}},
    }
    (folder / "arm.json").write_text(json.dumps(sidecar, indent=2))


def degrees(folder: Path) -> None:
    """Degrees at the motor, in front of a gear of 6.33."""
    text(folder / "log.csv", "time,position,torque\n", rows(TIME, np.rad2deg(6.33 * POSITION[:, 1]), TORQUE[:, 1]))


def names_of_their_own(folder: Path) -> None:
    """Names that are plain to people."""
    text(folder / "log.csv", "stamp;q;q_des;tau;i2t\n", rows(ONE, np.arange(len(TIME))), ";")


def with_a_rest(folder: Path) -> None:
    """The joint is switched on late, and pushed by hand at the end."""
    still, pushed = np.zeros(1000), 0.4 * np.sin(np.arange(1500) / 40)
    columns = [np.concatenate([still, ONE[:, i], pushed * (i == 1)]) for i in (1, 2, 3)]
    columns[0][-1500:] += ONE[-1, 1]
    text(folder / "log.csv", "time,position,target,torque\n", rows(0.002 * np.arange(len(columns[0])), *columns))


KT, RESISTANCE, SUPPLY = 1.5, 4.0, 24.0
"""Torque constant, resistance and supply of the servos, at the joint [N m/A, ohm, V]."""

MOTOR = f"--kt {KT:g} --resistance {RESISTANCE:g}"

VOLTS = RESISTANCE / KT * TORQUE + KT * VELOCITY
"""Across the motors, for the same torques [V]."""


def servo_in_percent(folder: Path) -> None:
    """Degrees, and the duty of the bridge in percent."""
    text(
        folder / "log.csv",
        "time,angle_deg,pwm_percent\n",
        rows(TIME, np.rad2deg(ONE[:, 1]), 100 / SUPPLY * VOLTS[:, 1]),
    )


def servo_in_ticks(folder: Path) -> None:
    """A bus servo's registers: milliseconds, ticks of 4096 a turn, counts of 885 for full duty."""
    ticks, counts = np.round(ONE[:, 1] * 4096 / (2 * np.pi)) + 2048, np.round(885 / SUPPLY * VOLTS[:, 1])
    head = "timestamp_ms,present_position,present_pwm\n"
    text(folder / "log.csv", head, rows(1e3 * TIME, ticks, counts))


def servo_in_volts(folder: Path) -> None:
    """Voltages across two motors."""
    text(folder / "log.csv", "time,q_hip,q_knee,u_hip,u_knee\n", rows(TIME, POSITION, VOLTS))


def servo_in_milliamperes(folder: Path) -> None:
    """The current that a servo reports."""
    text(folder / "log.csv", "time,position,present_current\n", rows(TIME, ONE[:, 1], 1e3 / KT * TORQUE[:, 1]))


def servo_by_sidecar(folder: Path) -> None:
    """Duties of two joints, with the constants of each motor in the sidecar."""
    text(folder / "servos.csv", "t,q_hip,q_knee,duty_hip,duty_knee\n", rows(TIME, POSITION, VOLTS / SUPPLY))
    sidecar = {
        **{"torque_limit": 45, "torque_source": "motor_side", "test_condition": "bare_motor", "duty_voltage": SUPPLY},
        "columns": {"position": "q_{joint}", "torque": "duty_{joint}"},
        "joints": {joint: {"kt": KT, "resistance": RESISTANCE} for joint in FRICTION},
    }
    (folder / "servos.json").write_text(json.dumps(sidecar, indent=2))


def servo_with_pendulum(folder: Path) -> None:
    """Half a kilogram at 0.2 m on a motor of which nothing is known but the supply."""
    log = Servo(coulomb=FRICTION["knee"], supply=SUPPLY).log("duty", mass=0.5)
    signals = log.joints["knee"]
    assert signals.position is not None and signals.torque is not None
    text(folder / "log.csv", "time,position,duty\n", rows(log.time, signals.position, signals.torque))


SERVO_FLAGS = "--torque-limit 45 --torque-source motor_side --test-condition bare_motor"
"""Flags for facts that no log of a servo contains; the controller is unknown."""

STRANGERS = (
    Stranger("CSV with names `position.<joint>`", canonical, (f"log.csv {FLAGS}",)),
    Stranger(
        "CSV without a header",
        headerless,
        (f"log.csv --columns time=0 position=1,2 target=3,4 torque=5,6 --names hip knee {FLAGS}",),
    ),
    Stranger("CSV with an index column (pandas)", pandas_index, (f"log.csv {FLAGS}",)),
    Stranger("table with row names (R)", r_table, (f"log.txt {FLAGS}",)),
    Stranger("`#` header, blanks between numbers (numpy.savetxt)", hash_header, (f"log.txt {FLAGS}",)),
    Stranger("`rostopic echo -p` of ROS 1", rostopic, (f"log.csv --names hip knee {FLAGS}",)),
    Stranger("semicolons and decimal commas (spreadsheet)", decimal_comma, (f"log.csv {FLAGS}",)),
    Stranger("TSV with a line of units", unit_row, (f"log.tsv {FLAGS}",)),
    Stranger("TXT with titles above the table", titles, (f"log.txt {FLAGS}",)),
    Stranger("Unicode text of a spreadsheet (UTF-16, tabs)", utf16, (f"log.txt {FLAGS}",)),
    Stranger("CSV, packed", packed, (f"log.csv.gz {FLAGS}",)),
    Stranger("times as ISO 8601", iso_time, (f"log.csv {FLAGS}",)),
    Stranger("times in whole milliseconds", milliseconds, (f"log.csv {FLAGS}",)),
    Stranger("times in a unit that nobody could guess", microseconds, (f"log.csv --time-scale 1e-7 {FLAGS}",)),
    Stranger("times in nanoseconds since 1970", nanoseconds, (f"log.csv {FLAGS}",)),
    Stranger("text, booleans and empty cells in other columns", mixed_columns, (f"log.csv {FLAGS}",)),
    Stranger("PlotJuggler's export of two topics, with empty cells", plotjuggler, (f"log.csv {FLAGS}",)),
    Stranger("columns of actuator-net scripts, no time", wide, (f"log.csv --rate 500 --names hip knee {FLAGS}",)),
    Stranger(
        "LeRobot's Parquet: lists, degrees, no torque",
        lerobot,
        (f"episode_000000.parquet --position-scale 0.0174532925 --names hip knee {FLAGS}",),
        unit="N m over k",
    ),
    Stranger("Parquet with time stamps", stamped_parquet, (f"log.parquet {FLAGS}",)),
    Stranger("NPZ: joints by samples, and other arrays", transposed_npz, (f"log.npz --names hip knee {FLAGS}",)),
    Stranger("NPZ with names `position.<joint>`", canonical_npz, (f"log.npz {FLAGS}",)),
    Stranger("MCAP: joint states and commands", mcap_bag, (f"run_0.mcap {FLAGS}",)),
    Stranger("rosbag2 database: joint states and commands", database_bag, (f"run_0.db3 {FLAGS}",)),
    Stranger("rosbag2 database: Unitree's LowState and LowCmd", unitree_bag, (f"go2.db3 --names hip knee {FLAGS}",)),
    Stranger("Unitree's LowState, JSON a line", unitree_json, (f"lowstate.jsonl --names hip knee {FLAGS}",)),
    Stranger("Unitree's LowState, PlotJuggler's columns", unitree_csv, (f"log.csv --names hip knee {FLAGS}",)),
    Stranger("JSON: an object of arrays", json_arrays, (f"log.json {FLAGS}",)),
    Stranger("JSON: a list of records", json_records, (f"log.json {FLAGS}",)),
    Stranger("MATLAB 5", matlab, (f"log.mat --columns position=q torque=u --joint knee {FLAGS}",), ("knee",)),
    Stranger("PACE's `.pt`", pace, (f"chirp.pt --names hip knee {FLAGS}",), unit="N m over k"),
    Stranger("three runs, one fit", several_runs, (f"run0.csv run1.csv run2.csv {FLAGS}",)),
    Stranger("one log in three files", parts, (f"log_0.csv log_1.csv log_2.csv --join {FLAGS}",)),
    Stranger("an arm in amperes, its constants in the sidecar", arm_in_amperes, ("arm.csv",)),
    Stranger(
        "degrees at the motor, in front of a gear",
        degrees,
        (f"log.csv --joint knee --position-scale 0.00275722 {FLAGS}",),
        ("knee",),
    ),
    Stranger(
        "names of their own",
        names_of_their_own,
        ("log.csv --init --joint knee", f"log.csv --joint knee {FLAGS}"),
        ("knee",),
    ),
    Stranger(
        "a rest before, a push after", with_a_rest, (f"log.csv --joint knee --from 2 --to 14 {FLAGS}",), ("knee",)
    ),
    Stranger(
        "a servo: degrees, duty in percent",
        servo_in_percent,
        (
            "log.csv --columns position=angle_deg torque=pwm_percent --position-scale 0.0174532925 --torque-scale 0.01 "
            f"--duty-voltage {SUPPLY:g} {MOTOR} --joint knee {SERVO_FLAGS}",
        ),
        ("knee",),
    ),
    Stranger(
        "a bus servo's registers: ms, ticks, counts of PWM",
        servo_in_ticks,
        (
            "log.csv --columns time=timestamp_ms position=present_position torque=present_pwm --time-scale 1e-3 "
            f"--position-scale 0.00153398 --torque-scale 0.00112994 --duty-voltage {SUPPLY:g} {MOTOR} --joint knee "
            f"{SERVO_FLAGS}",
        ),
        ("knee",),
    ),
    Stranger(
        "two motors by voltage",
        servo_in_volts,
        (f"log.csv --columns position=q_{{joint}} torque=u_{{joint}} --torque-column voltage {MOTOR} {SERVO_FLAGS}",),
    ),
    Stranger(
        "a servo that reports mA",
        servo_in_milliamperes,
        (
            "log.csv --columns torque=present_current position=position --torque-column current --torque-scale 0.001 "
            f"--kt {KT:g} --joint knee {SERVO_FLAGS}",
        ),
        ("knee",),
    ),
    Stranger("two servos by duty, their constants in the sidecar", servo_by_sidecar, ("servos.csv",)),
    Stranger(
        "a servo of which nothing is known but the supply, with a known pendulum",
        servo_with_pendulum,
        (
            f"log.csv --columns position=position torque=duty --duty-voltage {SUPPLY:g} --pendulum-mass 0.5 "
            "--pendulum-length 0.2 --joint knee --torque-source motor_side --test-condition loaded",
        ),
        ("knee",),
    ),
)
"""None takes more than two commands."""


def _foreign(name: str, content: bytes) -> Callable[[Path], None]:
    """Return what writes a file of a kind that is not read."""
    return lambda folder: (folder / name).write_bytes(content) and None


REFUSED = (
    ("a pickle", _foreign("log.pkl", b"\x80\x04."), "log.pkl"),
    ("HDF5", _foreign("log.h5", b"\x89HDF\r\n"), "log.h5"),
    ("a spreadsheet", _foreign("log.xlsx", b"PK\x03\x04"), "log.xlsx"),
    ("joints.json, a result", _foreign("joints.json", b'{"schema_version": 1, "joints": {}}'), "joints.json"),
    (
        "a description of a LeRobot data set",
        _foreign("info.json", b'{"codebase_version": "v2.1", "features": {}}'),
        "info.json",
    ),
    (
        "an index of samples in place of time",
        _foreign(
            "log.csv",
            b"time,position,torque\n"
            + b"".join(f"{i},{np.sin(i / 50):.6f},{np.cos(i / 50):.6f}\n".encode() for i in range(1000)),
        ),
        "log.csv",
    ),
    ("names that say nothing", _foreign("log.csv", b"a,b,c\n1,2,3\n2,3,4\n"), "log.csv"),
    (
        "a servo's duty in percent, said to be a share",
        servo_in_percent,
        "log.csv --columns position=angle_deg torque=pwm_percent --position-scale 0.0174532925 "
        f"--duty-voltage 24 {MOTOR}",
    ),
    (
        "a servo's duty in counts, said to be percent",
        servo_in_ticks,
        "log.csv --columns time=timestamp_ms position=present_position torque=present_pwm --time-scale 1e-3 "
        f"--position-scale 0.00153398 --torque-scale 0.01 --duty-voltage 24 {MOTOR}",
    ),
)
"""Unreadable files, whose refusal must name the nearest conversion."""


def run(folder: Path, command: str) -> tuple[int, str]:
    """Run one command in a folder; return the status and the last line on standard error."""
    from contextlib import chdir, redirect_stderr, redirect_stdout
    from io import StringIO

    from stiction.cli.main import main

    output, errors = StringIO(), StringIO()
    with chdir(folder), redirect_stdout(output), redirect_stderr(errors):
        status = main(["identify", *shlex.split(command)])
    return status, " ".join(errors.getvalue().split())


def outcome(folder: Path, stranger: Stranger) -> dict[str, str]:
    """Write a stranger's file, run the commands, and return the row of the table."""
    from stiction.files.bam import load_joints

    stranger.write(folder)
    for command in stranger.commands:
        status, output = run(folder, f"{command}" + (" --json" if "--init" not in command else ""))
        if status:
            return _row(stranger, "", "", f"refused: {output}", False)
    joints = load_joints(folder / "identified" / "joints.json").joints
    values, right = [], list(joints) == list(stranger.joints)
    for name in stranger.joints:
        record = joints.get(name)
        estimate = record and (record.coulomb_friction or record.combinations.get("f/k"))
        if not estimate:
            return _row(stranger, "", "", f"{name} was not identified", False)
        low, high = estimate.interval95
        values.append(f"{name} {estimate.value:.3f} ({low:.3f} to {high:.3f})")
        right &= abs(estimate.value - FRICTION[name]) < 0.05 * FRICTION[name]
    truth = ", ".join(f"{name} {FRICTION[name]:g}" for name in stranger.joints)
    return _row(stranger, truth, ", ".join(values) + f" {stranger.unit}", "", right)


def _row(stranger: Stranger, truth: str, result: str, refusal: str, right: bool) -> dict[str, str]:
    """Return a row of the table."""
    return {
        "form": stranger.form,
        "commands": " && ".join(f"stiction identify {command}" for command in stranger.commands),
        "count": str(len(stranger.commands)),
        "dry friction simulated": truth,
        "what came out": result or refusal,
        "within 5 %": "yes" if right else "no",
    }


HEAD = """# Strangers' files

The same motion of two simulated joints, with dry friction of 0.442 and 0.8 N m, in the forms in which people have logs;
`python tools/strangers.py` writes the files, runs the commands, and this page. Copy the line whose file looks like
yours. `FLAGS` are what no log says of itself, `{flags}`; a sidecar, `LOG.json`, holds them as well
(`stiction identify --init LOG` writes one to fill in).

"""


def main() -> None:
    """Write the table, or the files alone."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("out", nargs="?", type=Path, help="folder for the files alone, of which nothing is run then")
    out = parser.parse_args().out
    os.environ.setdefault("STICTION_THREADS", "1")
    if out is not None:
        for number, stranger in enumerate(STRANGERS, 1):
            folder = out / f"{number:02d}"
            folder.mkdir(parents=True)
            stranger.write(folder)
        return
    outcomes, refused = [], []
    with tempfile.TemporaryDirectory() as name:
        for number, stranger in enumerate(STRANGERS, 1):
            folder = Path(name) / str(number)
            folder.mkdir()
            outcomes.append(outcome(folder, stranger))
            print(number, outcomes[-1]["within 5 %"], stranger.form, outcomes[-1]["what came out"], file=sys.stderr)
        for number, (form, write, command) in enumerate(REFUSED):
            folder = Path(name) / f"refused{number}"
            folder.mkdir()
            write(folder)
            status, output = run(folder, command)
            refused.append({"form": form, "commands": command, "count": str(status), "what came out": output})
    with (OUT / "strangers.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(outcomes[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(outcomes)
    page = (
        HEAD.format(flags=FLAGS) + "| your file | what to type | what came out, dry friction (95 %) |\n|---|---|---|\n"
    )
    for row in outcomes:
        typed = "<br>".join(f"`{line}`" for line in row["commands"].replace(FLAGS, "FLAGS").split(" && "))
        page += f"| {row['form']} | {typed} | {row['what came out']} |\n"
    page += "\nNot read, with what is said instead:\n\n| file | what is said |\n|---|---|\n"
    for row in refused:
        page += f"| {row['form']} | {row['what came out'].replace('|', '/')} |\n"
    (OUT / "strangers.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
