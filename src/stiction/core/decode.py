"""Decoder of plain data, from JSON or YAML, into dataclasses; errors name the field by its full path."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Collection, Mapping
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from stiction.core.errors import FileError, StictionError, nearest

T = TypeVar("T")

LARGEST = 1e300
"""Bound of the numbers in a file; integers have their bounds where they are used."""

WORDS = {str: "text", bool: "true or false", int: "a whole number"}
"""Type -> its name in messages."""


@cache
def _declared(kind: type) -> tuple[dict[str, Any], frozenset[str]]:
    """Return the types of a dataclass's fields by name, and the names of those without a default."""
    declared, hints, none = dataclasses.fields(kind), get_type_hints(kind), dataclasses.MISSING
    needed = (field.name for field in declared if field.default is none and field.default_factory is none)
    return {field.name: hints[field.name] for field in declared}, frozenset(needed)


def from_plain(
    kind: type[T],
    data: Any,
    where: str = "config",
    error: type[StictionError] = FileError,
    required: Collection[str] = (),
) -> T:
    """Return the dataclass `kind` from what `asdict` made of it, perhaps through JSON; a missing field has its default.

    Objects become dataclasses and mappings, lists tuples, whole numbers floats, as the fields are declared; numbers are
    finite. required: fields that must be present although they have a default. Raises `error` naming the first field
    that has another type, is missing, or is unknown (with the nearest name).
    """
    if not isinstance(data, dict):
        raise error(f"{where} is {short(data)}; expected the fields of {kind.__name__}")
    hints, needed = _declared(kind)  # type: ignore[arg-type]
    for name in data:
        if name not in hints:
            near = nearest(str(name), hints) or "; was it written by another version?"
            raise error(f"{where}: {kind.__name__} has no field {name!r}{near}")
    for name in hints:
        if name not in data and (name in needed or name in required):
            raise error(f"{where}: field {name!r} is missing; was it written by another version?")
    return kind(**{name: value_of(hints[name], value, f"{where}: {name}", error) for name, value in data.items()})


def value_of(kind: Any, value: Any, where: str, error: type[StictionError]) -> Any:
    """Return a plain value as the declared type of a field, text as a path; raise `error`, naming `where`,
    otherwise.
    """
    origin, inner = get_origin(kind), get_args(kind)
    if kind is Any:
        return value
    if dataclasses.is_dataclass(kind):
        return value if isinstance(value, kind) else from_plain(kind, value, where, error)  # type: ignore[arg-type]
    if origin in (Union, UnionType):
        if value is None and type(None) in inner:
            return None
        kinds = [item for item in inner if item is not type(None)]
        return value_of(next((item for item in kinds if _alike(item, value)), kinds[0]), value, where, error)
    if origin is tuple:
        return _tuple(inner, value, where, error)
    if origin in (dict, Mapping):
        if not isinstance(value, dict):
            raise error(f"{where} is {short(value)}; expected an object")
        return {name: value_of(inner[1], entry, f"{where}: {name}", error) for name, entry in value.items()}
    if origin is Literal:
        if not isinstance(value, str) or value not in inner:
            near = nearest(value, inner) if isinstance(value, str) else ""
            raise error(f"{where} is {short(value)!r}; expected {', '.join(map(str, inner))}{near}")
        return value
    if kind is Path and isinstance(value, str) and value:
        return Path(value)
    if kind is float:
        # Refuses NaN too, by `not <`; and stands before `float`, which overflows at an integer of thousands of digits.
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < LARGEST:
            raise error(f"{where} is {short(value)}; expected a finite number")
        return float(value)
    # To isinstance a bool is an int.
    if isinstance(value, bool) != (kind is bool) or not isinstance(value, kind):
        raise error(f"{where} is {short(value)!r}; expected {WORDS.get(kind, kind.__name__)}")
    return value


def _tuple(inner: tuple[Any, ...], value: Any, where: str, error: type[StictionError]) -> tuple[Any, ...]:
    endless = inner[-1] is Ellipsis
    if not isinstance(value, list | tuple) or not (endless or len(value) == len(inner)):
        raise error(f"{where} is {short(value)}; expected a list{'' if endless else f' of {len(inner)}'}")
    kinds = [inner[0]] * len(value) if endless else inner
    entries = enumerate(zip(kinds, value, strict=True))
    return tuple(value_of(item, entry, f"{where}[{number}]", error) for number, (item, entry) in entries)


def _alike(kind: Any, value: Any) -> bool:
    """Return whether a value has the shape of an alternative of a union: a list, an object, or a single value."""
    if isinstance(value, list | tuple):
        return get_origin(kind) is tuple
    if isinstance(value, dict):
        return dataclasses.is_dataclass(kind) or get_origin(kind) in (dict, Mapping)
    if isinstance(value, str | bool):
        return kind is type(value) or get_origin(kind) is Literal
    return kind in (float, type(value))


def short(value: Any) -> str:
    """Return a value as text, truncated for error messages."""
    # An integer of thousands of digits has no text.
    return "a huge integer" if isinstance(value, int) and abs(value) >= LARGEST else str(value)[:60]


def is_number(value: object, largest: float = sys.float_info.max) -> bool:
    """Return whether a value is a number between -`largest` and `largest`, and not a bool; JSON's may be infinite."""
    return isinstance(value, int | float) and not isinstance(value, bool) and -largest < value < largest


def is_integer(value: object) -> bool:
    """Return whether a value is a whole number, and not a bool."""
    return isinstance(value, int) and not isinstance(value, bool)


def is_text(value: object) -> bool:
    """Return whether a value is a text that is not blank."""
    return isinstance(value, str) and bool(value.strip())
