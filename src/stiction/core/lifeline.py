"""A process ends with the one that started it, whatever ended that: a signal, kill -9, or a fault.

The parent holds the write end of a pipe and nobody else does; the child reads it, and its end of file says that the
parent is gone. On Linux the kernel tells it too, which also reaches a child that is deep in a library.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Mapping
from functools import cache
from typing import Any

VARIABLE = "STICTION_LIFELINE"
"""Environment variable by which a child knows that its standard input is such a pipe."""

PR_SET_PDEATHSIG = 1
"""Linux: the signal that a process gets when the thread that started it ends, see prctl(2)."""


@cache
def _pipe() -> tuple[int, int]:
    """Return read and write end of this process's pipe. Neither is inherited but as a child's standard input."""
    return os.pipe()


def tied(environment: Mapping[str, str]) -> dict[str, Any]:
    """Return the arguments of `Popen` that tie a child to this process; the child calls `follow_parent`."""
    return {"env": {**environment, VARIABLE: "0"}, "stdin": _pipe()[0]}


def follow_parent(ending: signal.Signals = signal.SIGKILL) -> None:
    """End by a signal when the parent does, if it said that it wants so; with SIGKILL by the kernel's word too."""
    if os.environ.pop(VARIABLE, None) is not None:
        watch(sys.__stdin__.fileno() if sys.__stdin__ else 0, ending)


def parents_file() -> int:
    """Return the file that is readable once the parent is gone, of a child that has something to do before it ends.

    The child was started with `tied` and does not call `follow_parent`.
    """
    del os.environ[VARIABLE]
    return sys.__stdin__.fileno() if sys.__stdin__ else 0


def watch(read_end: int, ending: signal.Signals = signal.SIGKILL) -> None:
    """Send this process a signal once the other end of a pipe is closed, by the last process that had it.

    read_end: its file descriptor, which stays open. A signal that can be handled comes once, from the pipe: the second
    one of a person who asks to stop does not wait.
    """
    # The kernel says nothing of a parent that ended before this line; the pipe does.
    if sys.platform == "linux" and ending == signal.SIGKILL:
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, int(ending))

    def wait() -> None:
        try:
            while os.read(read_end, 1):
                pass
        except OSError:
            pass
        os.kill(os.getpid(), ending)

    threading.Thread(target=wait, name="lifeline", daemon=True).start()
