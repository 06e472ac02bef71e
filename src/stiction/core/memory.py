"""Memory that is computed before it is taken: what will not fit is refused in a line, and not killed by the system."""

from __future__ import annotations

import os
import resource
from pathlib import Path

from stiction.core.errors import ConfigurationError

MEMINFO = Path("/proc/meminfo")
"""Linux: what there is."""

GROUP = Path("/sys/fs/cgroup")
"""Linux: what a container may use."""


def free_memory() -> int:
    """Return the memory that this process may still take [B]: of the machine, of its container, of its own limit."""
    found = [_of_machine(), _of_group()]
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY:
        found.append(limit)
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
