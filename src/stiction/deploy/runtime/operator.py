"""Stop, by four ways, and the velocity command, from a person or a second machine.

* a key: space, q, Enter, Ctrl-Z or Ctrl-backslash, where standard input is a terminal;
* a signal: every one that can be caught and would end or halt the process, SIGINT (Ctrl-C) and SIGTERM among them;
* a file that appears;
* a second machine whose heartbeat ends.
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
from contextlib import ExitStack, contextmanager, suppress
from types import FrameType

import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.deploy.runtime.config import OperatorCfg
from stiction.files.velocity import AXES

KEYS = b" q\r\n\x1a\x1c"
"""Keys that stop the robot; the last two are Ctrl-Z and Ctrl-backslash, which halt or end a process elsewhere."""

NO_STOP = {"KILL", "STOP", "CONT", "CHLD", "WINCH", "URG", "PIPE", "XFSZ", "INFO", "SEGV", "BUS", "FPE", "ILL"}
"""Signals that do not stop a run: two that no program can catch, some that end no process or that Python ignores, and
four of a broken program, which could not send anything after them."""

SIGNALS = tuple(
    number for number in signal.valid_signals() if getattr(number, "name", "").removeprefix("SIG") not in NO_STOP
)

ALIVE = b"alive"
"""Heartbeat of a second machine, sent some ten times a second."""

LARGEST_COMMAND = 512


class Operator:
    """Inputs that may stop or steer a run; never waits."""

    def __init__(self, cfg: OperatorCfg, now: float) -> None:
        """Open the configured inputs.

        Raises `ConfigurationError`: an invalid address, one that cannot be listened at, or a stop file that exists.
        """
        self._cfg, self._asked, self._alive = cfg, "", now
        self._heartbeat = None if cfg.heartbeat is None else _listen(cfg.heartbeat, "--operator.heartbeat")
        self._commands = None if cfg.command_from is None else _listen(cfg.command_from, "--operator.command-from")
        self.complaint = ""
        """Fault of the last velocity command that was rejected; empty: none."""
        self.signal: int | None = None
        """Number of the first signal; None: none came."""
        terminal = sys.stdin.fileno() if sys.stdin is not None and sys.stdin.isatty() else None
        self._terminal = terminal if terminal is not None and _in_foreground(terminal) else None
        if cfg.stop_file is not None and cfg.stop_file.exists():
            raise ConfigurationError(f"{cfg.stop_file} exists already, and would stop the run; remove it first")

    @property
    def remote(self) -> bool:
        """True if velocity commands come from elsewhere."""
        return self._commands is not None

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Take signals and keys while the run lasts; close everything then."""
        with ExitStack() as stack:
            for port in (self._heartbeat, self._commands):
                if port is not None:
                    stack.callback(port.close)
            for number in SIGNALS:
                stack.callback(signal.signal, number, signal.signal(number, self._signal) or signal.SIG_DFL)
            if self._terminal is not None:
                stack.enter_context(_keys_alone(self._terminal))
            yield

    def files(self) -> list[int]:
        """Return the files that become readable when an operator sends something."""
        ports = [port.fileno() for port in (self._heartbeat, self._commands) if port is not None]
        return ports if self._terminal is None else [*ports, self._terminal]

    def stop(self, now: float) -> str:
        """Return the request to stop in words; empty: none."""
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
        """Return the newest velocity command, shape (3,); None where there is no new one."""
        newest = None
        if self._commands is not None:
            for data in _datagrams(self._commands):
                try:
                    newest, self.complaint = parse_velocity(data), ""
                except ValueError as error:
                    self.complaint = str(error)
        return newest

    def _signal(self, number: int, _: FrameType | None) -> None:
        if self.signal is None:
            named = number in set(signal.Signals)
            self.signal, self._asked = number, signal.Signals(number).name if named else f"signal {number}"


def parse_velocity(data: bytes) -> np.ndarray:
    """Return the velocity of a command such as {"vx": 0.5}, shape (3,).

    Raises `ValueError`: no such object, another name than vx, vy, wz, or a value that is not a number.
    """
    try:
        command = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise ValueError("expected JSON such as {'vx': 0.5}") from error
    if not isinstance(command, dict) or not command or set(command) - set(AXES):
        raise ValueError(f"expected an object with some of {', '.join(AXES)}; got {str(command)[:60]}")
    if not all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in command.values()):
        raise ValueError(f"expected numbers; got {str(command)[:60]}")
    # JSON knows whole numbers of any length, NaN and Infinity.
    if not all(abs(value) <= sys.float_info.max for value in command.values()):
        raise ValueError(f"expected finite numbers; got {data[:60]!r}")
    return np.array([float(command.get(axis, 0.0)) for axis in AXES])


def _listen(address: str, option: str) -> socket.socket:
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
    """Yield new datagrams, some at a time: a flood does not hold up the supervisor."""
    for _ in range(64):
        try:
            yield port.recv(LARGEST_COMMAND)
        except OSError:
            return


def _in_foreground(terminal: int) -> bool:
    """Return True if this process may read and set up a terminal: in the background it would be halted for that."""
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:
        return True  # Not the terminal that controls this process, which sends it no signals.


@contextmanager
def _keys_alone(terminal: int) -> Iterator[None]:
    """Let a terminal hand over each key at once, Ctrl-Z and Ctrl-backslash too; put everything back on the way out."""
    before = termios.tcgetattr(terminal)
    try:
        # At once: by default a key that was pressed already would be thrown away.
        tty.setcbreak(terminal, termios.TCSANOW)
        modes, nobody = termios.tcgetattr(terminal), bytes([os.fpathconf(terminal, "PC_VDISABLE")])
        for key in (termios.VSUSP, termios.VQUIT, *([termios.VDSUSP] if hasattr(termios, "VDSUSP") else [])):
            modes[6][key] = nobody
        termios.tcsetattr(terminal, termios.TCSANOW, modes)
        yield
    finally:
        # A process in the background is halted for this, or refused, unless the signal is blocked.
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTTOU})
        try:
            with suppress(termios.error):  # A terminal that has gone needs nothing.
                termios.tcsetattr(terminal, termios.TCSANOW, before)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def _key(terminal: int) -> bool:
    # Whoever else has the terminal open, the shell for one, shares this setting: it is put back.
    os.set_blocking(terminal, False)
    try:
        with suppress(OSError):
            return any(key in KEYS for key in os.read(terminal, 64) or b"")
    finally:
        os.set_blocking(terminal, True)
    return False
