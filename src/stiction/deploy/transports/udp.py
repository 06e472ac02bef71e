"""Link to a robot behind UDP datagrams: the virtual robot on loopback, or any robot with such an end."""

from __future__ import annotations

import secrets
import socket
import struct
import sys
import time
from collections.abc import Sequence
from contextlib import suppress

from stiction.core.errors import RobotError
from stiction.deploy.control import JointCommand
from stiction.deploy.transports.arrivals import Arrivals
from stiction.deploy.transports.link import Peers, RobotState, Spare, command_layout, state_layout, state_of

LOOPBACK = "127.0.0.1"

HELLO = b"STCN?"

MOST_AT_ONCE = 256
"""Most datagrams that are read in one go; a flood of the port does not hold up the supervisor."""

QUEUE = 2**22
"""Requested size of the queue of states [B], two seconds of them: on a busy computer they come in bursts, and
a state that does not fit counts as lost on the way."""

STRANGERS_AT_ONCE = 8
"""Most datagrams of other addresses that are read in one go."""

ARRIVAL = 35
"""Linux: SO_TIMESTAMPNS and its message, the time of arrival as seconds and nanoseconds since 1970."""

TIMESPEC = struct.Struct("@ll")


class UdpLink:
    """`Link` over UDP to one address, pinned from the begin: states of any other are not used, but counted.

    The system sorts the datagrams, into a socket for that address and one for all others: a flood from elsewhere cannot
    push out the robot's states.
    """

    def __init__(
        self,
        address: tuple[str, int],
        joint_names: Sequence[str],
        foot_names: Sequence[str],
        period: float,
        file: int | None = None,
    ) -> None:
        """Open a port of our own, on the way to the robot's address, and send nothing.

        file: descriptor of a port that another process has opened so, in its place; the address is then not used.

        Raises `RobotError`: there is no way to that address.
        """
        self.joint_names, self.foot_names, self.period = tuple(joint_names), tuple(foot_names), period
        self.lock_name = f"udp-{address[0]}-{address[1]}"
        self._states = state_layout(len(joint_names), len(foot_names))
        self._commands = command_layout(len(joint_names))
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM, fileno=file)
        # The same port, so that the robot hears one writer, and goes on sending its states to it.
        names = {"joint_names": self.joint_names, "foot_names": self.foot_names, "period": period}
        self.spare: Spare | None = Spare("udp", names, (self._socket.fileno(),))
        self.writer = ""
        # From a random number, so that a second writer's commands are not taken for ours.
        self.number = secrets.randbits(40)
        self.malformed, self.complaint = 0, ""
        self.arrivals, self._emptied = Arrivals(period=period), time.monotonic()
        self._strangers = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._robots = [f"{address[0]}:{address[1]}"]
        try:
            for port in (self._socket, self._strangers):
                port.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
                port.setblocking(False)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, QUEUE)
            if sys.platform == "linux":
                self._socket.setsockopt(socket.SOL_SOCKET, ARRIVAL, 1)
            if file is None:
                self._socket.connect(address)
                self._strangers.bind(self._socket.getsockname())
        except OSError as error:
            self.close()
            raise RobotError(f"no way to a robot at {address[0]}:{address[1]}: {error.strerror or error}") from error

    def hello(self) -> None:
        """Ask the robot for its states; it moves nothing."""
        with suppress(OSError):
            self._socket.send(HELLO)

    def fileno(self) -> int:
        """Return the socket's file."""
        return self._socket.fileno()

    def receive(self) -> list[RobotState]:
        """Return the whole and new states that have come, oldest first."""
        states: list[RobotState] = []
        # A state that has come since the port was last empty has not waited for longer, whatever its stamp.
        longest, emptied = (now := time.monotonic()) - self._emptied, False
        for _ in range(MOST_AT_ONCE):
            try:
                data, extra, _, _ = self._socket.recvmsg(self._states.bytes + 1, 64)
            except OSError:  # No datagram, or no process at the other end: the state will be found stale.
                emptied = True
                break
            message = self._states.unpack(data)
            if message is None:
                self.malformed += 1
                self.complaint = f"{len(data)} bytes, not a whole state of this robot"
                continue
            age = min(_age(extra), longest)
            at = self.arrivals.take(message.time, now - age, message.number)
            if at is not None:
                states.append(state_of(self._states, message, at, age))
        self._emptied = now if emptied else self._emptied
        return states

    def peers(self) -> Peers:
        """Return the robot, and other addresses from which whole states have come; commands reach the robot alone."""
        for _ in range(STRANGERS_AT_ONCE):
            try:
                data, (host, port) = self._strangers.recvfrom(self._states.bytes + 1)
            except OSError:
                break
            if self._states.unpack(data) is not None and len(self._robots) < 2:
                self._robots.append(f"{host}:{port}")
        return Peers(tuple(self._robots))

    def know(self, writer: str) -> None:
        """Do nothing: the watchdog writes from this very port."""

    def send(self, command: JointCommand) -> int:
        """Send a command; return its number. A command that cannot be sent is lost, as a datagram is."""
        self.number += 1
        data = self._commands.pack(self.number, 0.0, vars(command))
        with suppress(OSError):
            self._socket.send(data)
        return self.number

    def close(self) -> None:
        """Close the port."""
        self._socket.close()
        self._strangers.close()


def _age(extra: list[tuple[int, int, bytes]]) -> float:
    """Return the time that a datagram waited [s], by the system's stamp; 0 without one."""
    for level, kind, data in extra:
        if (level, kind) == (socket.SOL_SOCKET, ARRIVAL) and len(data) >= TIMESPEC.size:
            seconds, nanoseconds = TIMESPEC.unpack_from(data)
            return max(0.0, 1e-9 * (time.time_ns() - 1_000_000_000 * seconds - nanoseconds))
    return 0.0
