"""How much memory work and files may cost: counted before it is taken, and held by the system where the system can.

Work that will not fit is refused in a line (`check_memory`), and not killed by the system. What a reader makes of a
file is checked against `allowance`, in bytes that will be allocated and not in bytes of the file. Whatever escapes that
count meets the limit of the process's address space, and ends in one line all the same.
"""

from __future__ import annotations

import errno
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from stiction.core.errors import ConfigurationError, FileError, StictionError

DEFAULT_LIMIT = 2**31
"""Bytes beyond what the program itself takes: an hour of twelve joints at 1 kHz, and room to work on it."""

SHARES = 4
"""A table may take one share: reading needs a second for a moment, and the estimators copy."""

LARGEST_RATIO, HARMLESS = 200, 2**24
"""Nothing that was measured shrinks to less than one in two hundred; below 16 MiB [B] nobody is harmed."""

MEMINFO = Path("/proc/meminfo")
"""Linux: what there is."""

GROUP = Path("/sys/fs/cgroup")
"""Linux: what a container may use."""

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
    """Raise `error` where data inflate by a factor that no measurement compresses by."""
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
    except (MemoryError, OSError) as error:
        if isinstance(error, OSError) and error.errno != errno.ENOMEM:
            raise
        raise StictionError(
            f"not enough memory: this takes more than {size / 2**30:.3g} GiB; cut the log, or raise --memory-limit"
        ) from None
    finally:
        _limit.reset(token)


def address_space() -> int | None:
    """Return the address space that this process has [B]; None where the system does not say (macOS)."""
    pages = Path("/proc/self/statm")
    return int(pages.read_text().split()[0]) * resource.getpagesize() if pages.exists() else None


def bound(kind: int, most: int) -> None:
    """Bound a resource of this process, such as `resource.RLIMIT_CPU`, for good.

    Never above what it had, and the hard limit too: nothing in this process can raise it again.
    """
    _, hard = resource.getrlimit(kind)
    least = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(kind, (least, least))


@contextmanager
def _held(size: int) -> Iterator[None]:
    """Let the address space grow by `size` bytes and no more, where the system can say how large it is."""
    taken = address_space()
    if taken is None:
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    wanted = taken + size
    limits = [limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_AS, (min(wanted, *limits) if limits else wanted, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def free_memory() -> int:
    """Return the memory that this process may still take [B]: of the machine, of its container, of its own limit."""
    found = [_of_machine(), _of_group()]
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY:
        found.append(max(0, limit - (address_space() or 0)))
    return min(one for one in found if one is not None)


def _of_machine() -> int:
    """Return what the machine has free; all that it has, where it does not say."""
    try:
        lines = dict(line.split(":", 1) for line in MEMINFO.read_text().splitlines())
        return 1024 * int(lines["MemAvailable"].split()[0])
    except (OSError, ValueError, KeyError):
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def _of_group() -> int | None:
    """Return what the container has left; None where there is no limit."""
    try:
        most, used = ((GROUP / f"memory.{name}").read_text().strip() for name in ("max", "current"))
        # Without a limit `memory.max` holds a word, `max`, which is no number.
        return max(0, int(most) - int(used))
    except (OSError, ValueError):
        return None


def check_memory(needed: float, what: str, remedy: str) -> None:
    """Raise `StictionError` where some work needs more memory than there is.

    needed: [B]; what: it is for; remedy: what to ask for in its place.
    """
    if needed > (free := free_memory()):
        raise ConfigurationError(
            f"{what} takes some {needed / 1e9:.1f} GB of memory and {free / 1e9:.1f} GB are free; {remedy}"
        )
