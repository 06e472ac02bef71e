"""How much memory a file may cost: counted before it is taken, and held by the system where the system can.

What a reader makes of a file is checked against `allowance`, in bytes that will be allocated and not in bytes of the
file. Whatever escapes that count meets the limit of the process's address space, and ends in one line all the same.
"""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from stiction.core.errors import FileError, StictionError

DEFAULT_LIMIT = 2**31
"""Bytes beyond what the program itself takes: an hour of twelve joints at 1 kHz, and room to work on it."""

SHARES = 4
"""A table may take one share: reading needs a second for a moment, and the estimators copy."""

LARGEST_RATIO, HARMLESS = 200, 2**24
"""Nothing that was measured shrinks to less than one in two hundred; below 16 MiB [B] nobody is harmed."""

_limit: ContextVar[int] = ContextVar("memory limit", default=DEFAULT_LIMIT)


def allowance() -> int:
    """Return how many bytes a table read from a file may take."""
    return _limit.get() // SHARES


def claim(source: str, size: int, what: str, error: type[FileError]) -> None:
    """Raise `error` where `size` bytes would be more than a table may take; `source` and `what` are named."""
    if size > allowance():
        raise error(
            f"{source}: {what} {size} bytes; at most {allowance()} are read: cut it into parts, or allow more "
            "(--memory-limit)"
        )


def check_ratio(source: str, packed: int, inflated: int, error: type[FileError]) -> None:
    """Raise `error` where so few bytes inflate to so many that nothing measured can be in them."""
    if inflated > max(HARMLESS, LARGEST_RATIO * packed):
        raise error(f"{source}: {packed} bytes would inflate to {inflated} or more; no log shrinks that far")


@contextmanager
def limit_memory(size: int) -> Iterator[None]:
    """Hold what runs inside to `size` bytes more than the process has now; want of memory becomes `StictionError`.

    Where the system tells no size (macOS) only `allowance` holds. A stricter limit of the caller's (`ulimit -v`) stays.
    """
    token = _limit.set(size)
    try:
        with _held(size):
            yield
    except MemoryError:
        raise StictionError(_sentence(size)) from None
    except OSError as error:
        if error.errno != errno.ENOMEM:
            raise
        raise StictionError(_sentence(size)) from None
    finally:
        _limit.reset(token)


def _sentence(size: int) -> str:
    """Return what to say where the memory was not enough."""
    return f"not enough memory: this takes more than {size / 2**30:.3g} GiB; cut the log, or raise --memory-limit"


@contextmanager
def _held(size: int) -> Iterator[None]:
    """Let the address space grow by `size` bytes and no more, where the system can say how large it is."""
    pages = Path("/proc/self/statm")
    if not pages.exists():
        yield
        return
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    wanted = int(pages.read_text().split()[0]) * resource.getpagesize() + size
    limits = [limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_AS, (min(wanted, *limits) if limits else wanted, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
