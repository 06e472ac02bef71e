"""How a file or folder is written: under another name, synced, and renamed; whole under its name, or not there."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from stiction.core.errors import UnwrittenError


@contextmanager
def publish(path: Path) -> Iterator[Path]:
    """Yield a path beside `path` to write a file or a folder to, which then replaces `path` atomically.

    Where the writing fails, `path` stays as it was. A link in its place is replaced, not followed: a folder from others
    may hold one. Raises `UnwrittenError`, with what the system said, where something cannot be written, or what it is
    made from cannot be read.
    """
    name = path.name if len(os.fsencode(path.name)) <= LONGEST else path.name[: LONGEST // 4]
    partial, before = (path.with_name(f".{name}.{os.getpid()}.{kind}") for kind in ("part", "before"))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield partial
        for written in (partial, *partial.rglob("*")):
            _sync(written)
        if path.is_dir():
            # A folder that is not empty cannot be renamed over, and half of one may not stay under its name.
            path.rename(before)
        partial.replace(path)
        _sync(path.parent)
    except OSError as error:
        raise unwritten(path, error, partial) from error
    finally:
        for left in (partial, before):
            if left.is_dir():
                shutil.rmtree(left, ignore_errors=True)
            else:
                left.unlink(missing_ok=True)


LONGEST = 200
"""Bytes of a name that leave room, of the 255 that a file system allows, for what the one beside it has more."""


def unwritten(path: Path, error: OSError, partial: Path | None = None) -> UnwrittenError:
    """Return the error for a file that cannot be written; partial: the path that it was written to."""
    said = error.strerror or str(error)
    name = str(error.filename or "")
    if name and name != str(path) and (partial is None or not name.startswith(str(partial))):
        said = f"{name}: {said}"
    return UnwrittenError(f"{path} cannot be written: {said}; choose another --out, or make room")


def write_text(path: Path, text: str) -> None:
    """Write a text, whole or not at all. Raises `UnwrittenError` as `publish`."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file, whole or not at all. Raises `UnwrittenError` as `publish`."""
    if path.exists() and not path.is_file() and not path.is_dir():
        # A device, such as /dev/stdout, is nothing to rename over.
        try:
            path.write_bytes(content)
        except OSError as error:
            raise unwritten(path, error) from error
        return
    with published(path) as file:
        file.write(content)


@contextmanager
def published(path: Path) -> Iterator[BinaryIO]:
    """Yield a file to write bytes to, which then replaces `path`. Raises `UnwrittenError` as `publish`."""
    with publish(path) as partial, partial.open("wb") as file:
        yield file


def _sync(path: Path) -> None:
    """Bring a file, or the names in a folder, to the disk."""
    number = os.open(path, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)
