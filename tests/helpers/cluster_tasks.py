"""Tasks for a cluster's nodes, which import them by name."""

from __future__ import annotations

import time
from pathlib import Path
from uuid import uuid4

from stiction.core.errors import StictionError


def square(number: int, folder: str) -> int:
    """Note that the task was begun; return the square of a number."""
    (Path(folder) / f"{number}-begun-{uuid4().hex}").touch()
    time.sleep(0.3)
    return number**2


def refuse(number: int) -> None:
    """Note that it was called, in the present folder, and raise."""
    with Path(f"refused-{number}").open("a") as file:
        file.write("x")
    raise StictionError(f"no walk of {number}")
