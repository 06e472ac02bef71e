"""MCAP files of ROS 2: joint states and the commands that the joints were given, brought onto the states' stamps.

Needs `pip install "stiction[logs]"`. A state is a `sensor_msgs/msg/JointState`; a command is one too, or a
`std_msgs/msg/Float64MultiArray`, or a `trajectory_msgs/msg/JointTrajectory` of one point. The definitions of these are
ROS's own and known here: those in the file are not parsed. Every checksum is compared, and every declared size is
checked before anything is inflated.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import LogError
from stiction.formats.log import JointSignals, Log
from stiction.formats.tables import LARGEST_TABLE, read_bytes

STATE = "sensor_msgs/msg/JointState"
COMMANDS = (STATE, "std_msgs/msg/Float64MultiArray", "trajectory_msgs/msg/JointTrajectory")

COMMAND_WORDS = ("command", "cmd", "target", "desired", "reference", "setpoint")
"""What a topic of joint states has in its name if it is the command."""

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


@dataclass(frozen=True)
class Topic:
    """A topic of the file."""

    name: str
    """`/joint_states`."""
    schema: str
    """Type of its messages."""


@dataclass(frozen=True)
class Message:
    """A decoded message."""

    received: int
    """When it was received [ns]."""
    content: Any
    """Its fields as attributes."""


@dataclass(frozen=True)
class Packet:
    """A message that is not decoded yet."""

    topic: Topic
    """Where it was sent."""
    encoding: str
    """How; only `cdr` is read."""
    received: int
    """When it was received [ns]."""
    data: bytes
    """Its bytes."""


@dataclass(frozen=True)
class Series:
    """The messages of one topic as arrays, in the order of the file."""

    stamps: np.ndarray
    """When each was made [ns], shape (num_messages,)."""
    by_receipt: bool
    """Whether the stamps are those of receipt, for want of others."""
    names: tuple[str, ...]
    """The joints."""
    values: dict[str, np.ndarray]
    """Field -> values, shape (num_messages, num_joints); fields that are empty are not there."""
    notes: tuple[str, ...] = ()
    """What a reader should know about them."""


def read_ros(path: Path, topics: Mapping[str, str]) -> Log:
    """Read the joints of an MCAP file.

    topics: `state` and `command` -> topic; what is not named is chosen if there is only one candidate. The log's time
    is that of the states' headers, or of their receipt where the headers have none, in seconds from the first; the
    command is held from its stamp to the next. Raises `LogError`.
    """
    wrong = sorted(set(topics) - {"state", "command"})
    if wrong:
        raise LogError(f"{path.name}: {wrong[0]}= maps a column; an MCAP file has topics: state=TOPIC command=TOPIC")
    packets = read_packets(path)
    found = list(dict.fromkeys(packet.topic for packet in packets))
    state, command = choose_topics(path.name, found, topics)
    states = state_series(f"{path.name}: {state.name}", decode(path.name, packets, state))
    notes = list(states.notes)
    joints = {
        name: JointSignals(
            position=states.values["position"][:, index],
            velocity=states.values["velocity"][:, index] if "velocity" in states.values else None,
            torque=states.values["effort"][:, index] if "effort" in states.values else None,
        )
        for index, name in enumerate(states.names)
    }
    stamps = states.stamps
    if command is None:
        notes.append("the file has no command: what the joints were asked for is not known")
    else:
        stamps, joints, said = _with_targets(path.name, states, joints, command, decode(path.name, packets, command))
        notes += said
    return Log(path.name, (stamps - stamps.min()) * 1e-9, joints, notes=tuple(notes))


def _with_targets(
    source: str, states: Series, joints: dict[str, JointSignals], command: Topic, messages: list[Message]
) -> tuple[np.ndarray, dict[str, JointSignals], list[str]]:
    """Return stamps [ns], joints and notes with the command held onto the states' stamps.

    States before the first command are left out: nobody knows what the joint was asked for then.
    """
    commands = command_series(f"{source}: {command.name}", command.schema, messages, states.names)
    notes = list(commands.notes)
    if commands.by_receipt != states.by_receipt:
        notes.append(
            "states and commands are stamped by different clocks (header and receipt): a delay between them is not real"
        )
    order = np.argsort(commands.stamps, kind="stable")
    place = np.searchsorted(commands.stamps[order], states.stamps, side="right") - 1
    known = place >= 0
    if not known.any():
        raise LogError(f"{source}: every state is older than the first command on {command.name}; are the clocks set?")
    if not known.all():
        lost = int(np.count_nonzero(~known))
        notes.append(f"the first {lost} states came before the first command and are left out")
    positions = commands.values["position"][order][place[known]]
    columns = {name: positions[:, index] for index, name in enumerate(commands.names)}
    cut = {}
    for name, signals in joints.items():
        cut_signals = {key: None if value is None else value[known] for key, value in vars(signals).items()}
        cut[name] = JointSignals(**{**cut_signals, "target": columns.get(name)})
    return states.stamps[known], cut, notes


def choose_topics(source: str, found: list[Topic], asked: Mapping[str, str]) -> tuple[Topic, Topic | None]:
    """Return the topic of states and that of commands, None where there is none; raise `LogError` if it is not clear.

    Of several topics of joint states, those with a word for command in their name are commands.
    """
    listing = ", ".join(f"{topic.name} ({topic.schema})" for topic in found[:20]) or "none"
    by_name = {topic.name: topic for topic in found}
    for role, name in asked.items():
        allowed = (STATE,) if role == "state" else COMMANDS
        if name not in by_name or by_name[name].schema not in allowed:
            raise LogError(f"{source}: {role}={name}: expected a topic of {' or '.join(allowed)}; there are {listing}")
    named = {role: by_name[name] for role, name in asked.items()}
    states = [topic for topic in found if topic.schema == STATE and topic.name not in asked.values()]
    orders = [topic for topic in states if any(word in topic.name.lower() for word in COMMAND_WORDS)]
    others = [topic for topic in found if topic.schema in COMMANDS[1:] and topic.name not in asked.values()]
    candidates = {
        "state": [topic for topic in states if topic not in orders] or states,
        "command": [*orders, *others],
    }
    for role in ("state", "command"):
        if role not in named and len(candidates[role]) > 1:
            raise LogError(f"{source}: which topic is the {role}? Say {role}=TOPIC; there are {listing}")
        if role not in named and candidates[role]:
            named[role] = candidates[role][0]
    if "state" not in named:
        raise LogError(f"{source}: no topic of {STATE}; there are {listing}")
    command = named.get("command")
    return named["state"], None if command == named["state"] else command


def decode(source: str, packets: list[Packet], topic: Topic) -> list[Message]:
    """Return the messages of one topic in the order of the file. Raises `LogError`."""
    from mcap.exceptions import McapError
    from mcap.records import Schema
    from mcap_ros2.decoder import DecoderFactory

    schema = Schema(id=1, name=topic.schema, encoding="ros2msg", data=DEFINITIONS[topic.schema].encode())
    decoder = DecoderFactory().decoder_for("cdr", schema)
    if decoder is None:
        raise LogError(f"{source}: {topic.schema} cannot be decoded; is mcap-ros2-support up to date?")
    messages = []
    for packet in packets:
        if packet.topic != topic:
            continue
        if packet.encoding != "cdr":
            raise LogError(f"{source}: {topic.name} is encoded as {packet.encoding[:40]!r}; expected cdr")
        try:
            messages.append(Message(packet.received, decoder(packet.data)))
        except (McapError, *BROKEN_MESSAGE) as error:
            raise LogError(f"{source}: a message on {topic.name} is damaged ({str(error)[:80]})") from error
    return messages


BROKEN_MESSAGE = (struct.error, ValueError, IndexError, KeyError, OverflowError, MemoryError, RuntimeError, TypeError)
"""What the decoder lets through for damaged messages; `UnicodeDecodeError` is of the second kind."""

BROKEN_FILE = (struct.error, ValueError, KeyError, OverflowError, MemoryError, RuntimeError, zlib.error, TypeError)
"""What mcap, zstandard and lz4 let through for damaged files besides their own exceptions."""


def read_packets(path: Path) -> list[Packet]:
    """Return every message, in the order of the file; raise `LogError` for a damaged or incomplete file, and without
    the libraries.
    """
    try:
        import zstandard
        from mcap.exceptions import McapError
    except ImportError as error:
        raise LogError(f'{path.name}: MCAP needs mcap and mcap-ros2-support: pip install "stiction[logs]"') from error
    content = read_bytes(path)
    try:
        return list(_walk(content))
    except (McapError, zstandard.ZstdError, *BROKEN_FILE) as error:
        what = str(error)[:100] or type(error).__name__
        raise LogError(
            f"{path.name}: not a whole MCAP file ({what}); `mcap recover` may save what there is of it"
        ) from error


def _walk(content: bytes) -> Iterator[Packet]:
    """Yield the messages; compare checksums, and at the end their number with what the file says of itself."""
    from mcap.records import Channel, Chunk, Message, Schema, Statistics
    from mcap.stream_reader import StreamReader, breakup_chunk

    reader = StreamReader(io.BytesIO(content), emit_chunks=True, validate_crcs=True, record_size_limit=len(content))
    schemas: dict[int, str] = {0: ""}
    channels: dict[int, Any] = {}
    counted, declared, inflated = 0, None, 0
    for record in reader.records:
        records = [record]
        if isinstance(record, Chunk):
            inflated += record.uncompressed_size
            if inflated > LARGEST_TABLE:
                raise ValueError(f"would inflate to {inflated} bytes; at most {LARGEST_TABLE} are read")
            records = breakup_chunk(replace(record, compression="", data=_inflate(record)), validate_crc=True)
        for item in records:
            if isinstance(item, Schema):
                schemas[item.id] = item.name
            elif isinstance(item, Channel):
                channels[item.id] = item
            elif isinstance(item, Statistics):
                declared = item.message_count
            elif isinstance(item, Message):
                counted += 1
                channel = channels[item.channel_id]
                topic = Topic(channel.topic, schemas[channel.schema_id])
                yield Packet(topic, channel.message_encoding, item.log_time, item.data)
    if declared is not None and declared != counted:
        raise ValueError(f"{counted} messages; the file says that it has {declared}")


def _inflate(chunk: Any) -> bytes:
    """Return a chunk's records, no more bytes than it declares; raise `ValueError` if there are fewer or more."""
    import lz4.frame
    import zstandard

    size = chunk.uncompressed_size
    if chunk.compression == "zstd":
        data = zstandard.ZstdDecompressor().stream_reader(chunk.data).read(size + 1)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
    elif chunk.compression == "":
        data = chunk.data
    else:
        raise ValueError(f"compression {chunk.compression[:20]!r} is not known")
    if len(data) != size:
        raise ValueError(f"a chunk inflates to {len(data)} bytes or more; {size} were declared")
    return data


def state_series(source: str, messages: list[Message]) -> Series:
    """Return position, velocity and effort of `JointState` messages; raise `LogError` where they do not fit together.

    source: file and topic, for messages.
    """
    if not messages:
        raise LogError(f"{source}: no messages")
    names, columns = _joint_order(source, [message.content.name for message in messages])
    values = {}
    for field in ("position", "velocity", "effort"):
        rows = [getattr(message.content, field) for message in messages]
        if any(rows):
            values[field] = _stack(source, field, rows, columns)
    if "position" not in values:
        raise LogError(f"{source}: the messages have no positions")
    stamps, by_receipt = _stamps(messages)
    note = f"{source.rpartition(' ')[2]}: the headers have no stamps; the times of receipt are used, jitter included"
    return Series(stamps, by_receipt, names, values, (note,) if by_receipt else ())


def command_series(source: str, schema: str, messages: list[Message], joints: tuple[str, ...]) -> Series:
    """Return the positions asked for.

    schema: the messages' type. joints: the states' joints, in whose order a `Float64MultiArray` must be. Raises
    `LogError`.
    """
    if schema == STATE:
        return state_series(source, messages)
    if not messages:
        raise LogError(f"{source}: no messages")
    topic = source.rpartition(" ")[2]
    if schema == COMMANDS[1]:
        rows = [message.content.data for message in messages]
        order = [list(range(len(joints)))] * len(rows)
        note = (
            f"{topic}: the commands name no joints; they are taken in the states' order, {', '.join(joints[:3])}, ..."
        )
        receipt = np.array([message.received for message in messages], dtype=np.int64)
        return Series(receipt, True, joints, {"position": _stack(source, "data", rows, order)}, (note,))
    points = [message.content.points for message in messages]
    if any(len(point) != 1 for point in points):
        raise LogError(
            f"{source}: trajectories of several points: what the controller made of them is not in this topic; log the "
            "positions that it asked for"
        )
    names, columns = _joint_order(source, [message.content.joint_names for message in messages])
    values = _stack(source, "positions", [point[0].positions for point in points], columns)
    stamps, by_receipt = _stamps(messages)
    after = [point[0].time_from_start for point in points]
    delay = np.array([wait.sec * 10**9 + wait.nanosec for wait in after], dtype=np.int64)
    return Series(stamps + delay, by_receipt, names, {"position": values})


def _joint_order(source: str, listed: list[Any]) -> tuple[tuple[str, ...], list[list[int]]]:
    """Return the joints of the first message, and where each of them stands in every message."""
    names = tuple(listed[0])
    if not names or len(set(names)) != len(names) or not all(names):
        raise LogError(
            f"{source}: the first message names the joints {list(names)[:6]}; expected one different name each"
        )
    columns = []
    for own in listed:
        index = {name: place for place, name in enumerate(own)}
        if len(own) != len(names) or index.keys() != set(names):
            raise LogError(
                f"{source}: a message names other joints than the first; expected one publisher on this topic"
            )
        columns.append([index[name] for name in names])
    return names, columns


def _stack(source: str, field: str, rows: list[Any], columns: list[list[int]]) -> np.ndarray:
    """Return a field as a matrix, its columns in the order of the first message's joints."""
    wrong = next((index for index, row in enumerate(rows) if len(row) != len(columns[index])), None)
    if wrong is not None:
        raise LogError(
            f"{source}: {field} of message {wrong + 1} has {len(rows[wrong])} values for {len(columns[wrong])} joints"
        )
    return np.take_along_axis(np.array(rows, dtype=float), np.array(columns), axis=1)


def _stamps(messages: list[Message]) -> tuple[np.ndarray, bool]:
    """Return the headers' stamps [ns], or the times of receipt where some header has none; and which it was."""
    headers = [message.content.header.stamp for message in messages]
    stamps = np.array([stamp.sec * 10**9 + stamp.nanosec for stamp in headers], dtype=np.int64)
    if stamps.all():
        return stamps, False
    return np.array([message.received for message in messages], dtype=np.int64), True
