"""`metrics.jsonl` of a training run: one JSON object a line, one line an iteration."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def read_metrics(path: Path) -> list[dict[str, Any]]:
    """Return the figures of every iteration, in order; empty without the file.

    A run that is killed may leave its last line cut off: what follows the last whole line does not count.
    """
    if not path.exists():
        return []
    rows = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            rows.append(json.loads(line))
        except ValueError:
            break
    return rows
