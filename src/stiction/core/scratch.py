"""Temporary folders that are removed however the process ends."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

REMOVE = 'read -r _; rm -rf -- "$1"'
"""Shell program that waits for the end of its input, hence of its parent, and removes a folder."""


@contextmanager
def scratch() -> Iterator[Path]:
    """Yield an empty temporary folder, removed afterwards; by a separate shell where this process is killed.

    Raises `OSError` where no folder can be made.
    """
    folder, quiet = Path(tempfile.mkdtemp(prefix="stiction-")), subprocess.DEVNULL
    # In a session of its own: Ctrl-C must not reach it before its parent is done with the folder.
    keeper = subprocess.Popen(
        ["/bin/sh", "-c", REMOVE, "stiction", str(folder)],
        stdin=subprocess.PIPE,
        stdout=quiet,
        stderr=quiet,
        start_new_session=True,
    )
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        # Its input is closed, at which it ends, and it is waited for.
        with keeper:
            pass
