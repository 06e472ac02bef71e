"""Messages between our own processes: named vectors of float64 with a kind, a number, a time and a checksum.

    4 bytes "STCN", kind and count of values (uint16), number (uint64), time (float64), the values, CRC-32 of all before

All little endian. Only for processes of one machine or one robot's network: a checksum detects accidents, not forgery.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

HEAD = struct.Struct("<4sHHQd")
TAIL = struct.Struct("<I")
MAGIC = b"STCN"

MOST_VALUES = 8000
"""Values that one message can carry: a datagram has at most 65,507 bytes."""


@dataclass(frozen=True)
class Message:
    """One received message."""

    number: int
    """Number among the sender's messages of this kind, from 1 on."""
    time: float
    """Time on the sender's clock [s]."""
    values: np.ndarray
    """All values, shape (size,), read-only."""
    data: bytes


class Layout:
    """Vectors of one kind of message, in their order."""

    def __init__(self, kind: int, sizes: Mapping[str, int]) -> None:
        """Set the places of the vectors; sizes: vector -> number of values. Raises `ValueError`: too many."""
        self.kind, self.size = kind, sum(sizes.values())
        if self.size > MOST_VALUES:
            raise ValueError(f"{self.size} values in one message; at most {MOST_VALUES} fit")
        ends = np.cumsum(list(sizes.values()))
        self.places = {name: slice(int(e) - n, int(e)) for (name, n), e in zip(sizes.items(), ends, strict=True)}
        """Vector -> its place among the values."""
        self.bytes = HEAD.size + 8 * self.size + TAIL.size
        """Length of a message."""

    def pack(self, number: int, time: float, vectors: Mapping[str, object]) -> bytes:
        """Return a message; a missing vector is NaN. Raises `KeyError` for a name that the layout lacks."""
        values = np.full(self.size, np.nan, dtype="<f8")
        for name, vector in vectors.items():
            values[self.places[name]] = vector
        body = HEAD.pack(MAGIC, self.kind, self.size, number, time) + values.tobytes()
        return body + TAIL.pack(zlib.crc32(body))

    def unpack(self, data: bytes) -> Message | None:
        """Return the fields of a message; None where the bytes are not a whole message of this kind."""
        if len(data) != self.bytes:
            return None
        magic, kind, count, number, time = HEAD.unpack_from(data)
        if (magic, kind, count) != (MAGIC, self.kind, self.size):
            return None
        if TAIL.unpack_from(data, len(data) - TAIL.size)[0] != zlib.crc32(data[: -TAIL.size]):
            return None
        return Message(number, time, np.frombuffer(data, "<f8", self.size, HEAD.size), data)

    def vectors(self, message: Message) -> dict[str, np.ndarray]:
        """Return the vectors of a message by name."""
        return {name: message.values[place] for name, place in self.places.items()}
