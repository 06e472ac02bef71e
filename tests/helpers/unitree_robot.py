"""A robot that speaks Unitree's messages over DDS on loopback, in a process of its own; nothing of ours encodes for it.

    python unitree_robot.py FAMILY DOMAIN MODE

Its joints are where they were asked to be. It ends when its standard input does, and prints what it heard as JSON. MODE
`foreign` sends commands of its own once it has heard one, as the maker's gait controller does. `simulator` says what
the maker's simulator does, unitree_mujoco in Python: 200 states a second, tick, temperatures and voltage zero, no
checksum; `checked` is that with checksums.
"""

from __future__ import annotations

import json
import select
import sys
import time
from contextlib import suppress
from functools import cache
from typing import Any

import numpy as np
from cyclonedds.core import DDSException
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from stiction.deploy.transports.dds import _idl_type, domain_settings
from stiction.files.unitree import STRUCTURES, Structure

PERIOD = 0.005
POSES = {"unitree_go": [0.0, 0.9, -1.8] * 4, "unitree_hg": [0.0] * 29}
MODE_MACHINE = 5


@cache
def message_type(structure: Structure) -> type:
    """Return the type of a message with the maker's fields."""
    return _idl_type(structure, structure.name, structure.dtype)


def bitwise_crc(image: bytes) -> int:
    """CRC-32/MPEG-2 of the words of a structure but the last, bit by bit, as it is published."""
    register = 0xFFFFFFFF
    for word in np.frombuffer(image, "<u4")[:-1].tolist():
        for bit in range(31, -1, -1):
            high = (register >> 31) ^ (word >> bit & 1)
            register = (register << 1 & 0xFFFFFFFF) ^ (0x04C11DB7 if high else 0)
    return register


def filled(layout: np.dtype, kind: type, message: np.ndarray) -> Any:
    """The object of a structured record."""
    values = {}
    for name in layout.names:
        part, hint = layout[name], kind.__annotations__[name]
        value = message[name]
        if part.subdtype is not None and part.subdtype[0].names:
            inner = hint.__metadata__[0].subtype
            values[name] = [filled(part.subdtype[0], inner, one) for one in value]
        elif part.names:
            values[name] = filled(part, hint, value)
        else:
            values[name] = np.asarray(value).astype(part.base.str.replace("i1", "u1")).tolist()
    return kind(**values)


def image(layout: np.dtype, sample: Any) -> np.ndarray:
    """The structured record of an object."""
    record = np.zeros((), layout)
    for name in layout.names:
        part, value = layout[name], getattr(sample, name)
        if part.subdtype is not None and part.subdtype[0].names:
            for place, one in enumerate(value):
                record[name][place] = image(part.subdtype[0], one)
        else:
            octets = part.base.itemsize == 1 and not part.names
            plain = (
                np.array(list(value) if isinstance(value, bytes) else value, "u1").view(part.base) if octets else value
            )
            record[name] = image(part, value) if part.names else plain
    return record


def main(family: str, domain: str, mode: str) -> None:
    """Play the robot until standard input ends."""
    states, commands = STRUCTURES[f"{family}/msg/LowState"], STRUCTURES[f"{family}/msg/LowCmd"]
    settings = Domain(int(domain), domain_settings("lo"))
    participant = DomainParticipant(int(domain))
    writer = DataWriter(participant, Topic(participant, "rt/lowstate", message_type(states)))
    topic = Topic(participant, "rt/lowcmd", message_type(commands))
    reader, foreign = DataReader(participant, topic), DataWriter(participant, topic)
    print("ready", flush=True)
    state, heard, last, passed = states.blank(), [], None, 0.0
    pose = np.array(POSES[family])
    state["motor_state"]["q"][: len(pose)] = pose
    state["imu_state"]["quaternion"], state["imu_state"]["accelerometer"] = (1, 0, 0, 0), (0, 0, 9.81)
    if family == "unitree_hg":
        state["mode_machine"] = MODE_MACHINE
    while not select.select([0], [], [], 0)[0]:
        for sample in reader.take(16):
            try:
                last = image(commands.dtype, sample)
            except AttributeError:  # Somebody has left.
                continue
            motors = last["motor_cmd"][: len(pose)]
            if motors["kp"].any():
                state["motor_state"]["q"][: len(pose)] = motors["q"]
            heard.append(
                {
                    "stiff": bool(motors["kp"].any()),
                    "damped": bool(motors["kd"].all()),
                    "on": bool((motors["mode"] == 1).all()),
                    "others": float(
                        sum(np.abs(last["motor_cmd"][len(pose) :][f]).sum() for f in ("mode", "kp", "kd", "tau"))
                    ),
                    "mode_machine": int(last["mode_machine"]) if family == "unitree_hg" else None,
                    "q": motors["q"].tolist(),
                    "crc": bool(last["crc"] == bitwise_crc(last.tobytes())) if len(heard) % 20 == 0 else True,
                }
            )
        if mode == "foreign" and last is not None:
            foreign.write(filled(commands.dtype, message_type(commands), last))
        passed += 1000 * PERIOD
        state["tick"] = 0 if mode in ("simulator", "checked") else int(passed)
        state["imu_state"]["gyroscope"] = 1e-3 * np.sin(np.arange(3) + 0.04 * passed)
        state["crc"] = 0 if mode == "simulator" else states.checksum(state)
        with suppress(DDSException):
            writer.write(filled(states.dtype, message_type(states), state))
        time.sleep(PERIOD)
    print(json.dumps(heard), flush=True)
    del settings


if __name__ == "__main__":
    main(*sys.argv[1:4])
