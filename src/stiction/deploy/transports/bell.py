"""A file that another thread makes readable, for libraries that have none to wait for."""

from __future__ import annotations

import socket
from contextlib import suppress


class Bell:
    """A file that is readable from when it is rung until it is silenced; it never waits."""

    def __init__(self) -> None:
        """Begin silent."""
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
