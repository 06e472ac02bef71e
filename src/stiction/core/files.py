"""Atomic writing of files, and bounded reading of files from others, pipes refused.

Files are written under a temporary name, synced and renamed.
"""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import BufferedReader, TextIOWrapper
from itertools import islice
from pathlib import Path
from typing import BinaryIO, TextIO

from stiction.core.errors import ConfigurationError, StictionError, UnwrittenError, nearest

MOST_SIBLINGS = 1000
"""Maximum number of files in a folder that are compared for the nearest name."""


@contextmanager
def publish(path: Path) -> Iterator[Path]:
    """Yield a temporary path next to `path` to write a file or a folder to, which then replaces `path` atomically.

    On failure `path` stays unchanged. A link in its place is replaced, not followed: a folder from others may hold one.
    Raises `UnwrittenError`, with the system's message, where something cannot be written, or an input cannot be read.
    """
    # In the same folder, since only within one file system is a rename atomic; with the number of the process, since
    # two may write at once.
    name = path.name if len(os.fsencode(path.name)) <= LONGEST else path.name[: LONGEST // 4]
    partial, before = (path.with_name(f".{name}.{os.getpid()}.{kind}") for kind in ("part", "before"))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield partial
        # Before the rename: else a power cut could leave the new name with an empty file behind it.
        for written in (partial, *partial.rglob("*")):
            _sync(written)
        if path.is_dir() and not partial.is_dir() and not path.is_symlink():
            # All that is in it would go for one file.
            raise IsADirectoryError(errno.EISDIR, "is a folder; expected a file", str(path))
        if path.is_dir():
            # A folder that is not empty cannot be renamed over, and half of one may not stay under its name.
            path.rename(before)
        partial.replace(path)
        # The rename itself is on the disk only when the folder is.
        _sync(path.parent)
    except OSError as error:
        raise unwritten(path, error, partial) from error
    finally:
        # Stopped between the two renames: what was there comes back.
        if not os.path.lexists(path):
            with suppress(OSError):
                before.rename(path)
        for left in (partial, before):
            if left.is_dir():
                shutil.rmtree(left, ignore_errors=True)
            else:
                with suppress(OSError):
                    left.unlink()


LONGEST = 200
"""Maximum length of a name [B]: leaves room, of the 255 of a file system, for the suffix of the temporary file."""


def unwritten(path: Path, error: OSError, partial: Path | None = None) -> UnwrittenError:
    """Return the error for a file that cannot be written; partial: its temporary path."""
    cause = error.strerror or str(error)
    name = str(error.filename or "")
    if name and name != str(path) and (partial is None or not name.startswith(str(partial))):
        cause = f"{name}: {cause}"
    return UnwrittenError(f"{path} cannot be written: {cause}; choose another --out, or make room")


def write_text(path: Path, text: str) -> None:
    """Write a text atomically. Raises `UnwrittenError` as `publish`."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically. Raises `UnwrittenError` as `publish`."""
    if path.exists() and not path.is_file() and not path.is_dir():
        # A device, such as /dev/stdout, is nothing to rename over; a pipe that nobody reads must not be waited for.
        try:
            number = os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_CLOEXEC)
            os.set_blocking(number, True)
            with os.fdopen(number, "wb") as file:
                file.write(content)
        except OSError as error:
            raise unwritten(path, error) from error
        return
    with published(path) as whole:
        whole.write(content)


@contextmanager
def published(path: Path) -> Iterator[BinaryIO]:
    """Yield a binary file to write, which then replaces `path`. Raises `UnwrittenError` as `publish`."""
    with publish(path) as partial, partial.open("wb") as file:
        yield file


def keep_inputs(out: Path, *inputs: Path) -> None:
    """Raise `ConfigurationError` where an output would overwrite one of its inputs, also through another name of it."""
    for source in inputs:
        if source.exists() and (out.resolve() == source.resolve() or (out.exists() and out.samefile(source))):
            named = "" if out == source else f" as {out}"
            raise ConfigurationError(f"{source} is an input and would be overwritten{named}; choose another --out")


def open_regular(path: Path) -> BufferedReader:
    """Open a file to read bytes. Raises `OSError`, also for a pipe or device, which may never end."""
    # Without O_NONBLOCK, to open a pipe would wait for its writer. The kind is asked of what is open: under the name
    # there could be another file by now.
    number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    mode = os.fstat(number).st_mode
    if stat.S_ISREG(mode):
        return os.fdopen(number, "rb")
    os.close(number)
    code = errno.EISDIR if stat.S_ISDIR(mode) else errno.EINVAL
    raise OSError(
        code, os.strerror(code) if stat.S_ISDIR(mode) else "is a pipe or a device; expected a file", str(path)
    )


def open_text(path: Path) -> TextIO:
    """Open a UTF-8 file to read lines unchanged, for `csv`. Raises `OSError` as `open_regular`."""
    return TextIOWrapper(open_regular(path), encoding="utf-8", newline="")


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file. Raises `OSError` as `open_regular`."""
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_bounded(path: Path, expected: str, error: type[StictionError], most: int) -> bytes:
    """Return the content of a file of at most `most` bytes; raise `error`, naming what was `expected`, otherwise."""
    try:
        with open_regular(path) as file:
            # Read and not asked for its size: a file may grow meanwhile. One byte too many says that it is too large.
            content = file.read(most + 1)
    except OSError as fault:
        raise error(unreadable(path, fault, expected)) from fault
    if len(content) > most:
        raise error(f"{path.name}: over {most} bytes; expected {expected}")
    return content


def unreadable(path: Path, fault: OSError, expected: str) -> str:
    """Return the message for an unreadable file: the cause, the nearest name of a missing one, what was expected."""
    return f"cannot read {path}: {fault.strerror or fault}{near_file(path) or ';'} expected {expected}"


def near_file(path: Path) -> str:
    """Return `; did you mean 'swing.csv'?` with the nearest name in the folder of a missing file."""
    try:
        siblings = [] if path.exists() else [*islice(path.parent.iterdir(), MOST_SIBLINGS)]
    except OSError:
        siblings = []
    # By what stands before the dot too: two names of a letter are no nearer for both ending in .json.
    near = [entry.name for entry in siblings if nearest(path.stem, [entry.stem])]
    return nearest(path.name, near)


def _sync(path: Path) -> None:
    number = os.open(path, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)
