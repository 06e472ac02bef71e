"""Unitree's low-level messages, of fixed size: what each motor says and what it was asked for.

`unitree_go` is that of Go2 and B2, `unitree_hg` that of G1 and H1-2. The layouts are the makers', in CDR: each number
stands at a multiple of its own size from the message's start.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

SIZES = {"B": 1, "b": 1, "h": 2, "H": 2, "i": 4, "I": 4, "f": 4}
"""Code of a number -> its size [B]."""


@dataclass(frozen=True)
class Layout:
    """A message that holds an array of motors."""

    before: str
    """Codes of the numbers in front of the first motor."""
    motor: str
    """Codes of the numbers of one motor."""
    motors: int
    """How many there are, used or not."""
    fields: dict[str, int]
    """What is read of a motor -> which of its numbers."""
    feet: str = ""
    """Codes of the numbers between the last motor and the four forces of the feet; empty where there are none."""

    def places(self) -> dict[str, list[int]]:
        """Return field -> where it stands for each motor, in bytes from the message's start."""
        place, found = _advance(0, self.before)[0], {name: [] for name in self.fields}  # type: ignore[var-annotated]
        for _ in range(self.motors):
            place, starts = _advance(place, self.motor)
            for name, index in self.fields.items():
                found[name].append(starts[index])
        return found

    def body_places(self) -> dict[str, tuple[str, list[int]]]:
        """Return field -> code and places of what a state says of the body."""
        attitude = [place for place, code in zip(_advance(0, self.before)[1], self.before, strict=True) if code == "f"]
        found = {"quaternion": ("f", attitude[:4]), "gyroscope": ("f", attitude[4:7])}
        found["accelerometer"] = ("f", attitude[7:10])
        if self.feet:
            place = _advance(0, self.before)[0]
            for _ in range(self.motors):
                place = _advance(place, self.motor)[0]
            place, _ = _advance(place, self.feet)
            found["foot_force"] = ("h", _advance(place, "hhhh")[1])
        return found


def _advance(place: int, codes: str) -> tuple[int, list[int]]:
    """Return where numbers end that begin at `place` or the next multiple of their size, and where each begins."""
    starts = []
    for code in codes:
        place = -(-place // SIZES[code]) * SIZES[code]
        starts.append(place)
        place += SIZES[code]
    return place, starts


BATTERY = "BBBBiHbbbb" + "H" * 15
"""Codes of the battery's state, which stands between the motors and the feet."""

MEASURED = {"position": 1, "velocity": 2, "effort": 4}
ASKED = {"position": 1, "kp": 4, "kd": 5}

LAYOUTS = {
    "unitree_go/msg/LowState": Layout("BBBBIIIIH" + "f" * 13 + "b", "BfffffffbIII", 20, MEASURED, BATTERY),
    "unitree_go/msg/LowCmd": Layout("BBBBIIIIH", "BfffffIII", 20, ASKED),
    "unitree_hg/msg/LowState": Layout("IIBBI" + "f" * 13 + "h", "BffffhhfIIIIIII", 35, MEASURED),
    "unitree_hg/msg/LowCmd": Layout("BB", "BfffffI", 35, ASKED),
}
"""Type of message -> where its motors are. The 13 numbers in a state are the attitude: quaternion, rates, acceleration
and angles."""

PLACES = {kind: layout.places() for kind, layout in LAYOUTS.items()}


def decode_motors(kind: str, data: bytes) -> dict[str, list[float]]:
    """Return field -> numbers of all motors; raise `ValueError` or `struct.error` for what is no such message."""
    order = _order(data)
    return {
        name: [struct.unpack_from(f"{order}f", data, 4 + place)[0] for place in places]
        for name, places in PLACES[kind].items()
    }


BODY_PLACES = {kind: layout.body_places() for kind, layout in LAYOUTS.items() if kind.endswith("State")}


def decode_body(kind: str, data: bytes) -> dict[str, list[float]]:
    """Return attitude, rates, specific force and the feet's forces; errors as of `decode_motors`.

    A message that ends with its motors, as old firmware and bridges write it, has no feet.
    """
    order = _order(data)
    return {
        name: [struct.unpack_from(f"{order}{code}", data, 4 + place)[0] for place in places]
        for name, (code, places) in BODY_PLACES[kind].items()
        if name != "foot_force" or len(data) >= 4 + places[-1] + SIZES[code]
    }


def _order(data: bytes) -> str:
    """Return the order of the bytes in numbers; raise `ValueError` for what is not plain CDR."""
    if len(data) < 4 or data[0] != 0 or data[1] not in (0, 1):
        raise ValueError("not plain CDR")
    return "<" if data[1] == 1 else ">"
