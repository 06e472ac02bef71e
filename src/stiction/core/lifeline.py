"""Child processes that end with their parent, even when it is killed.

The parent alone holds the write end of a pipe; the child reads it, and end of file means that the parent ended. On
Linux the kernel signals it too, which also reaches a child that is deep in a library.
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
"""Environment variable that tells a child that its standard input is such a pipe."""

PR_SET_PDEATHSIG = 1
"""Linux: the signal that a process gets when the thread that started it ends, see prctl(2)."""


@cache
def _pipe() -> tuple[int, int]:
    """Return read and write end of this process's pipe. Neither is inherited except as a child's standard input."""
    return os.pipe()


def tied(environment: Mapping[str, str]) -> dict[str, Any]:
    """Return the arguments of `Popen` that tie a child to this process; the child calls `follow_parent`."""
    return {"env": {**environment, VARIABLE: "0"}, "stdin": _pipe()[0]}


def follow_parent(ending: signal.Signals = signal.SIGKILL) -> None:
    """End by a signal when the parent ends, if it was started with `tied`; for SIGKILL through the kernel too."""
    if os.environ.pop(VARIABLE, None) is not None:
        watch(sys.__stdin__.fileno() if sys.__stdin__ else 0, ending)


def parent_pipe() -> int:
    """Return the file that becomes readable when the parent ends, for a child that has to finish something first.

    The child was started with `tied` and does not call `follow_parent`.
    """
    del os.environ[VARIABLE]
    return sys.__stdin__.fileno() if sys.__stdin__ else 0


def watch(read_end: int, ending: signal.Signals = signal.SIGKILL) -> None:
    """Send this process a signal once the other end of a pipe is closed, by the last process that had it.

    read_end: its file descriptor, which stays open. A signal that can be handled is sent once, from the pipe only:
    otherwise it would count as a user's second request to stop.
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
