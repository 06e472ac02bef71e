"""As much of JSON Schema, draft 2020-12, as our schemas use; a keyword that is not here is an error, not ignored."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

KINDS: dict[str, Callable[[Any], bool]] = {
    "object": lambda v: isinstance(v, dict),
    "array": lambda v: isinstance(v, list),
    "string": lambda v: isinstance(v, str),
    "boolean": lambda v: isinstance(v, bool),
    "null": lambda v: v is None,
    "number": lambda v: isinstance(v, int | float) and not isinstance(v, bool),
    "integer": lambda v: isinstance(v, int | float) and not isinstance(v, bool) and v == int(v),
}

NOTES = frozenset({"$schema", "$id", "$comment", "title", "description", "if", "then"})

RULES: dict[str, tuple[str, Callable[[Any, Any], bool]]] = {
    "minimum": ("number", lambda v, a: v >= a),
    "maximum": ("number", lambda v, a: v <= a),
    "exclusiveMinimum": ("number", lambda v, a: v > a),
    "exclusiveMaximum": ("number", lambda v, a: v < a),
    "minLength": ("string", lambda v, a: len(v) >= a),
    "maxLength": ("string", lambda v, a: len(v) <= a),
    "pattern": ("string", lambda v, a: re.search(a, v) is not None),
    "minItems": ("array", lambda v, a: len(v) >= a),
    "maxItems": ("array", lambda v, a: len(v) <= a),
    "uniqueItems": ("array", lambda v, a: not a or len({repr(item) for item in v}) == len(v)),
    "required": ("object", lambda v, a: set(a) <= v.keys()),
    "maxProperties": ("object", lambda v, a: len(v) <= a),
    "propertyNames": ("object", lambda v, a: not any(any(faults(name, a)) for name in v)),
}
"""Keyword -> the type that it says something of, and whether a value obeys an argument."""


def same(a: Any, b: Any) -> bool:
    """Return whether two values are equal in JSON, where true is not 1."""
    return a == b and isinstance(a, bool) == isinstance(b, bool)


def faults(value: Any, schema: dict[str, Any], where: str = "$") -> Iterator[str]:
    """Yield what is wrong with a value; nothing where it fits."""
    for keyword, argument in schema.items():
        if keyword in RULES:
            kind, obeys = RULES[keyword]
            if KINDS[kind](value) and not obeys(value, argument):
                yield f"{where}: {keyword} {argument}"
        elif keyword == "type":
            if not any(KINDS[kind](value) for kind in ([argument] if isinstance(argument, str) else argument)):
                yield f"{where}: type {argument}"
        elif keyword in ("enum", "const"):
            if not any(same(value, item) for item in (argument if keyword == "enum" else [argument])):
                yield f"{where}: {keyword} {argument}"
        elif keyword == "anyOf":
            if all(any(faults(value, choice, where)) for choice in argument):
                yield f"{where}: none of anyOf"
        elif keyword in ("properties", "additionalProperties", "items", "prefixItems"):
            yield from _parts(value, schema, keyword, where)
        elif keyword not in NOTES:
            raise NotImplementedError(keyword)
    if "if" in schema and not any(faults(value, schema["if"], where)):
        yield from faults(value, schema["then"], where)


def _parts(value: Any, schema: dict[str, Any], keyword: str, where: str) -> Iterator[str]:
    """Yield what is wrong with the parts of an object or a list."""
    argument = schema[keyword]
    if isinstance(value, dict) and keyword == "properties":
        for name in argument.keys() & value.keys():
            yield from faults(value[name], argument[name], f"{where}.{name}")
    elif isinstance(value, dict) and keyword == "additionalProperties":
        for name in value.keys() - schema.get("properties", {}).keys():
            yield from (
                [f"{where}.{name}: unknown"] if argument is False else faults(value[name], argument, f"{where}.{name}")
            )
    elif isinstance(value, list) and keyword in ("items", "prefixItems"):
        pairs = enumerate(zip(value, argument if keyword == "prefixItems" else [argument] * len(value), strict=False))
        for number, (item, each) in pairs:
            yield from faults(item, each, f"{where}[{number}]")
