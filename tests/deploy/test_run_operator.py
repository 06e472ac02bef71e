"""Four ways to stop a robot, and malformed velocity commands."""

from __future__ import annotations

import os
import pty
import signal
import socket
import sys
import termios
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from stiction.core.errors import ConfigurationError
from stiction.deploy.runtime.config import OperatorCfg
from stiction.deploy.runtime.operator import ALIVE, SIGNALS, Operator, parse_velocity


def free_port() -> int:
    """Return an unused UDP port on loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.bind(("127.0.0.1", 0))
        return int(port.getsockname()[1])


def say(data: bytes, port: int) -> None:
    """Send a datagram."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(data, ("127.0.0.1", port))


@pytest.mark.parametrize("number", [*SIGNALS[:20], SIGNALS[-2]])
def test_a_signal_stops_and_is_given_back(number: int) -> None:
    """Each signal that can be caught stops the run, the first one is the reason, and its old handler comes back."""
    before = signal.getsignal(number)
    operator = Operator(OperatorCfg(), 0.0)
    with operator.listening():
        assert operator.stop(1.0) == ""
        os.kill(os.getpid(), number)
        os.kill(os.getpid(), signal.SIGINT)
        assert operator.stop(1.0) == getattr(number, "name", f"signal {number}") and operator.signal == number
    assert signal.getsignal(number) == before


def test_a_file_stops_and_one_that_is_there_is_refused(tmp_path: Path) -> None:
    """The stop file of the last run ends the next one at once, or the file does nothing."""
    file = tmp_path / "stop"
    operator = Operator(OperatorCfg(stop_file=file), 0.0)
    assert operator.stop(1.0) == ""
    file.touch()
    assert "stop" in operator.stop(1.0)
    with pytest.raises(ConfigurationError, match="already"):
        Operator(OperatorCfg(stop_file=file), 0.0)


def test_a_second_machine_that_falls_silent_stops() -> None:
    """Whoever watches the robot from outside loses the network, and it walks on."""
    port = free_port()
    operator = Operator(OperatorCfg(heartbeat=f"127.0.0.1:{port}"), 0.0)
    with operator.listening():
        assert operator.stop(0.4) == ""
        say(ALIVE, port)
        assert operator.stop(0.45) == ""
        say(b"something else", port)
        assert operator.stop(0.9) == ""
        assert "no heartbeat" in operator.stop(0.96)


def test_a_key_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    """The space bar does nothing, or the terminal stays odd."""
    ours, theirs = pty.openpty()
    with os.fdopen(theirs, "rb", buffering=0) as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        operator = Operator(OperatorCfg(), 0.0)
        with operator.listening():
            os.write(ours, b"x")
            assert operator.stop(0.1) == ""
            for key in (b" ", b"\x1a", b"\x1c"):
                os.write(ours, key)
                assert operator.stop(0.2) == "a key"
    os.close(ours)


@pytest.mark.parametrize("error", [None, RuntimeError, KeyboardInterrupt, SystemExit])
def test_the_terminal_s_keys_are_off_while_it_runs_and_come_back(
    monkeypatch: pytest.MonkeyPatch, error: type[BaseException] | None
) -> None:
    """Ctrl-Z and Ctrl-backslash neither halt nor end a run; the terminal is as before on all ways out."""
    ours, theirs = pty.openpty()
    with os.fdopen(theirs, "rb", buffering=0) as terminal, suppress(*([error] if error else [])):
        monkeypatch.setattr(sys, "stdin", terminal)
        before = termios.tcgetattr(terminal)
        assert before[6][termios.VSUSP] == b"\x1a"
        try:
            with Operator(OperatorCfg(), 0.0).listening():
                keys = termios.tcgetattr(terminal)[6]
                assert keys[termios.VSUSP] == keys[termios.VQUIT] == b"\0"
                if error is not None:
                    raise error
        finally:
            assert termios.tcgetattr(terminal) == before
    os.close(ours)


def test_velocity_commands_are_read_and_misspelt_ones_are_none() -> None:
    """A misspelt axis is lost without a word, and the robot walks on by the old command."""
    port = free_port()
    operator = Operator(OperatorCfg(command_from=f"127.0.0.1:{port}"), 0.0)
    with operator.listening():
        assert operator.remote and operator.velocity() is None
        say(b'{"vx": 0.1}', port)
        say(b'{"vx": 0.4, "wz": -0.2}', port)
        velocity = operator.velocity()
        assert velocity is not None and operator.complaint == ""
        np.testing.assert_array_equal(velocity, [0.4, 0.0, -0.2])
        say(b'{"vX": 0.4}', port)
        assert operator.velocity() is None and "vx, vy, wz" in operator.complaint


ENDLESS = (b'{"vx": 1' + b"0" * 400 + b"}", b'{"vx": NaN}', b'{"vx": 1, "wz": -Infinity}')
"""Numbers that JSON has and a robot has not: the first ended the run, as an error that nobody expected."""


@pytest.mark.parametrize("wrong", [b"", b"{}", b"[1]", b'{"vx": "1"}', b'{"vx": true}', b"\xff", b"[" * 5000, *ENDLESS])
def test_what_is_no_velocity_is_refused(wrong: bytes) -> None:
    """Noise on the network moves the robot."""
    with pytest.raises(ValueError, match="expected"):
        parse_velocity(wrong)


@pytest.mark.parametrize("wrong", ["9000", "127.0.0.1:0", "127.0.0.1:x", ":9000", "10.255.255.1:9000"])
def test_addresses_that_are_none_or_not_ours_are_refused(wrong: str) -> None:
    """A heartbeat that can never be heard stops the run without a reason."""
    with pytest.raises(ConfigurationError, match="heartbeat"):
        Operator(OperatorCfg(heartbeat=wrong), 0.0)
