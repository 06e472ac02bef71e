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
    """Build the dataclass `kind` from what `to_plain` returned, now or before a field was added.

    A field that is missing has its default; a new field's default is therefore what was done before there was one.

    Raises `StictionError` naming the field that is missing or unknown.
    """
    if not isinstance(data, dict):
        raise StictionError(f"{where}: expected the fields of {kind.__name__}, got {type(data).__name__}")
    hints = get_type_hints(kind)
    fields = {field.name: field for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    needed = {name for name, field in fields.items() if _has_no_default(field)}
    wrong = sorted((needed - data.keys()) | (data.keys() - fields.keys()))
    if wrong:
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


def _has_no_default(field: dataclasses.Field) -> bool:
    """Say whether a field must be given."""
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _tuples(value: Any) -> Any:
    """Return lists within lists as tuples within tuples."""
    return tuple(_tuples(item) for item in value) if isinstance(value, list) else value
