"""How much is done at once: what `--jobs` says, the same in every verb that has it."""

from __future__ import annotations

from stiction.formats.errors import StictionError
from stiction.formats.reproducibility import num_threads


def jobs_of(asked: int | None) -> int:
    """Return how many tasks are done at once; by default as many as there are cores (STICTION_THREADS).

    Raises `StictionError` where less than one is asked for.
    """
    if asked is not None and asked < 1:
        raise StictionError(f"--jobs {asked}: expected at least 1")
    return asked or num_threads()
