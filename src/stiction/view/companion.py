"""A viewer beside a training: a process of its own that shows the newest checkpoint and ends with the training."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from stiction.core.isolation import isolated_environment, python_module
from stiction.core.lifeline import tied

GRACE = 10.0
"""Longest time that the viewer may take to end [s]."""


@contextmanager
def watching(run: Path, say: Callable[[str], None]) -> Iterator[subprocess.Popen]:
    """Show a run while it trains; whatever becomes of the viewer, the training goes on.

    run: its directory, with a config.json; say: prints a line, called from a thread of its own.
    """
    process = subprocess.Popen(
        python_module("stiction", ("view", run, "--follow")),
        **tied(isolated_environment(STICTION_THREADS="1", OMP_NUM_THREADS="1")),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,  # Ctrl-C is for the training
    )

    def listen() -> None:
        assert process.stdout is not None
        for line in process.stdout:
            if line.strip():
                # Ctrl-C in this terminal ends the training, not the viewer.
                say(line.strip().removesuffix("; Ctrl-C ends it"))

    thread = threading.Thread(target=listen, name="viewer's words", daemon=True)
    thread.start()
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(GRACE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        thread.join(GRACE)
