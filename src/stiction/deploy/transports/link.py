"""Interface between the supervisor and a robot, for every transport, and the state that a robot reports."""

from __future__ import annotations

import math
import socket
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np

from stiction.deploy.control import JointCommand
from stiction.deploy.observation import Sensors
from stiction.deploy.transports.arrivals import Arrivals
from stiction.deploy.transports.messages import Layout, Message

STATE, COMMAND = 1, 2

MEASURED = ("quaternion", "angular_velocity", "joint_position", "joint_velocity")
"""Fields of `Sensors` that every robot measures."""


@dataclass(frozen=True)
class RobotState:
    """State of a robot at one instant; J joints, L feet. NaN where a robot does not report a value."""

    number: int
    """Number of its message, from 1 on."""
    time: float
    """Time on the robot's own clock, without the steps of that clock [s]."""
    sensors: Sensors
    """IMU and encoders: quaternion (4,), angular velocity (3,), joint angles and velocities (J,)."""
    acceleration: np.ndarray
    """Accelerometer: specific force in the base's frame [m/s²], shape (3,)."""
    joint_torque: np.ndarray
    """Motor current times the data sheet's torque constant, at the joint [N m], shape (J,)."""
    temperature: np.ndarray
    """Temperatures of the motors [°C], shape (J,)."""
    lost: np.ndarray
    """Messages of each motor that did not reach the robot's own computer, counted up since it started, shape (J,)."""
    motor_fault: np.ndarray
    """Fault that each motor reports, the maker's code; 0: none, shape (J,)."""
    foot_contact: np.ndarray
    """1 where a foot bears load, 0 where it does not, shape (L,)."""
    battery: float
    """Battery voltage [V]."""
    kp: np.ndarray
    """Proportional gains of the motor controllers, read back [N m/rad], shape (J,)."""
    kd: np.ndarray
    """Derivative gains, read back [N m s/rad], shape (J,)."""
    torque_limit: np.ndarray
    """Torque limits, read back [N m], shape (J,)."""
    command: float
    """Number of the last command that the robot took, of whoever sent it."""
    age: float = 0.0
    """Time for which the message waited before it was read [s]; 0 where the transport cannot tell."""


@dataclass(frozen=True)
class Peers:
    """Programs at the other end of a link, in words, as far as the transport tells."""

    robots: tuple[str, ...] = ()
    """Writers of states; the first one is the robot, whose states alone are used."""
    readers: tuple[str, ...] = ()
    """Readers of commands, the robot's own included: each of them may move by them."""
    writers: tuple[str, ...] = ()


@dataclass(frozen=True)
class Spare:
    """Second way to the same robot, for another process of ours, see `runtime.watchdog.open_spare`."""

    transport: str
    settings: Mapping[str, Any]
    """Settings of that transport, plain data."""
    files: tuple[int, ...] = ()
    """File descriptors that the other process inherits."""


AGES_WINDOW = 1.0
"""Time within which at least one message is read without delay [s]."""


class Ages:
    """Ages of messages by their sender's clock: how much longer each one took than the fastest within a window."""

    def __init__(self) -> None:
        self._least, self._since = (math.inf, math.inf), -math.inf

    def age(self, stamp: float, now: float) -> float:
        """Return the time that a message waited [s]; stamp: on the sender's clock, now: on the reader's [s]."""
        offset, (before, current) = now - stamp, self._least
        # Two windows, not one minimum for good: clocks drift apart.
        if now - self._since > AGES_WINDOW:
            before, current, self._since = current, math.inf, now
        self._least = before, min(current, offset)
        return offset - min(self._least)


class Bell:
    """File that another thread makes readable, for libraries without one; it never waits."""

    def __init__(self) -> None:
        self._button, self._ear = socket.socketpair()
        for end in (self._button, self._ear):
            end.setblocking(False)

    def fileno(self) -> int:
        """Return the file."""
        return self._ear.fileno()

    def ring(self) -> None:
        """Make the file readable; from any thread, however often."""
        # Full means rung often and heard by nobody yet: it is readable as it is.
        with suppress(BlockingIOError):
            self._button.send(b"!")

    def silence(self) -> None:
        """Make it unreadable again."""
        with suppress(BlockingIOError):
            while self._ear.recv(256):
                pass

    def close(self) -> None:
        """Close both ends, after the last call of `ring`."""
        self._button.close()
        self._ear.close()


class Link(Protocol):
    """Robot behind a transport. The supervisor alone holds one, since its holder can move the robot."""

    joint_names: tuple[str, ...]
    """Order of every vector over joints."""
    foot_names: tuple[str, ...]
    """Order of every vector over feet."""
    period: float
    """Time between two states [s]."""
    lock_name: str
    """Name of the lock that one writer at a time may hold: the robot's address, as a name for a file."""
    spare: Spare | None
    """Second way to the robot, for the watchdog; None: this transport lets no second process of ours write."""
    writer: str
    """Name by which other programs know its writer of commands; empty: they know it by its address alone."""
    number: int
    """Number of the last command that was sent."""

    arrivals: Arrivals
    """Filter of the robot's messages, with its counts."""
    malformed: int
    complaint: str
    """Fault of the last malformed message; empty: none."""

    def fileno(self) -> int:
        """Return the file that is readable when a state has come."""

    def receive(self) -> list[RobotState]:
        """Return the new states that have come, oldest first, each newer than all before it; never waits."""

    def peers(self) -> Peers:
        """Return the programs at the other end that are known by now; never waits."""

    def know(self, writer: str) -> None:
        """Count a writer of commands as ours: its commands and readers break no rule; writer: as of that field."""

    def send(self, command: JointCommand) -> int:
        """Send a command; return its number. Never waits."""

    def close(self) -> None:
        """End the connection; sends nothing."""


def state_layout(joints: int, feet: int) -> Layout:
    """Return the message of a `RobotState`."""
    sizes = {"quaternion": 4, "angular_velocity": 3, "acceleration": 3, "joint_position": joints}
    sizes |= dict.fromkeys(("joint_velocity", "joint_torque", "temperature", "lost", "motor_fault"), joints)
    sizes |= {"foot_contact": feet, "battery": 1}
    return Layout(STATE, sizes | dict.fromkeys(("kp", "kd", "torque_limit"), joints) | {"command": 1})


def command_layout(joints: int) -> Layout:
    """Return the message of a `JointCommand`."""
    return Layout(COMMAND, {part.name: joints for part in fields(JointCommand)})


def state_vectors(state: RobotState) -> dict[str, np.ndarray | float]:
    """Return a state as the vectors of its message."""
    vectors = {name: getattr(state, name) for name in STATE_FIELDS}
    return vectors | {name: getattr(state.sensors, name) for name in MEASURED}


def state_of(layout: Layout, message: Message, at: float, age: float = 0.0) -> RobotState:
    """Return the state in a message that was measured at a time [s] and waited for `age` [s]."""
    vectors = layout.vectors(message)
    sensors = Sensors(*(vectors[name] for name in MEASURED))
    arrays = {name: vectors[name] for name in STATE_FIELDS if name not in ("battery", "command")}
    battery, command = float(vectors["battery"][0]), float(vectors["command"][0])
    return RobotState(message.number, at, sensors, **arrays, battery=battery, command=command, age=age)


def command_of(layout: Layout, message: Message) -> JointCommand:
    """Return the command in a message."""
    return JointCommand(**layout.vectors(message))


STATE_FIELDS = tuple(part.name for part in fields(RobotState) if part.name not in ("number", "time", "sensors", "age"))
"""Fields of a robot's message besides the sensors of a policy."""
