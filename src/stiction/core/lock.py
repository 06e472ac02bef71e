"""Exclusive lock on an output directory: two processes that write the same results would mix them.

The kernel holds the lock (flock) and drops it when the process ends. The file names its holder, for the message to a
second process. Reading needs no lock: a run in progress can be exported and watched.
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
"""Maximum size of the description of a lock's holder [B]."""

_held: dict[Path, int] = {}
"""Lock file -> how often this process holds it."""


@contextmanager
def _made_folder(folder: Path, option: str) -> Iterator[None]:
    """Make a directory; remove it on exit if this call created it and nothing was written."""
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
    """Make the directory for results, which `option` names, and lock it for writing.

    Remove it on exit if this call created it and nothing was written. Raises `StictionError` where it cannot be made or
    written, or another process writes it.
    """
    with _made_folder(out, option), _locked(out / LOCK, out, option):
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
    """Hold a lock next to a folder while the folder is replaced as a whole.

    Raises `StictionError` as `output_folder`.
    """
    out = out.absolute()
    if out.name in ("", ".."):
        raise FileError(f"{option}: got {out}, expected a folder with a name; choose another {option}")
    with _made_folder(out.parent, option), _locked(out.with_name(f".{out.name}{LOCK}"), out, option):
        yield


@contextmanager
def exclusive_lock(name: str, what: str) -> Iterator[None]:
    """Hold an exclusive per-user lock on a non-directory resource such as a robot.

    name: name of the lock file; what: name of the resource in messages. Raises `StictionError` where another process
    holds it.
    """
    folder = Path(tempfile.gettempdir()) / f"stiction-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        # In a folder where everybody may write, another user may have made it first.
        if folder.is_symlink() or folder.stat().st_uid != os.getuid():
            raise FileError(
                f"{folder} belongs to another user, so its locks cannot be used; set TMPDIR to a folder of yours"
            )
    except OSError as error:
        raise FileError(f"{folder} cannot be made: {error.strerror}; set TMPDIR to a writable folder") from error
    file = folder / f"{re.sub('[^A-Za-z0-9_.-]', '-', name)[:100]}{LOCK}"
    with _locked(file, Path(what), "robot, or end that process"):
        yield


@contextmanager
def _locked(file: Path, folder: Path, option: str) -> Iterator[None]:
    """Hold the lock of a file; one process may hold it several times."""
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
    """Lock a file and write its holder into it; return its descriptor."""
    while True:
        try:
            number = os.open(file, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise FileError(f"{folder} cannot be written: {error.strerror}; choose another {option}") from error
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Between opening and locking its holder may have removed it, and another process made it anew: a lock on a
            # file without a name keeps nobody out.
            current = file.stat()
            if (current.st_dev, current.st_ino) == (os.fstat(number).st_dev, os.fstat(number).st_ino):
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
                f"{folder} cannot be locked: {error.strerror}; choose an {option} on a file system with locks"
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
