"""What a log says of joints and body in Unitree's low-level messages, see `formats.unitree`."""

from __future__ import annotations

from stiction.files.unitree import MOTORS, STRUCTURES

MEASURED = {"position": "q", "velocity": "dq", "effort": "tau_est"}
ASKED = {"position": "q", "kp": "kp", "kd": "kd"}

BODY = ("quaternion", "gyroscope", "accelerometer")
"""What a state says of the body, by the names of its signals, which are the maker's too."""

STATE_KINDS = tuple(kind for kind in STRUCTURES if kind.endswith("State"))
"""Types of messages that hold a state."""


def motors_of(kind: str) -> int:
    """Return how many motors a type of message has, used or not."""
    return int(STRUCTURES[kind].dtype[MOTORS[kind]].shape[0])


def decode_motors(kind: str, data: bytes) -> dict[str, list[float]]:
    """Return field -> numbers of all motors; raise `ValueError` for what is no such message."""
    motors = STRUCTURES[kind].from_wire(data, whole_to=MOTORS[kind])[MOTORS[kind]]
    names = MEASURED if kind in STATE_KINDS else ASKED
    return {role: motors[name].tolist() for role, name in names.items()}


def decode_body(kind: str, data: bytes) -> dict[str, list[float]]:
    """Return attitude, rates, specific force and the feet's forces; errors as of `decode_motors`.

    A message that ends with its motors, as old firmware and bridges write it, has no feet.
    """
    structure = STRUCTURES[kind]
    message = structure.from_wire(data, whole_to="imu_state")
    found = {name: message["imu_state"][name].tolist() for name in BODY}
    if "foot_force" in (structure.dtype.names or ()) and len(data) - 4 >= structure.wire_end("foot_force"):
        found["foot_force"] = message["foot_force"].tolist()
    return found
