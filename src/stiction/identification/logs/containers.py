"""Files of messages, MCAP and rosbag2's SQLite: their packets one by one, of any type, nothing decoded.

Every checksum is compared, every declared size is checked before anything is inflated, and no more than a chunk is in
memory. A database is opened for reading alone, and none of its views, triggers or functions is ever run.
"""

from __future__ import annotations

import io
import sqlite3
import struct
import zlib
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stiction.core.errors import LogError
from stiction.core.extras import remedy
from stiction.core.files import open_regular
from stiction.core.memory import allowance, check_ratio, claim

LARGEST_MESSAGE = 2**16
"""Bytes of a message about joints: 256 joints with names of 64 letters take 24 kB."""

PATIENCE = 5_000_000
"""A hundredth of the instructions that the database's machine may spend on a file; a plain read takes less than ten a
message."""


@dataclass(frozen=True)
class Topic:
    """A topic of the file."""

    name: str
    """`/joint_states`."""
    schema: str
    """Type of its messages."""


@dataclass(frozen=True)
class Packet:
    """A message as it lies in the file."""

    topic: Topic
    """Where it was published."""
    encoding: str
    """How; `cdr` in ROS 2."""
    received: int
    """When it was received [ns]."""
    data: bytes
    """Its bytes."""


BROKEN_FILE = (struct.error, ValueError, KeyError, OverflowError, RuntimeError, zlib.error, TypeError, IndexError)
"""What mcap, zstandard and lz4 let through for damaged files besides their own exceptions."""


def read_packets(path: Path) -> Iterator[Packet]:
    """Yield every message, in the order of the file.

    Raises `LogError` for a damaged or incomplete file, and where the libraries are missing.
    """
    if path.suffix.lower() == ".db3":
        yield from _database(path)
        return
    try:
        import zstandard
        from mcap.exceptions import McapError
    except ImportError as error:
        raise LogError(f"{path.name}: MCAP needs mcap and mcap-ros2-support; {remedy('logs')}") from error
    try:
        with open_regular(path) as file:
            # The size is the bound for all that the file declares of itself.
            size = path.stat().st_size
            yield from _mcap(path.name, _Bounded(file, size), size)
    except (McapError, zstandard.ZstdError, *BROKEN_FILE) as error:
        what = str(error)[:100] or type(error).__name__
        raise LogError(
            f"{path.name}: not a whole MCAP file ({what}); `mcap recover` may save what there is of it"
        ) from error
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror or error}") from error


class _Bounded:
    """A file of which no more is asked at a time than it has left: a buffer is allocated before it is filled."""

    def __init__(self, file: Any, size: int) -> None:
        self.file, self.left = file, size

    def read(self, size: int = -1) -> bytes:
        """Return at most `size` bytes."""
        data: bytes = self.file.read(self.left if size < 0 else min(size, self.left))
        self.left -= len(data)
        return data


def _mcap(source: str, file: Any, size: int) -> Iterator[Packet]:
    """Yield the messages; compare checksums, and at the end their number with what the file says of itself."""
    from mcap.records import Channel, Chunk, Message, Schema, Statistics
    from mcap.stream_reader import StreamReader

    # Chunks come as they are: the reader itself would inflate one before anybody has looked at its size.
    reader = StreamReader(file, emit_chunks=True, validate_crcs=True, record_size_limit=min(size, allowance()))
    # Zero is the format's word for a channel without a schema.
    schemas: dict[int, str] = {0: ""}
    channels: dict[int, Any] = {}
    counted, declared, inflated = 0, None, 0
    for record in reader.records:
        if isinstance(record, Chunk):
            inflated += record.uncompressed_size
            claim(source, 2 * record.uncompressed_size, "a chunk would inflate to half of", LogError)
            check_ratio(source, size, inflated, LogError)
        for item in _records(_inflate(record), record.uncompressed_crc) if isinstance(record, Chunk) else (record,):
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


def _records(data: bytes, crc: int) -> Iterator[Any]:
    """Yield the records of a chunk one by one: schemas, channels and messages; raise `ValueError` for damage."""
    from mcap.data_stream import ReadDataStream
    from mcap.opcode import Opcode
    from mcap.records import Channel, Message, Schema

    kinds: dict[int, Any] = {int(Opcode.SCHEMA): Schema, int(Opcode.CHANNEL): Channel, int(Opcode.MESSAGE): Message}
    # Zero says that no checksum was computed.
    if crc and zlib.crc32(data) != crc:
        raise ValueError("a chunk's checksum is wrong")
    # Not mcap's `breakup_chunk`, which inflates unasked and makes a list of all records.
    place = 0
    while place < len(data):
        kind, size = struct.unpack_from("<BQ", data, place)
        place += 9
        if size > len(data) - place:
            raise ValueError(f"cut off: a record of {size} bytes, {len(data) - place} are left")
        record: Any = kinds.get(kind)
        if record is Message:
            yield Message.read(ReadDataStream(io.BytesIO(data[place : place + size])), size)
        elif record is not None:
            yield record.read(ReadDataStream(io.BytesIO(data[place : place + size])))
        place += size


def _inflate(chunk: Any) -> bytes:
    """Return a chunk's records, no more bytes than it declares; raise `ValueError` if there are fewer or more."""
    import lz4.frame
    import zstandard

    # One byte more than declared is asked for, or a chunk that goes on would look like a whole one.
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


COLUMNS = {
    "topics": ("id", "name", "type", "serialization_format"),
    "messages": ("id", "topic_id", "timestamp", "data"),
}
"""Table of a rosbag2 database -> what is read of it."""


def _database(path: Path) -> Iterator[Packet]:
    """Yield the messages of a rosbag2 database."""
    _check_pages(path)
    try:
        # Immutable: no lock is taken, and no journal or write-ahead log beside the file is looked at.
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)) as base:
            _restrict(path.name, base)
            topics: dict[int, tuple[Topic, str]] = {}
            for number, name, kind, encoding in base.execute("SELECT id, name, type, serialization_format FROM topics"):
                if not (isinstance(name, str) and isinstance(kind, str) and isinstance(encoding, str)):
                    raise ValueError("a topic without name or type")
                topics[number] = (Topic(name, kind), encoding)
            last = 0
            for number, topic, stamp, data in base.execute(
                "SELECT id, topic_id, timestamp, data FROM messages ORDER BY id"
            ):
                # The recorder numbers its messages from one on: a number that is missing is a message that was lost.
                if number != last + 1:
                    raise ValueError(f"message {last + 1} is missing")
                if not isinstance(stamp, int) or not isinstance(data, bytes):
                    raise ValueError(f"message {number} has no stamp, or no bytes")
                last = number
                yield Packet(*topics[topic], stamp, data)
    except (sqlite3.Error, ValueError, KeyError, OverflowError) as error:
        what = str(error)[:100] or type(error).__name__
        raise LogError(
            f"{path.name}: not a whole rosbag2 database ({what}); `ros2 bag convert` may save what there is of it"
        ) from error


def _check_pages(path: Path) -> None:
    """Refuse what is no SQLite file, and one that was cut off: it has as many pages as it says."""
    try:
        with open_regular(path) as file:
            head, size = file.read(100), path.stat().st_size
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror or error}") from error
    if not head.startswith(b"SQLite format 3\0") or len(head) < 100:
        raise LogError(f"{path.name}: not a rosbag2 database, which is an SQLite file")
    # A page of 65536 bytes does not fit into the field, and the format writes 1 for it.
    page = int.from_bytes(head[16:18], "big")
    pages = int.from_bytes(head[28:32], "big")
    if (65536 if page == 1 else page) * pages != size:
        raise LogError(f"{path.name}: {size} bytes; it says that it has {pages} pages: it was cut off, get it again")


def _restrict(source: str, base: sqlite3.Connection) -> None:
    """Let the database be read and nothing else: two plain tables, no functions, bounded cells, a bounded effort."""
    # The checks need pragmas and the schema's own table, which the authorizer denies, so that it is set behind them.
    base.execute("PRAGMA trusted_schema = OFF")
    base.execute("PRAGMA cell_size_check = ON")
    base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(allowance(), 2**30))
    kinds = {name: kind for kind, name in base.execute("SELECT type, name FROM sqlite_schema")}
    for table, wanted in COLUMNS.items():
        found = [row[1] for row in base.execute(f"PRAGMA table_info({table})")]
        if kinds.get(table) != "table" or not set(wanted) <= set(found):
            raise LogError(f"{source}: an SQLite file without the table {table} of rosbag2")
    (state,) = base.execute("PRAGMA quick_check(1)").fetchone()
    if state != "ok":
        raise ValueError(str(state))

    def allowed(action: int, first: str | None, second: str | None, where: str | None, trigger: str | None) -> int:
        plain = action == sqlite3.SQLITE_SELECT or (action == sqlite3.SQLITE_READ and first in COLUMNS)
        return sqlite3.SQLITE_OK if plain and trigger is None else sqlite3.SQLITE_DENY

    base.set_authorizer(allowed)
    steps = 0

    def tire() -> int:
        nonlocal steps
        steps += 1
        return int(steps * 1000 > PATIENCE * 100)

    base.set_progress_handler(tire, 1000)
