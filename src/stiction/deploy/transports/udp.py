"""A robot behind UDP datagrams: the virtual robot on loopback, or any robot for which somebody wrote the other end."""

from __future__ import annotations

import secrets
import socket
from collections.abc import Sequence
from contextlib import suppress

from stiction.core.errors import RobotError
from stiction.deploy.pilot import JointCommand
from stiction.deploy.transports.link import RobotState, command_layout, state_layout, state_of

LOOPBACK = "127.0.0.1"

HELLO = b"STCN?"
"""Asks a robot for its states."""

MOST_AT_ONCE = 256
"""Datagrams that are read in one go; whoever floods the port does not hold up the supervisor."""


class UdpLink:
    """`Link` over UDP. Only datagrams of the robot's own address are read; the rest never reach this process."""

    def __init__(
        self, address: tuple[str, int], joint_names: Sequence[str], foot_names: Sequence[str], period: float
    ) -> None:
        """Open a port of our own, on the way to the robot's address, and send nothing.

        Raises `RobotError`: there is no way to that address.
        """
        self.joint_names, self.foot_names, self.period = tuple(joint_names), tuple(foot_names), period
        self.lock_name = f"udp-{address[0]}-{address[1]}"
        self._states = state_layout(len(joint_names), len(foot_names))
        self._commands = command_layout(len(joint_names))
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        # From a number of chance, so that a second writer's commands are not taken for ours.
        self._number = secrets.randbits(40)
        self.malformed = 0
        """Datagrams that were no whole state."""
        self.complaint = ""
        """What was wrong with the last of them."""
        try:
            self._socket.connect(address)
        except OSError as error:
            self._socket.close()
            raise RobotError(f"no way to a robot at {address[0]}:{address[1]}: {error.strerror or error}") from error
        self._socket.setblocking(False)

    def hello(self) -> None:
        """Ask the robot for its states; it moves nothing."""
        with suppress(OSError):
            self._socket.send(HELLO)

    def fileno(self) -> int:
        """Return the socket's file."""
        return self._socket.fileno()

    def receive(self) -> list[RobotState]:
        """Return the whole states that have come, oldest first."""
        found = []
        for _ in range(MOST_AT_ONCE):
            try:
                data = self._socket.recv(self._states.bytes + 1)
            except OSError:  # Nothing there, or nobody at the other end: the state will be found stale.
                break
            message = self._states.unpack(data)
            if message is None:
                self.malformed += 1
                self.complaint = f"{len(data)} bytes that are no whole state of this robot"
            else:
                found.append(state_of(self._states, message))
        return found

    def send(self, command: JointCommand) -> int:
        """Send a command; return its number. What cannot be sent is lost, as a datagram is."""
        self._number += 1
        data = self._commands.pack(self._number, 0.0, vars(command))
        with suppress(OSError):
            self._socket.send(data)
        return self._number

    def close(self) -> None:
        """Close the port."""
        self._socket.close()
