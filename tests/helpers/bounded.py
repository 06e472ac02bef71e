"""Readers under attack: bounded in time and memory, an answer or one line, and nothing else."""

from __future__ import annotations

import resource
import signal
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

from stiction.core.errors import StictionError


class TooSlowError(BaseException):
    """Raised by the alarm; no reader's `except` catches it."""


def _alarm(number: int, frame: FrameType | None) -> None:
    raise TooSlowError


def bounded(act: Callable[[], Any], longest: float) -> tuple[Any, str | None]:
    """Return what an act returns, None where it refused, and what must not happen, or None; longest [s]."""
    signal.signal(signal.SIGALRM, _alarm)
    signal.setitimer(signal.ITIMER_REAL, longest)
    try:
        return act(), None
    except StictionError as error:
        line = str(error)
        return None, None if line and "\n" not in line and len(line) < 2000 else f"no line: {error!r}"[:300]
    except TooSlowError:
        return None, "too slow"
    except BaseException as error:
        return None, f"{type(error).__name__}: {error}"[:300]
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def limit_address_space(more: int) -> None:
    """Bound this process to what it has and `more` bytes, where the system tells what it has."""
    if Path("/proc/self/statm").exists():
        limit = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() + more
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def peak_memory() -> int:
    """Return the most memory that this process has had [B]."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def read_here() -> None:
    """Have formats that are read in a process of their own read in this one, for the rest of its life."""
    from stiction.identification.logs import apart

    apart.read_apart = lambda path, options: apart.readers()[path.suffix.lower()](path, **options)
