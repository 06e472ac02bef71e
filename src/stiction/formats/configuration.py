"""Frozen configuration dataclasses as JSON and back, complete: a run's config.json can be loaded and trained again."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar, get_type_hints

from stiction.formats.errors import StictionError

T = TypeVar("T")


def to_plain(config: Any) -> Any:
    """Return a (nested) dataclass as dicts, lists and numbers, ready for JSON."""
    return dataclasses.asdict(config)


def from_plain(kind: type[T], data: Any, where: str = "config") -> T:
    """Build the dataclass `kind` from what `to_plain` returned.

    Raises `StictionError` naming the field that is missing or unknown.
    """
    if not isinstance(data, dict):
        raise StictionError(f"{where}: expected the fields of {kind.__name__}, got {type(data).__name__}")
    hints = get_type_hints(kind)
    names = {field.name for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    if names != data.keys():
        wrong = sorted(names ^ data.keys())
        raise StictionError(
            f"{where}: fields {', '.join(wrong)} are missing or unknown; was it written by another version?"
        )
    values = {}
    for name, value in data.items():
        nested = hints[name]
        if dataclasses.is_dataclass(nested):
            value = from_plain(nested, value, f"{where}.{name}")  # type: ignore[arg-type]
        elif isinstance(value, list):
            value = _tuples(value)
        values[name] = value
    return kind(**values)


def _tuples(value: Any) -> Any:
    """Return lists within lists as tuples within tuples."""
    return tuple(_tuples(item) for item in value) if isinstance(value, list) else value
