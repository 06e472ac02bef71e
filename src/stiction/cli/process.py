"""Process of a command: its streams, the signals that end it, and one line for any failure."""

from __future__ import annotations

import os
import signal
import sys
import traceback
from pathlib import Path
from types import FrameType
from typing import Any, TextIO

from stiction.core.errors import FileError, StictionError, escaped
from stiction.core.extras import missing_extra, outdated
from stiction.core.lifeline import follow_parent

DEBUG = "--debug"
"""Word that adds the traceback to the line of an error, with any verb."""

LONGEST = 300
"""Characters of what an error says that nobody foresaw."""


class Ended(KeyboardInterrupt):
    """A signal asked the process to end: everything is closed on the way out."""

    def __init__(self, number: int) -> None:
        """`number`: of the signal."""
        super().__init__()
        self.number = number


class Stream:
    """Standard output or error: escapes what could steer a terminal, and knows what a reader that is gone means."""

    def __init__(self, file: TextIO, lasting: bool, escapes: bool = True) -> None:
        """`lasting`: whether work goes on where it cannot be written; `escapes`: not for what draws the terminal."""
        self._file, self._lasting, self._escapes = file, lasting, escapes

    @property
    def rich_proxied_file(self) -> Stream:
        """Stream on which `rich` draws: its control sequences reach the terminal unescaped."""
        return Stream(self._file, self._lasting, escapes=False)

    def __getattr__(self, name: str) -> Any:
        """Return all else that the stream has."""
        return getattr(self._file, name)

    def write(self, text: str) -> int:
        """Write a text. Raises as `flush`."""
        try:
            return self._file.write(escaped(text) if self._escapes else text)
        except OSError as error:
            self._fail(error)
            return len(text)

    def flush(self) -> None:
        """Bring everything out.

        Raises `SystemExit` with status 0 where the reader of standard output (`| head`) has seen enough, and
        `StictionError` where it cannot be written for another reason.
        """
        try:
            self._file.flush()
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        """Handle a stream that cannot be written, so that Python does not try again on closing it."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        # What is left in the buffer is written at exit, and must not fail there once more.
        os.dup2(nowhere, self._file.fileno())
        os.close(nowhere)
        if self._lasting:
            return
        if isinstance(error, BrokenPipeError):
            raise SystemExit(0) from error
        raise FileError(f"standard output cannot be written: {error.strerror}") from error


def begin() -> None:
    """Prepare the process of a command."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # Closed by the caller: the next file that is opened would get its number, and what is printed.
            os.open(os.devnull, os.O_RDWR)
    for name in ("stdout", "stderr"):
        file = getattr(sys, name) or Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
        file.reconfigure(errors="backslashreplace")
        setattr(sys, name, Stream(file, lasting=name == "stderr"))
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_DFL:  # nohup has SIGHUP ignored
            signal.signal(number, _end)
    # With the signal that was just given a handler, so that a command whose parent dies closes everything too.
    follow_parent(signal.SIGTERM)


def _end(number: int, _: FrameType | None) -> None:
    """Take a signal that ends the process; the next one does so at once."""
    # So that a second signal ends a process whose way out hangs.
    signal.signal(number, signal.SIG_DFL)
    raise Ended(number)


def stopped(stop: KeyboardInterrupt) -> tuple[str, int]:
    """Return what to say of a process that was stopped, and its status."""
    if isinstance(stop, Ended):
        return f"ended by {signal.Signals(stop.number).name}", 128 + stop.number
    return "interrupted", 130


def explained(error: Exception, verb: str) -> str:
    """Return the one line for an error of a verb, whatever it is."""
    if isinstance(error, StictionError):
        return " ".join(str(error).split())
    if isinstance(error, ModuleNotFoundError):
        missing = missing_extra(error, "this verb")
        if missing is not None:
            return missing
    message = " ".join(escaped(str(error)).split())[:LONGEST]
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename or 'a file'}: {error.strerror}; expected one that can be read or written"
    if isinstance(error, MemoryError):
        return f"there is not enough memory ({message or 'the system gave none'}); ask for less at once"
    if "MUJOCO_GL" in message:  # MuJoCo reads it when it is imported
        return f"{message}; expected egl, osmesa, glfw or disable, or nothing: unset it"
    if "mujoco" in sys.modules and "mjlab" not in sys.modules and (old := outdated()) is not None:
        return f"{old} (unforeseen {type(error).__name__}: {message})"
    return (
        f"unforeseen {type(error).__name__}: {message}; this is a fault of stiction: please report it where you found "
        f"the project, with what `stiction {verb} ... {DEBUG}` says"
    )


def failed(error: Exception, verb: str, debug: bool) -> int:
    """Print the line of an error, with `debug` its traceback before it; return the exit status."""
    if debug:
        print(escaped("".join(traceback.format_exception(error))), end="", file=sys.stderr)
    print(f"stiction {verb}: {escaped(explained(error, verb))}", file=sys.stderr)
    return 1
