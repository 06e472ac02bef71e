"""Unitree's low-level messages, field by field: `unitree_go` for Go2 and B2, `unitree_hg` for G1 and H1-2.

Names and order are the maker's. A message has two forms. In memory it is a C structure: a number starts at a multiple
of its size, a structure at a multiple of its widest number's; the checksum covers that form. On the wire (plain CDR)
only numbers are aligned, from the message's start, so the two differ wherever a structure begins with a byte.

A message is an array of one record: `message["motor_cmd"]["q"][3] = 0.1`. An unknown field raises `ValueError`.
"""

from __future__ import annotations

import sys
import zlib
from collections.abc import Iterator

import numpy as np

ENCAPSULATION = b"\0\1\0\0"
"""Bytes before a message on the wire: plain CDR, little endian."""

_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
"""Byte -> the same with its bits in reverse."""


def crc32_mpeg2(data: bytes) -> int:
    """Return CRC-32/MPEG-2: polynomial 0x04C11DB7, from all ones, highest bit first, nothing inverted at the end.

    The usual CRC-32 is the same polynomial with bits in reverse and the end inverted, and the standard library has it.
    """
    mirrored = zlib.crc32(data.translate(_REVERSED)) ^ 0xFFFFFFFF
    return int.from_bytes(mirrored.to_bytes(4, "little").translate(_REVERSED), "big")


class Structure:
    """Structure of one kind of message."""

    def __init__(self, family: str, name: str, parts: dict[str, str], layout: np.dtype) -> None:
        """Initialise a message of a family, `unitree_go` or `unitree_hg`.

        parts: field -> the maker's name of its type, for fields that are structures; layout: in memory.
        """
        self.kind = f"{family}/msg/{name}"
        """Name in ROS 2: `unitree_go/msg/LowCmd`."""
        self.family, self.name, self.parts, self.dtype = family, name, parts, layout
        ends, end = [], 0
        for place, size in _numbers(layout, 0):
            # CDR: a number begins at a multiple of its own size.
            end = -(-end // size) * size + size
            ends.append((place, end, size))
        self.wire_bytes = end
        """Length on the wire, without the four bytes of encapsulation."""
        self._memory = np.full(self.wire_bytes, layout.itemsize)
        """Byte on the wire -> byte in memory; padding comes from a zero after the message."""
        for place, end, size in ends:
            self._memory[end - size : end] = np.arange(place, place + size)
        # The way back; a gap in memory is filled from a zero behind the bytes of the wire.
        self._wire = np.full(layout.itemsize, self.wire_bytes)
        self._wire[self._memory[self._memory < layout.itemsize]] = np.flatnonzero(self._memory < layout.itemsize)

    def blank(self) -> np.ndarray:
        """Return a message of zeros."""
        return np.zeros((), self.dtype)

    def checksum(self, message: np.ndarray) -> int:
        """Return the value of a message's `crc`.

        CRC-32/MPEG-2 over its words in memory, highest byte first, except the last, which is the checksum itself.
        """
        return crc32_mpeg2(np.frombuffer(message.tobytes(), "<u4")[:-1].byteswap().tobytes())

    def to_wire(self, message: np.ndarray) -> bytes:
        """Return a message with its encapsulation."""
        image = np.frombuffer(message.tobytes() + b"\0", np.uint8)
        return ENCAPSULATION + image[self._memory].tobytes()

    def from_wire(self, data: bytes, whole_to: str | None = None) -> np.ndarray:
        """Return the message in bytes with their encapsulation.

        whole_to: the message may end after this field; missing fields are zero. Without it, it must be complete. Raises
        `ValueError` for bytes that are not plain CDR, or too short.
        """
        if len(data) < 4 or data[0] != 0 or data[1] not in (0, 1):
            raise ValueError("not plain CDR")
        least = self.wire_bytes if whole_to is None else self.wire_end(whole_to)
        if len(data) - 4 < least:
            raise ValueError(f"{len(data) - 4} bytes of a {self.kind}; expected {least}")
        # One zero more: the gaps of the form in memory are filled from it.
        body = np.zeros(self.wire_bytes + 1, np.uint8)
        received = np.frombuffer(data, np.uint8, min(len(data) - 4, self.wire_bytes), 4)
        body[: len(received)] = received
        native = (data[1] == 1) == (sys.byteorder == "little")
        return np.frombuffer(body[self._wire].tobytes(), self.dtype if native else self.dtype.newbyteorder()).reshape(
            ()
        )

    def wire_end(self, name: str) -> int:
        """Return the end of a field on the wire, from the message's start [B]."""
        kind, place = self.dtype.fields[name][:2]  # type: ignore[index]
        last = max(start + size for start, size in _numbers(kind, place))
        return int(self._wire[last - 1]) + 1


def _numbers(layout: np.dtype, place: int) -> Iterator[tuple[int, int]]:
    """Yield place and size of every number of a layout that begins at a place, in order [B]."""
    if layout.subdtype is not None:
        part, shape = layout.subdtype
        for index in range(int(np.prod(shape))):
            yield from _numbers(part, place + index * part.itemsize)
    elif layout.names is not None:
        for name in layout.names:
            part, offset = layout.fields[name][:2]  # type: ignore[index]
            yield from _numbers(part, place + offset)
    else:
        yield place, layout.itemsize


def _layout(text: str, **parts: np.dtype) -> np.dtype:
    """Return a C structure of fields such as `q:f4`, `reserve:u4*3`, `motor_cmd:motor*20`."""
    fields = []
    for word in text.split():
        name, _, kind = word.partition(":")
        kind, _, count = kind.partition("*")
        fields.append((name, parts.get(kind, kind), *([int(count)] if count else [])))
    return np.dtype(fields, align=True)


_GO_HEAD = "head:u1*2 level_flag:u1 frame_reserve:u1 sn:u4*2 version:u4*2 bandwidth:u2"
_ATTITUDE = "quaternion:f4*4 gyroscope:f4*3 accelerometer:f4*3 rpy:f4*3"
_ASKED = "mode:u1 q:f4 dq:f4 tau:f4 kp:f4 kd:f4"
_MEASURED = "mode:u1 q:f4 dq:f4 ddq:f4 tau_est:f4"

GO_COMMAND = Structure(
    "unitree_go",
    "LowCmd",
    {"motor_cmd": "MotorCmd", "bms_cmd": "BmsCmd"},
    _layout(
        _GO_HEAD
        + " motor_cmd:motor*20 bms_cmd:battery wireless_remote:u1*40 led:u1*12 fan:u1*2 gpio:u1 reserve:u4 crc:u4",
        motor=_layout(_ASKED + " reserve:u4*3"),
        battery=_layout("off:u1 reserve:u1*3"),
    ),
)

GO_STATE = Structure(
    "unitree_go",
    "LowState",
    {"imu_state": "IMUState", "motor_state": "MotorState", "bms_state": "BmsState"},
    _layout(
        _GO_HEAD + " imu_state:imu motor_state:motor*20 bms_state:battery foot_force:i2*4 foot_force_est:i2*4 tick:u4 "
        "wireless_remote:u1*40 bit_flag:u1 adc_reel:f4 temperature_ntc1:u1 temperature_ntc2:u1 power_v:f4 power_a:f4 "
        "fan_frequency:u2*4 reserve:u4 crc:u4",
        imu=_layout(_ATTITUDE + " temperature:i1"),
        motor=_layout(_MEASURED + " q_raw:f4 dq_raw:f4 ddq_raw:f4 temperature:i1 lost:u4 reserve:u4*2"),
        battery=_layout(
            "version_high:u1 version_low:u1 status:u1 soc:u1 current:i4 cycle:u2 bq_ntc:i1*2 mcu_ntc:i1*2 "
            "cell_vol:u2*15"
        ),
    ),
)

HG_COMMAND = Structure(
    "unitree_hg",
    "LowCmd",
    {"motor_cmd": "MotorCmd"},
    _layout("mode_pr:u1 mode_machine:u1 motor_cmd:motor*35 reserve:u4*4 crc:u4", motor=_layout(_ASKED + " reserve:u4")),
)

HG_STATE = Structure(
    "unitree_hg",
    "LowState",
    {"imu_state": "IMUState", "motor_state": "MotorState"},
    _layout(
        "version:u4*2 mode_pr:u1 mode_machine:u1 tick:u4 imu_state:imu motor_state:motor*35 wireless_remote:u1*40 "
        "reserve:u4*4 crc:u4",
        imu=_layout(_ATTITUDE + " temperature:i2"),
        motor=_layout(_MEASURED + " temperature:i2*2 vol:f4 sensor:u4*2 motorstate:u4 reserve:u4*4"),
    ),
)

STRUCTURES = {structure.kind: structure for structure in (GO_COMMAND, GO_STATE, HG_COMMAND, HG_STATE)}
"""Type of message -> its structure."""

MOTORS = {
    structure.kind: "motor_cmd" if structure.name == "LowCmd" else "motor_state" for structure in STRUCTURES.values()
}
"""Type of message -> its field of motors."""
