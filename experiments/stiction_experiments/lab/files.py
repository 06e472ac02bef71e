"""Files that studies alone write and read: cached parts, and their parts of the advice."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from stiction.core.cache import DIGEST, read_sealed, sealed
from stiction.core.files import write_text
from stiction.files.advice import SCHEMA_VERSION, Source, read_advice


def entry_file(folder: Path, name: str, key: str, suffix: str) -> Path:
    """Return the file of an entry: a readable `name` and the first twelve digits of its key."""
    return folder / f"{name}-{key[:12]}{suffix}"


def cached(folder: Path, name: str, key: str, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return the entry of a key from its JSON file (see `entry_file`), written from `make` where there is none.

    Raises `FileError` where the file cannot be written; and whatever `make` raises.
    """
    file = entry_file(folder, name, key, ".json")
    entry = read_sealed(file)
    if entry is not None:
        return entry
    text = json.dumps(sealed(make()), allow_nan=False)
    write_text(file, text)
    # What was written and not what was made: tuples are lists, and keys text, the first time as ever after.
    return {name: value for name, value in json.loads(text).items() if name != DIGEST}


def write_source(path: Path, name: str, source: Source) -> None:
    """Put one study's part into the file, which need not exist; the others stay.

    Raises `StictionError`: the file is another one, or cannot be written.
    """
    sources = (read_advice(path) if path.exists() else {}) | {name: source}
    plain = {key: asdict(one) for key, one in sorted(sources.items())}
    text = json.dumps({"schema_version": SCHEMA_VERSION, "sources": plain}, indent=1, allow_nan=False)
    write_text(path, text + "\n")
