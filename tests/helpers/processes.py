"""Processes that tests start, watch and kill."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

ORPHAN_SECONDS = 5.0
"""Longest that a process may outlive its parent [s]."""


def is_alive(pid: int) -> bool:
    """Return True if a process runs; a zombie does not."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        return state != "Z"
    except FileNotFoundError:
        if Path("/proc/self").exists():
            return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def wait_until(is_so: Callable[[], bool], otherwise: str, seconds: float = 2 * ORPHAN_SECONDS) -> None:
    """Wait until something is so; fail with what is the case otherwise."""
    deadline = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < deadline, otherwise
        time.sleep(0.02)


def stiction(*words: str) -> list[str]:
    """The command line of the program."""
    return [sys.executable, "-m", "stiction", *words]


def python(script: str, *words: str, folder: Path | None = None) -> subprocess.Popen[str]:
    """A process that runs a script, with its output as pipes."""
    pipe = subprocess.PIPE
    return subprocess.Popen([sys.executable, "-c", script, *words], stdout=pipe, stderr=pipe, text=True, cwd=folder)


def outcome(script: str, *words: object) -> dict[str, Any]:
    """Return the JSON that a helper, run as a program with one thread, prints; its memory is its own."""
    one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "STICTION_THREADS"), "1")
    path = os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)])
    command = [sys.executable, str(Path(__file__).with_name(script)), *map(str, words)]
    env = os.environ | one | {"PYTHONPATH": path}
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=1800, check=False)
    assert done.returncode == 0, f"{words}: {done.returncode} {done.stderr[-2000:]}"
    return json.loads(done.stdout)
