"""Bags of ROS: joint states and the commands that the joints were given, brought onto the states' stamps.

Needs the extra `logs`. A state is a `sensor_msgs/msg/JointState` or Unitree's `LowState`; a command is a
joint state too, or a `std_msgs/msg/Float64MultiArray`, a `trajectory_msgs/msg/JointTrajectory` of one point, or
Unitree's `LowCmd`. Messages are decoded as they come, and of each no more is kept than its numbers.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import LogError
from stiction.core.memory import claim
from stiction.files.log import BodySignals, JointSignals, Log
from stiction.files.tables import WIDEST_MATRIX
from stiction.files.unitree import STRUCTURES
from stiction.identification.logs.bags import Bag, Packet, Topic
from stiction.identification.logs.cells import take
from stiction.identification.logs.imu import choose_imu, read_body
from stiction.identification.logs.naming import COMMAND_WORDS, TOPICS
from stiction.identification.logs.unitree import STATE_KINDS, decode_motors, motors_of

STATE, ARRAY, TRAJECTORY = (
    "sensor_msgs/msg/JointState",
    "std_msgs/msg/Float64MultiArray",
    "trajectory_msgs/msg/JointTrajectory",
)

STATES = (STATE, *STATE_KINDS)
"""Types that say where the joints are."""

COMMANDS = (STATE, ARRAY, TRAJECTORY, *(kind for kind in STRUCTURES if kind not in STATE_KINDS))
"""Types that say what they were asked for; a joint state by its topic's name."""


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


def read_ros(path: Path, topics: Mapping[str, str], body: bool = False) -> Log:
    """Read the joints of a bag, and what is known of the body where that is asked for.

    topics: `state`, `command` and `imu` -> topic; what is not named is chosen if there is only one candidate. The log's
    time is that of the states' headers, or of their receipt where the headers have none, in seconds from the first; the
    command is held from its stamp to the next. Raises `LogError`.
    """
    wrong = sorted(set(topics) - set(TOPICS))
    if wrong:
        raise LogError(f"{path.name}: {wrong[0]}= maps a column; a bag has topics: state=TOPIC command=TOPIC")
    bag = Bag(path)
    asked = {role: name for role, name in topics.items() if role != "imu"}
    state, command = choose_topics(path.name, bag.topics, asked)
    series = read_series(path.name, bag, [state] if command is None else [state, command])
    states = state_series(series[state])
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
        stamps, joints, said = _with_targets(path.name, states, joints, command, series[command])
        notes += said
    # Subtracted as integers: since 1970 there are more nanoseconds than a float has digits for.
    first = int(stamps.min())
    log = Log(path.name, (stamps - first) * 1e-9, joints, notes=tuple(notes), start=first * 1e-9)
    imu = choose_imu(path.name, bag.topics, topics.get("imu"), state) if body else None
    if imu is None:
        return replace(log, body=BodySignals()) if body else log
    measured, covered, warned = read_body(path.name, bag, imu, stamps, states.by_receipt)
    return take(replace(log, body=measured), covered, warned)


def _with_targets(
    source: str, states: Series, joints: dict[str, JointSignals], command: Topic, collected: Collected
) -> tuple[np.ndarray, dict[str, JointSignals], list[str]]:
    """Return stamps [ns], joints and notes with the command held onto the states' stamps.

    States before the first command are left out: nobody knows what the joint was asked for then.
    """
    commands = command_series(collected, states.names)
    notes = list(commands.notes)
    if commands.by_receipt != states.by_receipt:
        notes.append(
            "states and commands are stamped by different clocks (header and receipt): a delay between them is not real"
        )
    order = np.argsort(commands.stamps, kind="stable")
    # The last command at or before each state, -1 where there was none yet.
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
        allowed = STATES if role == "state" else COMMANDS
        if name not in by_name or by_name[name].schema not in allowed:
            raise LogError(f"{source}: {role}={name}: expected a topic of {' or '.join(allowed)}; there are {listing}")
    named = {role: by_name[name] for role, name in asked.items()}
    states = [topic for topic in found if topic.schema in STATES and topic.name not in asked.values()]
    orders = [
        topic for topic in states if topic.schema == STATE and any(word in topic.name.lower() for word in COMMAND_WORDS)
    ]
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
        raise LogError(f"{source}: no topic of {' or '.join(STATES)}; there are {listing}")
    command = named.get("command")
    return named["state"], None if command == named["state"] else command


@dataclass
class Collected:
    """The numbers of one topic as they come; what does not fit is remembered until it is known whether it matters."""

    source: str
    """File and topic, for messages."""
    schema: str
    """Type of the messages."""
    names: tuple[str, ...] = ()
    """The joints of the first message; none where the type names none."""
    received: array = field(default_factory=lambda: array("q"))
    """When each was received [ns]."""
    stamps: array = field(default_factory=lambda: array("q"))
    """Stamps of the headers, 0 where there is none [ns]."""
    values: dict[str, array] = field(default_factory=dict)
    """Field -> numbers, message by message."""
    filled: set[str] = field(default_factory=set)
    """Fields that are not empty in some message."""
    wrong: dict[str, str] = field(default_factory=dict)
    """Field -> the first message in which it is not one number a joint, and how many there are."""

    @property
    def topic(self) -> str:
        """The topic alone."""
        return self.source.rpartition(" ")[2]

    def take(self, received: int, stamp: int, names: Sequence[str], values: Mapping[str, Sequence[float]]) -> None:
        """Add a message; raise `LogError` where it names other joints than the first."""
        if not self.received and self.schema != ARRAY:
            if not names or len(set(names)) != len(names) or not all(names) or len(names) > WIDEST_MATRIX:
                raise LogError(
                    f"{self.source}: the first message names the joints {list(names)[:6]}; expected one different name "
                    "each"
                )
            self.names = tuple(names)
        order = None
        if self.names and tuple(names) != self.names:
            index = {name: place for place, name in enumerate(names)}
            if len(names) != len(self.names) or index.keys() != set(self.names):
                raise LogError(
                    f"{self.source}: a message names other joints than the first; expected one publisher on this topic"
                )
            order = [index[name] for name in self.names]
        self.received.append(received)
        self.stamps.append(stamp)
        for name, numbers in values.items():
            stored = self.values.setdefault(name, array("d"))
            if len(numbers):
                self.filled.add(name)
            # An array names no joints, so that its width is that of the messages before it.
            width = len(self.names) or len(stored) // max(1, len(self.received) - 1)
            if len(numbers) != width and (self.names or len(self.received) > 1):
                said = f"{name} of message {len(self.received)} has {len(numbers)} values for {width} joints"
                self.wrong.setdefault(name, said)
            else:
                stored.extend(numbers if order is None else [numbers[place] for place in order])
        taken = 16 * len(self.received) + sum(8 * len(samples) for samples in self.values.values())
        claim(self.source, taken, f"{len(self.received)} messages or more take", LogError)

    def matrix(self, name: str) -> np.ndarray | None:
        """Return a field, shape (num_messages, num_joints), None where it is empty; raise `LogError` for a part."""
        if name not in self.filled:
            return None
        if name in self.wrong:
            raise LogError(f"{self.source}: {self.wrong[name]}")
        return np.array(self.values[name]).reshape(len(self.received), -1)

    def clock(self) -> tuple[np.ndarray, bool]:
        """Return the headers' stamps [ns], or the times of receipt where some header has none; and which it was."""
        stamps = np.array(self.stamps, dtype=np.int64)
        # All or none: times by two clocks cannot be put in one order.
        return (stamps, False) if stamps.all() else (np.array(self.received, dtype=np.int64), True)


Content = tuple[int, "Sequence[str]", "dict[str, Sequence[float]]"]
"""Stamp [ns], names of joints, field -> numbers."""


def read_series(source: str, bag: Bag, topics: list[Topic]) -> dict[Topic, Collected]:
    """Return the numbers of each topic. Raises `LogError`."""
    found = {topic: Collected(f"{source}: {topic.name}", topic.schema) for topic in topics}
    for packet in bag.packets(*topics):
        topic = packet.topic
        try:
            stamp, names, values = _content(f"{source}: {topic.name}", bag, packet)
            found[topic].take(packet.received, stamp, names, values)
        except BROKEN_MESSAGE as error:
            raise LogError(f"{source}: a message on {topic.name} is damaged ({str(error)[:80]})") from error
    return found


BROKEN_MESSAGE = (struct.error, ValueError, IndexError, KeyError, OverflowError, RuntimeError, TypeError)
"""What the decoders let through for damaged messages; `UnicodeDecodeError` is of the second kind."""


def _content(source: str, bag: Bag, packet: Packet) -> Content:
    """Return stamp, names and numbers of a message."""
    schema = packet.topic.schema
    if schema in STRUCTURES:
        names = [f"joint_{index}" for index in range(motors_of(schema))]
        return 0, names, dict(decode_motors(schema, packet.data))
    turn = {STATE: _of_state, ARRAY: _of_array, TRAJECTORY: _of_trajectory}[schema]
    return turn(source, bag.decode(packet))


def _nanoseconds(stamp: Any) -> int:
    """Return a time or a duration of ROS [ns]."""
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def _of_state(source: str, message: Any) -> Content:
    """Take a `JointState` apart."""
    values = {name: getattr(message, name) for name in ("position", "velocity", "effort")}
    return _nanoseconds(message.header.stamp), message.name, values


def _of_array(source: str, message: Any) -> Content:
    """Take a `Float64MultiArray` apart."""
    return 0, (), {"position": message.data}


def _of_trajectory(source: str, message: Any) -> Content:
    """Take a `JointTrajectory` apart."""
    if len(message.points) != 1:
        raise LogError(
            f"{source}: trajectories of several points: what the controller made of them is not in this topic; log the "
            "positions that it asked for"
        )
    (point,) = message.points
    delay = [1e-9 * _nanoseconds(point.time_from_start)] * len(message.joint_names)
    return _nanoseconds(message.header.stamp), message.joint_names, {"position": point.positions, "delay": delay}


def state_series(collected: Collected) -> Series:
    """Return position, velocity and effort without idle motors; raise `LogError` where they do not fit together."""
    if not collected.received:
        raise LogError(f"{collected.source}: no messages")
    values = {name: collected.matrix(name) for name in ("position", "velocity", "effort")}
    known = {name: array for name, array in values.items() if array is not None}
    if "position" not in known:
        raise LogError(f"{collected.source}: the messages have no positions")
    names = collected.names
    stamps, by_receipt = collected.clock()
    notes = []
    if collected.schema in STRUCTURES:
        # Unitree's messages have room for more motors than most robots have; the idle ones are zero throughout.
        moving = np.any([array.any(axis=0) for array in known.values()], axis=0)
        if not moving.any():
            raise LogError(f"{collected.source}: every motor says zero in every message")
        known = {name: array[:, moving] for name, array in known.items()}
        names = tuple(name for name, moves in zip(names, moving, strict=True) if moves)
    if by_receipt:
        notes.append(f"{collected.topic}: the headers have no stamps; the times of receipt are used, jitter included")
    return Series(stamps, by_receipt, names, known, tuple(notes))


def command_series(collected: Collected, joints: tuple[str, ...]) -> Series:
    """Return the positions asked for.

    joints: the states' joints, in whose order a `Float64MultiArray` must be. Raises `LogError`.
    """
    if collected.schema == STATE:
        return state_series(collected)
    if not collected.received:
        raise LogError(f"{collected.source}: no messages")
    if collected.schema == ARRAY:
        values = collected.matrix("position")
        if values is None or values.shape[1] != len(joints):
            size = 0 if values is None else values.shape[1]
            raise LogError(f"{collected.source}: data of message 1 has {size} values for {len(joints)} joints")
        note = (
            f"{collected.topic}: the commands name no joints; they are taken in the states' order, "
            f"{', '.join(joints[:3])}, ..."
        )
        receipt = np.array(collected.received, dtype=np.int64)
        return Series(receipt, True, joints, {"position": values}, (note,))
    position = collected.matrix("position")
    if position is None:
        raise LogError(f"{collected.source}: the messages have no positions")
    stamps, by_receipt = collected.clock()
    delay = collected.matrix("delay")
    if delay is not None:  # the point of a trajectory counts from its stamp plus its delay
        stamps = stamps + np.rint(1e9 * delay[:, 0]).astype(np.int64)
    return Series(stamps, by_receipt, collected.names, {"position": position}, _gains(collected, joints))


def _gains(collected: Collected, joints: tuple[str, ...]) -> tuple[str, ...]:
    """Say which gains were sent with the commands, if they were sent and did not change."""
    sent = {name: collected.matrix(name) for name in ("kp", "kd") if name in collected.values}
    used = [index for index, name in enumerate(collected.names) if name in joints]
    found = {name: array[:, used] for name, array in sent.items() if array is not None and used}
    if len(found) < 2 or any(np.ptp(array, axis=0).any() for array in found.values()):
        return ()
    words = "; ".join(f"{name} {', '.join(f'{value:.4g}' for value in array[0])}" for name, array in found.items())
    return (f"{collected.topic}: the commands carry the gains {words}: say so in the sidecar, or by --kp and --kd",)
