"""What a person, or a second machine, says to a run: stop, by four ways, and the velocity that is wanted.

* a key: space, q, or Enter, where standard input is a terminal;
* a signal: SIGINT (Ctrl-C), SIGTERM, SIGHUP;
* a file that appears;
* a second machine that no longer says that it is there.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.deploy.runtime.config import OperatorCfg
from stiction.formats.velocity import AXES

KEYS = b" q\r\n"
"""Keys that stop the robot."""

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

ALIVE = b"alive"
"""What a second machine sends, some ten times a second."""

LARGEST_COMMAND = 512
"""Bytes of a velocity command."""


class Operator:
    """Listens to whoever may stop or steer a run; never waits."""

    def __init__(self, cfg: OperatorCfg, now: float) -> None:
        """Open what the configuration names.

        Raises `ConfigurationError`: an address that is none or cannot be listened at, or a stop file that exists.
        """
        self._cfg, self._asked, self._alive = cfg, "", now
        self._heartbeat = None if cfg.heartbeat is None else _listen(cfg.heartbeat, "--heartbeat")
        self._commands = None if cfg.command_from is None else _listen(cfg.command_from, "--command-from")
        self.complaint = ""
        """What was wrong with the last velocity command that was none; empty: nothing."""
        self._terminal = sys.stdin.fileno() if sys.stdin is not None and sys.stdin.isatty() else None
        if cfg.stop_file is not None and cfg.stop_file.exists():
            raise ConfigurationError(f"{cfg.stop_file} is there already, and would stop the run; remove it first")

    @property
    def remote(self) -> bool:
        """Whether velocity commands come from elsewhere."""
        return self._commands is not None

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Take signals and keys while the run lasts; close everything then."""
        before: dict[int, Any] = {number: signal.signal(number, self._signal) for number in SIGNALS}
        modes = None
        if self._terminal is not None:
            modes = termios.tcgetattr(self._terminal)
            # At once: by default a key that was pressed already would be thrown away.
            tty.setcbreak(self._terminal, termios.TCSANOW)
        try:
            yield
        finally:
            if self._terminal is not None and modes is not None:
                termios.tcsetattr(self._terminal, termios.TCSANOW, modes)
            for number, handler in before.items():
                signal.signal(number, handler)
            for port in (self._heartbeat, self._commands):
                if port is not None:
                    port.close()

    def files(self) -> list[int]:
        """Return the files that become readable when an operator sends something."""
        ports = [port.fileno() for port in (self._heartbeat, self._commands) if port is not None]
        return ports if self._terminal is None else [*ports, self._terminal]

    def stop(self, now: float) -> str:
        """Return what asks the run to stop, in words; empty: nothing does."""
        if self._asked:
            return self._asked
        if self._cfg.stop_file is not None and self._cfg.stop_file.exists():
            return f"the file {self._cfg.stop_file}"
        if self._heartbeat is not None:
            # All that has come is read, not up to the first that counts: a backlog would pass for a sender that lives.
            if ALIVE in list(_datagrams(self._heartbeat)):
                self._alive = now
            if now - self._alive > self._cfg.heartbeat_timeout:
                return f"no heartbeat at {self._cfg.heartbeat} for {now - self._alive:.2f} s"
        if self._terminal is not None and _key(self._terminal):
            return "a key"
        return ""

    def velocity(self) -> np.ndarray | None:
        """Return the newest velocity command that has come, shape (3,); None where there is no new one."""
        found = None
        if self._commands is not None:
            for data in _datagrams(self._commands):
                try:
                    found, self.complaint = parse_velocity(data), ""
                except ValueError as error:
                    self.complaint = str(error)
        return found

    def _signal(self, number: int, _: FrameType | None) -> None:
        """Take a signal."""
        self._asked = signal.Signals(number).name


def parse_velocity(data: bytes) -> np.ndarray:
    """Return the velocity of a command such as {"vx": 0.5}, shape (3,).

    Raises `ValueError`: no such object, another name than vx, vy, wz, or what is no number.
    """
    try:
        said = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise ValueError("expected JSON such as {'vx': 0.5}") from error
    if not isinstance(said, dict) or not said or set(said) - set(AXES):
        raise ValueError(f"expected an object with some of {', '.join(AXES)}; got {str(said)[:60]}")
    if not all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in said.values()):
        raise ValueError(f"expected numbers; got {str(said)[:60]}")
    # JSON knows whole numbers of any length, NaN and Infinity.
    if not all(abs(value) <= sys.float_info.max for value in said.values()):
        raise ValueError(f"expected finite numbers; got {data[:60]!r}")
    return np.array([float(said.get(axis, 0.0)) for axis in AXES])


def _listen(address: str, option: str) -> socket.socket:
    """Return a socket at HOST:PORT."""
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise ConfigurationError(f"{option} {address!r}: expected HOST:PORT, such as 127.0.0.1:9000")
    listening = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        listening.bind((host, int(port)))
    except OSError as error:
        listening.close()
        raise ConfigurationError(f"{option} {address}: cannot listen there: {error.strerror or error}") from error
    listening.setblocking(False)
    return listening


def _datagrams(port: socket.socket) -> Iterator[bytes]:
    """Yield what has come, some at a time: a flood does not hold up the supervisor."""
    for _ in range(64):
        try:
            yield port.recv(LARGEST_COMMAND)
        except OSError:
            return


def _key(terminal: int) -> bool:
    """Return whether a key that stops was pressed."""
    # Whoever else has the terminal open, the shell for one, shares this setting: it is put back.
    os.set_blocking(terminal, False)
    try:
        with suppress(OSError):
            return any(key in KEYS for key in os.read(terminal, 64) or b"")
    finally:
        os.set_blocking(terminal, True)
    return False
