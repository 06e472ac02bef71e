"""Disks that are full, or may only be read, while something inside runs."""

from __future__ import annotations

import ctypes
import os
import resource
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


@contextmanager
def full(bytes_left: int) -> Iterator[None]:
    """Let no file grow beyond a size: what the system then says of a file is what it says of a full disk."""
    # What Python compiles now would be cut off too, and be found so by the next process.
    patch = pytest.MonkeyPatch()
    patch.setattr(sys, "dont_write_bytecode", True)
    patch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (bytes_left, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        patch.undo()


@contextmanager
def read_only(folder: Path) -> Iterator[None]:
    """Take the right to write a folder, and all in it, away; from root too, whom the kernel asks for no right."""
    places = [folder, *(path for path in folder.rglob("*") if path.is_dir())]
    modes = [path.stat().st_mode for path in places]
    for path in places:
        path.chmod(0o555)
    with no_override():
        try:
            if os.access(folder, os.W_OK, effective_ids=True):
                pytest.skip("this user may write everything")
            yield
        finally:
            for path, mode in zip(places, modes, strict=True):
                path.chmod(mode)


@contextmanager
def no_override() -> Iterator[None]:
    """Put the capability of root to write everywhere aside."""
    libc = ctypes.CDLL(None, use_errno=True)
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)
    before, now = (ctypes.c_uint32 * 6)(), (ctypes.c_uint32 * 6)()
    if not hasattr(libc, "capget") or libc.capget(header, before):
        yield
        return
    now[:] = before[:]
    now[0] &= ~0b110  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
    libc.capset(header, now)
    try:
        yield
    finally:
        libc.capset(header, before)
