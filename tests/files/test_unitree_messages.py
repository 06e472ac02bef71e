"""Unitree's messages: sizes of the maker's structures, the checksum by its published algorithm, places by hand."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.files.unitree import GO_COMMAND, GO_STATE, HG_COMMAND, HG_STATE, STRUCTURES

SIZES = {GO_COMMAND.kind: 812, GO_STATE.kind: 1180, HG_COMMAND.kind: 1004, HG_STATE.kind: 2092}
"""Bytes of the maker's structures in memory."""


def by_bits(image: bytes) -> int:
    """CRC-32/MPEG-2 of all words but the last, each from its highest bit on, as it is published."""
    register = 0xFFFFFFFF
    for word in np.frombuffer(image, "<u4")[:-1].tolist():
        for bit in range(31, -1, -1):
            top = (register >> 31) ^ (word >> bit & 1)
            register = (register << 1 & 0xFFFFFFFF) ^ (0x04C11DB7 if top else 0)
    return register


def random_wire(kind: str, seed: int = 0) -> bytes:
    """Some message on the wire, every number of it finite; what fills gaps is zero."""
    structure = STRUCTURES[kind]
    body = np.random.default_rng(seed).integers(1, 100, structure.wire_bytes).astype(np.uint8).tobytes()
    return structure.to_wire(structure.from_wire(b"\0\1\0\0" + body))


@pytest.mark.parametrize("kind", SIZES)
def test_structures_have_the_maker_s_size_and_checksum(kind: str) -> None:
    """A field too many or too few moves every one behind it; a robot ignores what has another checksum."""
    structure = STRUCTURES[kind]
    assert structure.dtype.itemsize == SIZES[kind]
    message = structure.from_wire(random_wire(kind))
    assert structure.checksum(message) == by_bits(message.tobytes())
    changed = message.copy()
    changed["reserve"] = 7
    assert structure.checksum(changed) == by_bits(changed.tobytes()) != structure.checksum(message)


@pytest.mark.parametrize("kind", SIZES)
def test_a_message_comes_back_from_the_wire_in_either_byte_order(kind: str) -> None:
    """A number is read from where another one stands."""
    structure, wire = STRUCTURES[kind], random_wire(kind, 1)
    message = structure.from_wire(wire)
    assert structure.to_wire(message) == wire
    swapped = message.astype(structure.dtype.newbyteorder())
    big = b"\0\0\0\0" + structure.to_wire(swapped)[4:]
    again = structure.from_wire(big)
    for field in structure.dtype.names:
        np.testing.assert_array_equal(again[field], message[field])


def test_places_by_hand() -> None:
    """In memory every motor begins at a multiple of four, on the wire its first byte follows at once."""
    message = HG_COMMAND.blank()
    message["mode_pr"], message["mode_machine"] = 1, 5
    message["motor_cmd"]["mode"][:2], message["motor_cmd"]["q"][1] = (8, 9), 1.0
    wire, image = HG_COMMAND.to_wire(message)[4:], message.tobytes()
    assert wire[:3] == bytes([1, 5, 8]) and image[:5] == bytes([1, 5, 0, 0, 8])
    # A motor is 28 bytes: mode, gap, five floats, a reserve.
    assert wire[28] == 9 and wire[32:36] == np.float32(1.0).tobytes()
    assert image[32] == 9 and image[36:40] == np.float32(1.0).tobytes()


@pytest.mark.parametrize("data", [b"", b"\0\1\0", b"\0\3\0\0" + bytes(2000), b"\0\1\0\0" + bytes(807)])
def test_what_is_no_message_is_refused(data: bytes) -> None:
    """Bytes that end too early are read as zeros: a robot that stands upright with all joints at zero."""
    with pytest.raises(ValueError, match=r"CDR|expected"):
        GO_COMMAND.from_wire(data)
