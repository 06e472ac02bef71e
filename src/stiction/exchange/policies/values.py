"""Values of others' YAML files and metadata, each checked when it is taken; a message names file and entry."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stiction.core.errors import FileError
from stiction.core.yaml_files import read_yaml
from stiction.robots.description import check_pattern, yaml_mapping, yaml_number


def read_settings(path: Path) -> Mapping[str, Any]:
    """Return the mapping in a YAML file, without aliases and keys that stand twice. Raises `FileError`."""
    return mapping(read_yaml(path, "settings of a policy", FileError), f"{path}: the file")


def mapping(value: Any, where: str) -> Mapping[str, Any]:
    """Return names with values."""
    return yaml_mapping(value, where, FileError)


def number(value: Any, where: str) -> float:
    """Return a number."""
    return yaml_number(value, where, FileError)


def whole(value: Any, where: str) -> int:
    """Return a whole number."""
    if (found := number(value, where)) != int(found):
        raise FileError(f"{where} is {found:g}; expected a whole number")
    return int(found)


def sequence(value: Any, where: str) -> list[Any]:
    """Return a list of a bounded length."""
    if not isinstance(value, list) or len(value) > 8192:
        raise FileError(f"{where} is {str(value)[:60]!r}; expected a list")
    return value


def numbers(value: Any, where: str, count: int | None = None) -> tuple[float, ...]:
    """Return a list of numbers, of `count` where that is given."""
    found = tuple(number(item, where) for item in sequence(value, where))
    if count is not None and len(found) != count:
        raise FileError(f"{where} has {len(found)} numbers; expected {count}")
    return found


def names(value: Any, where: str) -> tuple[str, ...]:
    """Return a list of names."""
    return tuple(word(item, where) for item in sequence(value, where))


def word(value: Any, where: str) -> str:
    """Return a name."""
    if not isinstance(value, str) or not 0 < len(value) <= 200:
        raise FileError(f"{where} is {str(value)[:60]!r}; expected a name")
    return value


def choice(value: Any, where: str, *known: str) -> str:
    """Return one of some words."""
    if value not in known:
        raise FileError(f"{where} is {str(value)[:60]!r}; expected {' or '.join(known)}")
    return str(value)


def one_or_all(value: Any, where: str) -> float | tuple[float, ...]:
    """Return one number, or a list of them; a list of one number over and over is that number."""
    if not isinstance(value, list):
        return number(value, where)
    found = numbers(value, where)
    return found[0] if found and len(set(found)) == 1 else found


def by_joint(value: Any, where: str) -> float | tuple[float, ...] | dict[str, float]:
    """Return a number, a list of them, or regular expressions of joints with numbers."""
    if isinstance(value, Mapping):
        entries = mapping(value, where).items()
        return {check_pattern(pattern, where): number(item, f"{where}: {pattern}") for pattern, item in entries}
    return numbers(value, where) if isinstance(value, list) else number(value, where)


def bounds(value: Any, where: str) -> tuple[float, float] | None:
    """Return lowest and highest value of a clip: a list of two, or the symmetric bound; None where it is null."""
    if value is None or value == "none":
        return None
    if isinstance(value, list):
        low, high = numbers(value, where, 2)
        return low, high
    high = number(value, where)
    return -high, high


def infinite(text: str, where: str) -> float:
    """Return a number of text in metadata, where infinite ones are allowed."""
    try:
        found = float(text)
    except ValueError as error:
        raise FileError(f"{where} is {text[:60]!r}; expected a number") from error
    if math.isnan(found):
        raise FileError(f"{where} is not a number; expected one")
    return found
