"""Bags of ROS 1 and 2, `.bag`, MCAP and rosbag2's SQLite, by rosbags: a row a joint state; run in `apart` only.

A state is a `sensor_msgs/msg/JointState` or Unitree's `LowState`; a command a joint state too, or a
`std_msgs/msg/Float64MultiArray`, a `trajectory_msgs/msg/JointTrajectory` of one point, or Unitree's `LowCmd`; what the
body measures a `sensor_msgs/msg/Imu` or Unitree's `LowState`. Their types are those of ROS, as rosbags has them:
definitions in the file are not used. Messages are decoded as they come, and of each no more is kept than its numbers.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import LogError
from stiction.core.extras import remedy
from stiction.core.files import open_regular
from stiction.core.rotation import continuous
from stiction.files.tables import WIDEST_MATRIX, Columns, Table
from stiction.files.unitree import MOTORS, STRUCTURES
from stiction.identification.logs.naming import AXES, COMMAND_WORDS, STEMS, TOPICS
from stiction.identification.logs.records import Records

STATE, ARRAY = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64MultiArray"
TRAJECTORY, IMU = "trajectory_msgs/msg/JointTrajectory", "sensor_msgs/msg/Imu"
LOW_STATES = tuple(kind for kind in STRUCTURES if kind.endswith("State"))

KINDS = {
    "state": (STATE, *LOW_STATES),
    "command": (STATE, ARRAY, TRAJECTORY, *(kind for kind in STRUCTURES if kind not in LOW_STATES)),
    "imu": (IMU, *LOW_STATES),
}
"""Role of a topic -> types of its messages; a joint state is a command by its topic's name."""

LARGEST_MESSAGE = 2**16
"""Largest message about joints [B]: 256 joints with names of 64 letters take 24 kB."""


Decode = Callable[[bytes, str], Any]


@dataclass(frozen=True)
class Topic:
    """Topic of the file."""

    name: str
    """Name, such as `/joint_states`."""
    schema: str
    """Type of its messages, `sensor_msgs/msg/JointState`; in ROS 1 too."""


def read_bag(path: Path, topics: Mapping[str, str], body: bool = False) -> Table:
    """Read the joints of a bag as columns `position.<joint>` and so on, and those of the body if requested.

    topics: `state`, `command` and `imu` -> topic; a role without a topic gets the only candidate. The
    `time` is that of the states' headers, or of their receipt where the headers have none, in seconds from the first;
    the command is held from its stamp to the next, the body's signals are interpolated. Raises `LogError`.
    """
    if wrong := sorted(set(topics) - set(TOPICS)):
        raise LogError(f"{path.name}: {wrong[0]}= maps a column; a bag has topics: state=TOPIC command=TOPIC")
    with _opened(path) as (bag, decode):
        known = [Topic(connection.topic, connection.msgtype) for connection in bag.connections]
        chosen = choose_topics(path.name, list(dict.fromkeys(known)), topics, body)
        wanted = [
            connection for connection, topic in zip(bag.connections, known, strict=True) if topic in chosen.values()
        ]
        base, series = _collect(path.name, bag.messages(wanted), decode, chosen)
        if (count := sum(connection.count for connection in series.values())) != (
            promised := sum(connection.msgcount for connection in wanted)
        ):
            raise ValueError(f"{count} messages; the file says that it has {promised}")
    columns, stamps, received = _columns(series[chosen["state"]])
    rows, notes, period = np.ones(len(stamps), bool), [], None
    if received:
        name = chosen["state"].name
        notes.append(f"{name}: the headers have no stamps; the times of receipt are used, jitter included")
    if "command" in chosen:
        asked, sent, by_receipt = _columns(series[chosen["command"]])
        targets, target_notes = _targets(chosen["command"], asked, columns)
        held, rows = _held(path.name, chosen["command"].name, sent, stamps)
        columns |= {name: values[held] for name, values in targets.items()}
        notes += target_notes
        if by_receipt != received:
            notes.append(
                "states and commands are stamped by different clocks (header and receipt): a delay between them is not "
                "real"
            )
        if not rows.all():
            notes.append(f"the first {np.sum(~rows)} states came before the first command and are left out")
    else:
        notes.append("the file has no command: what the joints were asked for is not known")
    first = stamps[rows].min()
    if "imu" in chosen:
        measured, sent, by_receipt = _columns(series[chosen["imu"]])
        columns |= _interpolated(measured, sent, stamps)
        rows &= (stamps >= sent.min()) & (stamps <= sent.max())
        name, period = chosen["imu"].name, 1e-9 * float(np.median(np.diff(np.sort(sent)))) if len(sent) > 1 else None
        if not rows.any():
            raise LogError(f"{path.name}: {name} and the joints do not overlap in time; are the clocks set?")
        if by_receipt != received:
            notes.append(f"{name} and the joints are stamped by different clocks: a delay between them is not seen")
    columns = {"time": (stamps - first) * 1e-9} | columns
    columns = {name: values[rows] for name, values in columns.items()}
    return Table(columns, tuple(notes), starts={"time": (base + int(first)) * 1e-9}, period=period)


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, Decode]]:
    """Yield rosbags' reader of a bag, and the function that turns bytes and type of a message into an object.

    Raises `LogError` where the bag is damaged or incomplete, also while it is read, or the library is missing.
    """
    try:
        from rosbags.rosbag1 import Reader as Reader1
        from rosbags.rosbag2 import Reader as Reader2
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise LogError(f"{path.name}: bags need rosbags; {remedy('logs')}") from error
    ros1 = path.suffix.lower() == ".bag"
    types = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    try:
        with open_regular(path) as file:  # a pipe would be waited for
            if path.suffix.lower() == ".db3":
                _check_pages(path.name, file.read(100), os.fstat(file.fileno()).st_size)
        with (Reader1 if ros1 else Reader2)(path) as reader:
            if len(reader.connections) > 10_000:
                raise ValueError(f"{len(reader.connections)} topics")
            encodings = {getattr(connection.ext, "serialization_format", "cdr") for connection in reader.connections}
            if odd := sorted(encodings - {"cdr", ""}):
                raise LogError(f"{path.name}: messages are encoded as {odd[0][:40]!r}; expected cdr")
            yield reader, types.deserialize_ros1 if ros1 else types.deserialize_cdr
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror or error}") from error
    except LogError:
        raise
    # Whatever a damaged file has the library raise, asserts and want of memory included; this process ends with it.
    except Exception as error:
        cause = str(error)[:100] or type(error).__name__
        advice = "`mcap recover` or `ros2 bag convert` may save it"
        raise LogError(f"{path.name}: not a whole bag ({cause}); {advice}") from error


def _check_pages(source: str, head: bytes, size: int) -> None:
    """Reject a file that is not SQLite, and one that was cut off: its number of pages is not what it says."""
    if not head.startswith(b"SQLite format 3\0") or len(head) < 100:
        raise LogError(f"{source}: not a rosbag2 database, which is an SQLite file")
    # A page of 65536 bytes does not fit into the field, and the format writes 1 for it.
    page, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
    if (65536 if page == 1 else page) * pages != size:
        raise LogError(f"{source}: {size} bytes; it says that it has {pages} pages: it was cut off, get it again")


def choose_topics(source: str, known: list[Topic], asked: Mapping[str, str], body: bool = False) -> dict[str, Topic]:
    """Return role -> topic, `state` and, if present, `command` and `imu`; raise `LogError` if the choice is unclear.

    asked: role -> name of a topic; body: True if the IMU is wanted. Of several topics of joint states, those with a
    word for command in their name are commands.
    """
    listing = ", ".join(f"{topic.name} ({topic.schema})" for topic in known[:20]) or "none"
    chosen: dict[str, Topic] = {}
    for role, name in asked.items():
        fitting = [topic for topic in known if topic.name == name and topic.schema in KINDS[role]]
        if not fitting:
            expected = " or ".join(KINDS[role])
            raise LogError(f"{source}: {role}={name}: expected a topic of {expected}; there are {listing}")
        chosen[role] = fitting[0]
    left = [topic for topic in known if topic not in (chosen.get("state"), chosen.get("command"))]
    states = [topic for topic in left if topic.schema in KINDS["state"]]
    orders = [
        topic for topic in states if topic.schema == STATE and any(word in topic.name.lower() for word in COMMAND_WORDS)
    ]
    candidates = {
        "state": [topic for topic in states if topic not in orders] or states,
        "command": orders + [topic for topic in left if topic.schema in KINDS["command"][1:]],
        "imu": [topic for topic in known if topic.schema in KINDS["imu"] and body],
    }
    for role, fitting in candidates.items():
        # A state of Unitree's says of the body what it says of the joints.
        fitting = [chosen["state"]] if role == "imu" and chosen["state"] in fitting else fitting
        if role not in chosen and len(fitting) > 1:
            raise LogError(f"{source}: which topic is the {role}? Say {role}=TOPIC; there are {listing}")
        if role not in chosen and fitting:
            chosen[role] = fitting[0]
        if "state" not in chosen:
            raise LogError(f"{source}: no topic of {' or '.join(KINDS['state'])}; there are {listing}")
    if chosen.get("command") == chosen["state"]:
        del chosen["command"]
    return chosen


def _collect(
    source: str, messages: Iterable[Any], decode: Decode, chosen: Mapping[str, Topic]
) -> tuple[int, dict[Topic, Records]]:
    """Return a time [ns], and the messages of each topic, whose columns `header` and `receipt` count from it [ns].

    decode: function from bytes and a type to a message. Raises `LogError`.
    """
    series, base = {topic: Records(f"{source}: {topic.name}") for topic in chosen.values()}, 0
    for connection, received, data in messages:
        records = series[Topic(connection.topic, connection.msgtype)]
        if len(data) > LARGEST_MESSAGE:
            raise LogError(
                f"{source}: a message on {connection.topic} has {len(data)} bytes; expected at most {LARGEST_MESSAGE}"
            )
        try:
            stamp, delay, cells = _content(records.source, connection.msgtype, decode, bytes(data))
            # Subtracted as integers: since 1970 there are more nanoseconds than a float has digits for.
            base = base or stamp or received
            header = float(stamp + delay - base) if stamp else None
            records.add([("header", header), ("receipt", float(received + delay - base)), *cells])
        except LogError:
            raise
        except Exception as error:
            cause = str(error)[:80] or type(error).__name__
            raise LogError(f"{source}: a message on {connection.topic} is damaged ({cause})") from error
    return base, series


def _content(source: str, kind: str, decode: Decode, data: bytes) -> tuple[int, int, Iterable[tuple[str, float]]]:
    """Return a message's stamp, 0 where it has none, the delay to add to it [ns], and columns and numbers."""
    if kind in STRUCTURES:
        return 0, 0, _of_unitree(kind, data)
    message = decode(data, kind)
    if kind == ARRAY:
        return 0, 0, [(f"position.{index}", value) for index, value in enumerate(message.data.tolist())]
    stamp = _nanoseconds(message.header.stamp)
    if kind == IMU:
        parts = {"gyroscope": message.angular_velocity, "accelerometer": message.linear_acceleration}
        if message.orientation_covariance[0] != -1:  # the type's word for no orientation
            parts["quaternion"] = message.orientation
        cells = [(f"{role}.{axis}", getattr(part, axis)) for role, part in parts.items() for axis in AXES[role]]
        return stamp, 0, cells
    if kind == STATE:
        fields = {"position": message.position, "velocity": message.velocity, "torque": message.effort}
        return stamp, 0, _of_joints(source, message.name, fields)
    if len(message.points) != 1:
        raise LogError(
            f"{source}: trajectories of several points: what the controller made of them is not in this topic; log the "
            "positions that it asked for"
        )
    # The point of a trajectory counts from its stamp plus its delay.
    (point,) = message.points
    cells = _of_joints(source, message.joint_names, {"position": point.positions})
    return stamp, _nanoseconds(point.time_from_start), cells


def _nanoseconds(stamp: Any) -> int:
    """Return a time or a duration of ROS [ns]."""
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def _of_joints(source: str, names: list[str], fields: Mapping[str, np.ndarray]) -> list[tuple[str, float]]:
    """Return columns and numbers of joints, which may come in another order each time; a field may be empty."""
    if not names or len(set(names)) != len(names) or not all(names) or len(names) > WIDEST_MATRIX:
        raise LogError(f"{source}: a message names the joints {names[:6]}; expected one different name each")
    cells: list[tuple[str, float]] = []
    for role, values in fields.items():
        if len(values) not in (0, len(names)):
            raise LogError(f"{source}: a message has {len(values)} values of {role} for {len(names)} joints")
        cells += zip([f"{role}.{name}" for name in names], values.tolist(), strict=False)
    return cells


def _of_unitree(kind: str, data: bytes) -> Iterator[tuple[str, float]]:
    """Yield columns and numbers, of all motors, used or not, and of the body.

    A message that ends with its motors, as old firmware and bridges write it, has no feet.
    """
    structure, motors = STRUCTURES[kind], MOTORS[kind]
    message = structure.from_wire(data, whole_to=motors)
    for field in ("q", "dq", "tau_est") if kind in LOW_STATES else ("q", "kp", "kd"):
        for index, value in enumerate(message[motors][field].tolist()):
            yield f"{motors}[{index}].{field}", value
    body = {role: message["imu_state"][role] for role in AXES} if kind in LOW_STATES else {}
    if "foot_force" in (structure.dtype.names or ()) and len(data) - 4 >= structure.wire_end("foot_force"):
        body["foot_force"] = message["foot_force"]
    for role, values in body.items():
        yield from ((f"{role}.{axis}", value) for axis, value in enumerate(values.tolist()))


def _columns(records: Records) -> tuple[Columns, np.ndarray, bool]:
    """Return columns, stamps [ns], and True if these are of receipt, for want of others; shape (num_messages,) each.

    Raises `LogError` where there are no messages, or not the same columns in each.
    """
    if not records.count:
        raise LogError(f"{records.source}: no messages")
    table = records.table()
    columns = dict(table.columns)
    # All or none: times by two clocks cannot be put in one order.
    header, receipt = columns.pop("header"), columns.pop("receipt")
    missing = (f"{name} is not in every message" for name in table.blanks if name in columns)
    if odd := [*table.faults.values(), *missing]:
        raise LogError(f"{records.source}: {odd[0]}; expected the same joints and fields in each, of one publisher")
    if not any(name.startswith(("position.", "motor_", "gyroscope.")) for name in columns):
        raise LogError(f"{records.source}: the messages have no positions")
    return columns, *((receipt, True) if "header" in table.blanks else (header, False))


def _targets(topic: Topic, asked: Columns, states: Columns) -> tuple[Columns, list[str]]:
    """Return the targets of the states' joints, in whose order an array's must be, and notes. Raises `LogError`."""
    joints = [name.removeprefix("position.") for name in states if name.startswith("position.")]
    if topic.schema == ARRAY:
        if len(asked) != len(joints):
            raise LogError(f"{topic.name}: its messages have {len(asked)} values for {len(joints)} joints")
        order = f"they are taken in the states' order, {', '.join(joints[:3])}, ..."
        targets = {f"target.{joint}": values for joint, values in zip(joints, asked.values(), strict=True)}
        return targets, [f"{topic.name}: the commands name no joints; {order}"]
    if topic.schema not in STRUCTURES:
        return {f"target.{name}": asked[f"position.{name}"] for name in joints if f"position.{name}" in asked}, []
    moving = [name for name, values in states.items() if re.fullmatch(r"motor_state\[\d+\]\.q", name) and values.any()]
    motors = [name.removesuffix(".q").replace("state", "cmd") for name in moving]
    gains = {gain: [asked[f"{motor}.{gain}"] for motor in motors] for gain in ("kp", "kd")}
    notes = []
    if motors and not any(np.ptp(values) for sent in gains.values() for values in sent):
        words = "; ".join(f"{gain} {', '.join(f'{values[0]:.4g}' for values in sent)}" for gain, sent in gains.items())
        notes = [f"{topic.name}: the commands carry the gains {words}: say so in the sidecar, or by --kp and --kd"]
    return {f"{motor}.q": asked[f"{motor}.q"] for motor in motors}, notes


def _held(source: str, name: str, sent: np.ndarray, stamps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the index of the last command at or before each state, and a mask of states with one. Raises `LogError`.

    States before the first command are left out: their target is not known.
    """
    order = np.argsort(sent, kind="stable")
    place = np.searchsorted(sent[order], stamps, side="right") - 1
    if not (place >= 0).any():
        raise LogError(f"{source}: every state is older than the first command on {name}; are the clocks set?")
    return order[place], place >= 0


def _interpolated(columns: Columns, times: np.ndarray, stamps: np.ndarray) -> Columns:
    """Return the body's columns, which were measured at some times [ns], at stamps [ns]."""
    order = np.argsort(times, kind="stable")
    body = {name: values[order] for name, values in columns.items() if name.partition(".")[0] in STEMS}
    turns = [name for name in body if name.startswith("quaternion.")]
    attitude = np.column_stack([body.pop(name) for name in turns]) if turns else np.zeros((1, 4))
    if attitude.any():  # zero is how the types say that it is not known
        # q and -q are one attitude; interpolated between the two, it would pass through zero.
        body |= dict(zip(turns, continuous(attitude).T, strict=True))
    since, wanted = (times[order] - times.min()) * 1e-9, (stamps - times.min()) * 1e-9
    return {name: np.interp(wanted, since, values) for name, values in body.items()}
