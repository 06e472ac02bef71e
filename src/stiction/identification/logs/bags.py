"""Bags of ROS 1 and 2, `.bag`, MCAP and rosbag2's SQLite, by rosbags: messages one by one, in `apart` alone.

The types of joint states, commands and IMUs are ROS's own, as rosbags has them: definitions in the file are not used.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stiction.core.errors import LogError
from stiction.core.extras import remedy
from stiction.core.files import open_regular

LARGEST_MESSAGE = 2**16
"""Bytes of a message about joints: 256 joints with names of 64 letters take 24 kB."""

MOST_TOPICS = 10_000
"""No robot publishes more."""


@dataclass(frozen=True)
class Topic:
    """A topic of the file."""

    name: str
    """`/joint_states`."""
    schema: str
    """Type of its messages, `sensor_msgs/msg/JointState`; in ROS 1 too."""


@dataclass(frozen=True)
class Packet:
    """A message as it lies in the file."""

    topic: Topic
    """Where it was published."""
    received: int
    """When it was received [ns]."""
    data: bytes
    """Its bytes: CDR, or those of ROS 1."""


class Bag:
    """An open bag."""

    def __init__(self, path: Path) -> None:
        """Open a bag; raise `LogError` where it is damaged or incomplete, or the library is missing."""
        try:
            from rosbags.rosbag1 import Reader as Reader1
            from rosbags.rosbag2 import Reader as Reader2
            from rosbags.typesys import Stores, get_typestore
        except ImportError as error:
            raise LogError(f"{path.name}: bags need rosbags; {remedy('logs')}") from error
        self.path, self.ros1 = path, path.suffix.lower() == ".bag"
        self._types = get_typestore(Stores.ROS1_NOETIC if self.ros1 else Stores.ROS2_HUMBLE)
        if path.suffix.lower() == ".db3":
            _check_pages(path)
        try:
            with open_regular(path):  # a pipe would be waited for
                pass
            self._reader: Any = (Reader1 if self.ros1 else Reader2)(path)
            self._reader.open()
            connections = self._reader.connections
            if len(connections) > MOST_TOPICS:
                raise ValueError(f"{len(connections)} topics")
            odd = {getattr(one.ext, "serialization_format", "cdr") for one in connections} - {"cdr", ""}
            if odd:
                raise LogError(f"{path.name}: messages are encoded as {sorted(odd)[0][:40]!r}; expected cdr")
        except OSError as error:
            raise LogError(f"cannot read {path}: {error.strerror or error}") from error
        except LogError:
            raise
        # Whatever a damaged file has the library raise, asserts included; this process ends with it.
        except Exception as error:
            raise self._damaged(error) from error
        self.topics = list(dict.fromkeys(Topic(one.topic, one.msgtype) for one in connections))

    def packets(self, *topics: Topic) -> Iterator[Packet]:
        """Yield the messages of some topics, in the order of their receipt; raise `LogError` for damage."""
        wanted = [one for one in self._reader.connections if Topic(one.topic, one.msgtype) in topics]
        promised, count = sum(one.msgcount for one in wanted), 0
        try:
            for connection, received, data in self._reader.messages(wanted) if wanted else ():
                topic, count = Topic(connection.topic, connection.msgtype), count + 1
                if len(data) > LARGEST_MESSAGE:
                    raise LogError(
                        f"{self.path.name}: a message on {topic.name} has {len(data)} bytes; expected at most "
                        f"{LARGEST_MESSAGE}"
                    )
                yield Packet(topic, received, bytes(data))
            if count != promised:
                raise ValueError(f"{count} messages; the file says that it has {promised}")
        except (LogError, MemoryError):
            raise
        except Exception as error:
            raise self._damaged(error) from error

    def decode(self, packet: Packet) -> Any:
        """Return a message as an object with its fields; raise `ValueError` for damage."""
        try:
            turn = self._types.deserialize_ros1 if self.ros1 else self._types.deserialize_cdr
            return turn(packet.data, packet.topic.schema)
        except MemoryError:
            raise
        except Exception as error:
            raise ValueError(str(error) or type(error).__name__) from error

    def _damaged(self, error: Exception) -> LogError:
        what = str(error)[:100] or type(error).__name__
        return LogError(f"{self.path.name}: not a whole bag ({what}); `mcap recover` or `ros2 bag convert` may save it")


def _check_pages(path: Path) -> None:
    """Refuse what is no SQLite file, and one that was cut off: it has as many pages as it says."""
    try:
        with open_regular(path) as file:
            head, size = file.read(100), os.fstat(file.fileno()).st_size
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror or error}") from error
    if not head.startswith(b"SQLite format 3\0") or len(head) < 100:
        raise LogError(f"{path.name}: not a rosbag2 database, which is an SQLite file")
    # A page of 65536 bytes does not fit into the field, and the format writes 1 for it.
    page, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
    if (65536 if page == 1 else page) * pages != size:
        raise LogError(f"{path.name}: {size} bytes; it says that it has {pages} pages: it was cut off, get it again")
