"""JSON of the files that pass between verbs: of a bounded size, and refused in one line that names file and field."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from stiction.core.errors import FileError
from stiction.core.files import read_bounded, write_text

LARGEST_TEXT = 2**26
"""Bytes of JSON that are read."""


def read_object(
    path: Path, expected: str, error: type[FileError] = FileError, most: int = LARGEST_TEXT
) -> dict[str, Any]:
    """Return the JSON object in a file.

    path: the file; expected: what should be there, for messages; error: raised where the file cannot be read, is too
    large, or holds no JSON object; most: its largest size [B].
    """
    return parse_object(read_bounded(path, expected, error, most), path.name, expected, error)


def parse_object(content: bytes | str, where: str, expected: str, error: type[FileError] = FileError) -> dict[str, Any]:
    """Return a JSON object from text; `where` is named in messages. Raises `error` as `read_object` does."""
    try:
        text = content.decode("utf-8") if isinstance(content, bytes) else content
        data = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_refuse_twice)
        if "\\u" in text:
            json.dumps(data, ensure_ascii=False).encode()  # half a character can be said in JSON, and not be written
    except (ValueError, RecursionError) as fault:  # not UTF-8, not JSON, an endless integer, or nested without end
        raise error(f"{where}: not JSON ({str(fault)[:120]}); expected {expected}") from fault
    if not isinstance(data, dict):
        raise error(f"{where}: holds a {type(data).__name__}; expected {expected}")
    return data


def _refuse_twice(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object of JSON; refuse a key that stands twice, of which two readers may take different values."""
    found = dict(pairs)
    if len(found) < len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise ValueError(f"the key {twice[:60]!r} is given twice")
    return found


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is no number of JSON")


def take_version(
    data: dict[str, Any],
    version: int,
    where: str,
    error: type[FileError] = FileError,
    what: str = "file that stiction wrote",
) -> dict[str, Any]:
    """Return a JSON object without its `schema_version`; raise `error` where that is not `version`, or not there."""
    if "schema_version" not in data:
        raise error(f"{where} has no schema_version, so that it is no {what}; this program reads version {version}")
    if (found := data["schema_version"]) != version:
        raise error(f"{where}: schema version {found!r}; this program reads version {version}")
    return {name: value for name, value in data.items() if name != "schema_version"}


def write_object(path: Path, data: dict[str, Any]) -> None:
    """Write a JSON object for people to read too; a number that is not finite is refused (`ValueError`)."""
    write_text(path, object_text(data))


def object_text(data: dict[str, Any]) -> str:
    """Return the text that `write_object` writes."""
    return json.dumps(data, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
