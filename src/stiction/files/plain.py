"""JSON of the files between verbs: of a bounded size; errors name file and field in one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from stiction.core.errors import FileError
from stiction.core.files import read_bounded, write_text

LARGEST_TEXT = 2**26
"""Maximum size of JSON [B]."""


def read_object(
    path: Path, expected: str, error: type[FileError] = FileError, most: int = LARGEST_TEXT
) -> dict[str, Any]:
    """Return the JSON object in a file.

    path: the file; expected: kind of file, for messages; error: raised where the file cannot be read, is too large, or
    holds no JSON object; most: maximum size [B].
    """
    return parse_object(read_bounded(path, expected, error, most), path.name, expected, error)


def parse_object(content: bytes | str, where: str, expected: str, error: type[FileError] = FileError) -> dict[str, Any]:
    """Return a JSON object from text; messages name `where`. Raises `error` as `read_object` does."""
    try:
        text = content.decode("utf-8") if isinstance(content, bytes) else content
        data = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_reject_duplicates)
        if "\\u" in text:
            json.dumps(data, ensure_ascii=False).encode()  # half a character can be said in JSON, and not be written
    except (ValueError, RecursionError) as fault:  # not UTF-8, not JSON, an endless integer, or nested without end
        raise error(f"{where}: not JSON ({str(fault)[:120]}); expected {expected}") from fault
    if not isinstance(data, dict):
        raise error(f"{where}: holds a {type(data).__name__}; expected {expected}")
    return data


def _reject_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object of JSON; reject a duplicate key, for which two readers may take different values."""
    unique = dict(pairs)
    if len(unique) < len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise ValueError(f"the key {twice[:60]!r} is given twice")
    return unique


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is not a JSON number")


def take_version(
    data: dict[str, Any],
    version: int,
    where: str,
    error: type[FileError] = FileError,
    what: str = "file that stiction wrote",
) -> dict[str, Any]:
    """Return a JSON object without its `schema_version`; raise `error` unless that is `version`."""
    if "schema_version" not in data:
        raise error(f"{where} has no schema_version, so it is not a {what}; this program reads version {version}")
    if (version_read := data["schema_version"]) != version:
        raise error(f"{where}: schema version {version_read!r}; this program reads version {version}")
    return {name: value for name, value in data.items() if name != "schema_version"}


def write_object(path: Path, data: dict[str, Any]) -> None:
    """Write a JSON object, indented; a number that is not finite is refused (`ValueError`)."""
    write_text(path, object_text(data))


def object_text(data: dict[str, Any]) -> str:
    """Return the text of `write_object`."""
    return json.dumps(data, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
