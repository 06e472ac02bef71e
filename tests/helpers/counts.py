"""How much a statistical test takes: enough for every day, or with STICTION_FULL=1 what the results were held to."""

from __future__ import annotations

import os


def count(few: int, full: int) -> int:
    """Return how many logs, files or attacks."""
    return full if os.environ.get("STICTION_FULL") == "1" else few
