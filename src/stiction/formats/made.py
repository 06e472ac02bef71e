"""`made.json`: comes last into a folder, and says what the folder was made from; what has changed is made again."""

from __future__ import annotations

import json
from pathlib import Path

MADE = "made.json"
"""Name of the file."""


def is_made(folder: Path, key: str) -> bool:
    """Say whether a folder is whole and was made from what `key` stands for."""
    try:
        made = json.loads((folder / MADE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(made, dict) and made.get("key") == key


def mark_made(folder: Path, label: str, key: str) -> None:
    """Say that a folder is whole. label: what is in it, for people; key: what it was made from. May raise `OSError`."""
    (folder / MADE).write_text(json.dumps({"label": label, "key": key}) + "\n", encoding="utf-8")
