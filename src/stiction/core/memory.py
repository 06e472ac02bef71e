"""Memory limits of work and files: estimated before allocation, and enforced by the system where it can.

Work that will not fit is refused in one line (`check_memory`), before the system kills it. The size of what a reader
makes of a file is checked against `allowance`, in bytes that will be allocated and not in bytes of the file. Anything
not counted meets the limit of the process's address space, and also ends in one line.
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
"""Default limit, beyond the program itself [B]: an hour of twelve joints at 1 kHz, and room to work on it."""

SHARES = 4
"""Number of shares, one a table: reading needs a second for a moment, and the estimators copy."""

LARGEST_RATIO, HARMLESS = 200, 2**24
"""Largest compression ratio of a measured log, and the inflated size below which it is not checked [B]."""

MEMINFO = Path("/proc/meminfo")
"""Path of Linux memory statistics."""

GROUP = Path("/sys/fs/cgroup")
"""Path of the memory limit of a Linux container."""

_limit: ContextVar[int] = ContextVar("memory limit", default=DEFAULT_LIMIT)


def allowance() -> int:
    """Return the maximum size of a table read from a file [B]."""
    return _limit.get() // SHARES


def claim(source: str, size: int, what: str, error: type[FileError]) -> None:
    """Raise `error`, naming `source` and `what`, where `size` bytes exceed the maximum of a table."""
    if size > allowance():
        raise error(
            f"{source}: {what} {size} bytes; at most {allowance()} are read: cut it into parts, or allow more "
            "(--memory-limit)"
        )


def check_ratio(source: str, packed: int, inflated: int, error: type[FileError]) -> None:
    """Raise `error` for a compression ratio that no measured log has."""
    if inflated > max(HARMLESS, LARGEST_RATIO * packed):
        raise error(f"{source}: {packed} bytes inflate to {inflated} or more, which no log does")


@contextmanager
def limit_memory(size: int) -> Iterator[None]:
    """Limit the address space to `size` bytes more than now; lack of memory becomes `StictionError`.

    On a system that does not report the size (macOS) only `allowance` holds. A stricter limit of the caller (`ulimit
    -v`) stays.
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
    """Return the address space of this process [B]; None where the system does not report it (macOS)."""
    pages = Path("/proc/self/statm")
    return int(pages.read_text().split()[0]) * resource.getpagesize() if pages.exists() else None


def bound(kind: int, most: int) -> None:
    """Lower the hard limit of a resource of this process, such as `resource.RLIMIT_CPU`.

    Never above the present limit; nothing in this process can raise it again.
    """
    _, hard = resource.getrlimit(kind)
    least = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(kind, (least, least))


@contextmanager
def _held(size: int) -> Iterator[None]:
    """Let the address space grow by at most `size` bytes, where the system reports its size."""
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
    """Return the memory that this process may still allocate [B]: of the machine, its container, its limit."""
    limits = [_of_machine(), _of_group()]
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY:
        limits.append(max(0, limit - (address_space() or 0)))
    return min(amount for amount in limits if amount is not None)


def _of_machine() -> int:
    """Return the free memory of the machine; its total memory where free memory is not reported."""
    try:
        lines = dict(line.split(":", 1) for line in MEMINFO.read_text().splitlines())
        return 1024 * int(lines["MemAvailable"].split()[0])
    except (OSError, ValueError, KeyError):
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def _of_group() -> int | None:
    """Return the memory left to the container; None without a limit."""
    try:
        most, used = ((GROUP / f"memory.{name}").read_text().strip() for name in ("max", "current"))
        # Without a limit `memory.max` holds a word, `max`, which is no number.
        return max(0, int(most) - int(used))
    except (OSError, ValueError):
        return None


def check_memory(needed: float, what: str, remedy: str) -> None:
    """Raise `StictionError` where work needs more memory than is free.

    needed: [B]; what: name of the work; remedy: what to do.
    """
    if needed > (free := free_memory()):
        raise ConfigurationError(
            f"{what} needs about {needed / 1e9:.1f} GB of memory, {free / 1e9:.1f} GB are free; {remedy}"
        )
