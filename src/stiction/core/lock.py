"""One writer a folder: two trainings of one run, or two evaluations into one folder, would mix their results.

The kernel holds the lock (flock) and drops it when the process ends, however it does. Who holds it stands in the file,
for the one who is refused. Reading needs no lock: a run that goes on can be exported and watched.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import shlex
import socket
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path

from stiction.core.errors import FileError
from stiction.core.records import make_folder

LOCK = ".lock"

LONGEST = 4096
"""Bytes that are read of who holds a lock."""

_held: dict[Path, int] = {}
"""Lock file -> how often this process holds it."""


@contextmanager
def _made(folder: Path, option: str) -> Iterator[None]:
    """Make a folder; if it was not there and stays empty, it goes again."""
    new = not folder.exists()
    make_folder(folder, option)
    try:
        yield
    finally:
        if new:
            with suppress(OSError):
                folder.rmdir()


@contextmanager
def output_folder(out: Path, option: str = "--out") -> Iterator[None]:
    """Make the directory for results, which `option` names, and be its only writer.

    If it was not there and stays empty, as where a name was misspelt, it goes again. Raises `StictionError` where it
    cannot be made or written, or another process writes it.
    """
    with _made(out, option), _locked(out / LOCK, out, option):
        yield


def is_written(folder: Path) -> bool:
    """Return whether a process holds the lock of a directory; nothing is made or changed."""
    try:
        number = os.open(folder / LOCK, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(number, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:
        return isinstance(error, BlockingIOError)
    finally:
        os.close(number)
    return False


@contextmanager
def replaced_folder(out: Path, option: str = "--out") -> Iterator[None]:
    """Hold the lock beside a folder while the folder is replaced as a whole.

    Raises `StictionError` as `output_folder`.
    """
    out = out.absolute()
    if out.name in ("", ".."):
        raise FileError(f"{out} cannot be replaced as a whole; choose an {option} with a name of its own")
    with _made(out.parent, option), _locked(out.with_name(f".{out.name}{LOCK}"), out, option):
        yield


@contextmanager
def one_writer(name: str, what: str) -> Iterator[None]:
    """Be the only process of this user on this machine that drives something which is no folder, such as a robot.

    name: of what is driven, for a file's name; what: the same for people. Raises `StictionError` where another process
    does.
    """
    folder = Path(tempfile.gettempdir()) / f"stiction-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        # In a folder where everybody may write, another user may have made it first.
        if folder.is_symlink() or folder.stat().st_uid != os.getuid():
            raise FileError(
                f"{folder} is somebody else's; two writers could not see each other: set TMPDIR to your own"
            )
    except OSError as error:
        raise FileError(f"{folder} cannot be made: {error.strerror}; set TMPDIR to a folder that can") from error
    file = folder / f"{re.sub('[^A-Za-z0-9_.-]', '-', name)[:100]}{LOCK}"
    with _locked(file, Path(what), "robot, or end that process"):
        yield


@contextmanager
def _locked(file: Path, folder: Path, option: str) -> Iterator[None]:
    """Hold the lock of a file; within one process as often as wanted."""
    # The folder by whatever way it was named; not the file, since a link in its place is to be refused.
    file = file.parent.resolve() / file.name
    # The lock belongs to what was opened: a second opening by this very process would be refused as another's.
    number = None if file in _held else _take(file, folder, option)
    _held[file] = _held.get(file, 0) + 1
    try:
        yield
    finally:
        _held[file] -= 1
        if number is not None:
            del _held[file]
            # Whoever waits to open the file must not find it locked and gone: first the name, then the lock.
            with suppress(OSError):
                file.unlink()
            os.close(number)


def _take(file: Path, folder: Path, option: str) -> int:
    """Lock a file and write into it who holds it; return its descriptor."""
    while True:
        try:
            number = os.open(file, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise FileError(f"{folder} cannot be written: {error.strerror}; choose another {option}") from error
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Between opening and locking its holder may have removed it, and another process made it anew: a lock on a
            # file without a name keeps nobody out.
            there = file.stat()
            if (there.st_dev, there.st_ino) == (os.fstat(number).st_dev, os.fstat(number).st_ino):
                with suppress(OSError):  # A full disk: the lock holds without its text.
                    os.ftruncate(number, 0)
                    os.pwrite(number, _who().encode(errors="replace"), 0)
                return number
        except BlockingIOError as error:
            holder = _holder(number)
            os.close(number)
            raise FileError(
                f"{folder} is being written by {holder}; wait until it has ended, or choose another {option}"
            ) from error
        except FileNotFoundError:
            pass
        except OSError as error:
            os.close(number)
            raise FileError(
                f"{folder} cannot be locked: {error.strerror}, and two writers would spoil it; choose an {option} on a "
                "file system that has locks"
            ) from error
        # Its holder has removed it in between.
        os.close(number)


def _who() -> str:
    program = Path(sys.argv[0])
    words = [program.parent.name if program.name == "__main__.py" else program.name, *sys.argv[1:]]
    since = datetime.now().astimezone().isoformat(timespec="seconds")
    who = {"pid": os.getpid(), "host": socket.gethostname(), "since": since, "command": shlex.join(words)[:1000]}
    return json.dumps(who) + "\n"


def _holder(number: int) -> str:
    try:
        who = json.loads(os.pread(number, LONGEST, 0))
        since, command = str(who["since"])[:40], str(who["command"])[:200]
        return f"process {int(who['pid'])} on {str(who['host'])[:80]} since {since} (`{command}`)"
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return "another process"
