"""The folder that a command's results go to."""

from __future__ import annotations

from pathlib import Path

from stiction.formats.errors import StictionError


def make_folder(out: Path, option: str = "--out") -> None:
    """Make the directory for results, before the work that fills it. `option`: which names it.

    Raises:
        StictionError: it cannot be made.

    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StictionError(f"the directory {out} cannot be made: {error}; choose another {option}") from error
