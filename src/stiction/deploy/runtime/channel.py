"""Messages between supervisor, policy and logger, over pairs of datagram sockets that no other process has."""

from __future__ import annotations

import errno
import socket
from contextlib import suppress

from stiction.deploy.transports.arrivals import COUNTED
from stiction.deploy.transports.link import MEASURED as SENSORS
from stiction.deploy.transports.messages import Layout, Message
from stiction.files.contract import Contract

SIGHT, TARGETS, ROW = 16, 17, 18
"""Kinds of messages: supervisor to policy, policy to supervisor, supervisor to logger."""

BUFFER = 2**21
"""Bytes that may wait in a channel: some seconds of the log."""


IDLE, RUNNING = 0.0, 1.0


def sight_layout(joints: int) -> Layout:
    """Return the layout of the policy's input: sensors, arrival [s], commanded velocity, mode, an injected fault."""
    sizes = dict(zip(SENSORS, (4, 3, joints, joints), strict=True))
    return Layout(SIGHT, sizes | {"velocity": 3, "robot_time": 1, "mode": 1, "fault": 1})


TIMES = ("lateness", "read", "step", "send", "latency")
"""Times of one step of the policy [s]: behind its deadline; for reading new messages; for observation and network; for
sending the targets, of the step before; and from beginning to read the sensors to having targets."""


def targets_layout(contract: Contract) -> Layout:
    """Return the layout of the policy's answer at every deadline: targets, their limits, its input and output, wear."""
    joints = contract.num_joints
    sizes = {"mode": 1, "skipped": 1, "failed": 1, **dict.fromkeys(TIMES, 1), "target": joints, "action": joints}
    sizes |= {"requested": joints, "limited_by": joints}
    sizes |= {"frame": contract.observation.frame_size, "wear": joints, "wear_low": joints, "wear_high": joints}
    return Layout(TARGETS, sizes | {"unusual": 1})


def row_layout(joints: int, feet: int) -> Layout:
    """Return the layout of the log's row of one reading of the robot."""
    names = ("position", "velocity", "torque", "target", "requested", "limited_by", "forward", "temperature")
    sizes = {"stage": 1, "robot_time": 1, **dict.fromkeys(names, joints)}
    sizes |= {"quaternion": 4, "angular_velocity": 3, "acceleration": 3, "foot_contact": feet, "battery": 1}
    return Layout(ROW, sizes | {"velocity_command": 3} | dict.fromkeys(COUNTED, 1))


def socket_pair() -> tuple[socket.socket, socket.socket]:
    """Return two connected ends that never block; each datagram arrives whole or not at all."""
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    for end in ends:
        end.setblocking(False)
        with suppress(OSError):  # The system's own limit is enough for all but a slow disk.
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
    return ends


class Channel:
    """One end of a pair, for messages of one kind each way."""

    def __init__(self, end: socket.socket, sends: Layout, receives: Layout | None = None) -> None:
        self.end, self._sends, self._receives, self._number = end, sends, receives, 0
        self.lost = 0
        """Number of messages that the other end had no room for."""

    def send(self, time: float, vectors: dict[str, object]) -> bool:
        """Send a message; return False where the other process has ended. Never waits."""
        self._number += 1
        return self.send_raw(self._sends.pack(self._number, time, vectors))

    def send_raw(self, data: bytes) -> bool:
        """Send bytes as they are; see `send`."""
        try:
            self.end.send(data)
        except OSError as error:
            if not isinstance(error, BlockingIOError | InterruptedError) and error.errno != errno.ENOBUFS:
                return False
            self.lost += 1
        return True

    def receive(self) -> list[Message]:
        """Return the messages that have come, oldest first; never waits."""
        assert self._receives is not None
        return [message for data in self._read() if (message := self._receives.unpack(data)) is not None]

    def newest(self) -> Message | None:
        """Return the newest of the messages that have come, without a look at older ones; never waits."""
        assert self._receives is not None
        return next(filter(None, map(self._receives.unpack, reversed(self._read()))), None)

    def _read(self) -> list[bytes]:
        assert self._receives is not None
        datagrams: list[bytes] = []
        with suppress(OSError):
            # One byte too many: a longer datagram would be cut to the right length.
            while data := self.end.recv(self._receives.bytes + 1):
                datagrams.append(data)
        return datagrams

    def close(self) -> None:
        """Close this end."""
        self.end.close()
