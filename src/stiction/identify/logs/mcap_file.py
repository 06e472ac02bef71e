"""The messages of an MCAP file: every checksum compared, every declared size checked before anything is inflated."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from stiction.formats.errors import LogError
from stiction.formats.tables import LARGEST_TABLE, read_bytes

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
    counted, promised, inflated = 0, None, 0
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
                promised = item.message_count
            elif isinstance(item, Message):
                counted += 1
                channel = channels[item.channel_id]
                topic = Topic(channel.topic, schemas[channel.schema_id])
                yield Packet(topic, channel.message_encoding, item.log_time, item.data)
    if promised is not None and promised != counted:
        raise ValueError(f"{counted} messages; the file says that it has {promised}")


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
