"""Child processes that do not import modules from the working folder in place of Python's.

`python -m` and `python -c` put the working folder first on the path: a `json.py` in a downloaded folder would run. `-P`
and PYTHONSAFEPATH leave it out; an empty entry of PYTHONPATH, which means the same folder, is removed too.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from stiction.core.provenance import PACKAGE

INSTALLED = ("site-packages", "dist-packages")
"""Folders that Python searches by default."""

_MAIN_HIDDEN = threading.Lock()
"""Lock held while the main module is replaced, for another thread may start workers at the same time."""


def python_module(module: str, words: Iterable[object] = ()) -> list[str]:
    """Return the command that runs a module with these words in a new Python; start it with `isolated_environment`."""
    return [sys.executable, "-P", "-m", module, *map(str, words)]


def run_isolated(
    module: str, patience: float, words: Iterable[object] = (), content: bytes = b""
) -> subprocess.CompletedProcess[bytes]:
    """Run a module in a new Python, on one thread, and return its output; content: its standard input.

    Raises `subprocess.TimeoutExpired` after `patience` seconds, and `OSError` where no process can be started.
    """
    return subprocess.run(
        python_module(module, words),
        input=content,
        env=isolated_environment(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1"),
        capture_output=True,
        timeout=patience,
        check=False,
    )


def bare_python(program: str) -> list[str]:
    """Return the command that runs a program text in a Python without site packages and working folder."""
    return [sys.executable, "-I", "-S", "-c", program]


def isolated_environment(**more: str) -> dict[str, str]:
    """Return this process's environment, and `more`, for a Python that finds this package but not the working folder.

    Relative entries of PYTHONPATH are made absolute: the user named these folders.
    """
    environment = {**os.environ, **more, "PYTHONSAFEPATH": "1"}
    path = _folders(environment)
    if PACKAGE.parent.name not in INSTALLED and str(PACKAGE.parent) not in path:
        path.insert(0, str(PACKAGE.parent))
    environment.pop("PYTHONPATH", None)
    return environment | ({"PYTHONPATH": os.pathsep.join(path)} if path else {})


def isolate_workers() -> None:
    """Make workers that multiprocessing spawns from this process start without the working folder.

    Python then sets their path to this process's, before they import anything of the package.
    """
    os.environ["PYTHONSAFEPATH"] = "1"
    if "PYTHONPATH" in os.environ:
        os.environ["PYTHONPATH"] = os.pathsep.join(_folders(os.environ))


@contextmanager
def hidden_main() -> Iterator[None]:
    """Let multiprocessing spawn workers without running this program's main module again.

    By default workers import it, to find what it defines; a script that starts work at module level would start it
    again in each worker, and Python refuses.
    """
    # The preparation of a spawned process looks at `sys.modules["__main__"]`: an empty module has no file to run.
    with _MAIN_HIDDEN:
        main, sys.modules["__main__"] = sys.modules["__main__"], ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = main


def _folders(environment: Mapping[str, str]) -> list[str]:
    return [str(Path(entry).absolute()) for entry in environment.get("PYTHONPATH", "").split(os.pathsep) if entry]
