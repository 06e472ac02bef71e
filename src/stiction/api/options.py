"""Keyword arguments as the dataclasses that the command line's flags fill: same names, same checks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.core.records import from_plain

Options = TypeVar("Options")


def options_of(kind: type[Options], given: Mapping[str, Any], where: str) -> Options:
    """Return a dataclass of options from keyword arguments.

    where: the function, for messages. Raises `ConfigurationError` for a name that is none, with the nearest, and for a
    value of another type than the field's.
    """
    names = [item.name for item in fields(kind)]  # type: ignore[arg-type]
    for name in given:
        if name not in names:
            raise ConfigurationError(f"{where}: {unknown_name('option', name, names)}")
    return from_plain(kind, {name: _plain(value) for name, value in given.items()}, where, ConfigurationError)


def _plain(value: Any) -> Any:
    """Return a value as JSON has it: numbers of NumPy as Python's, tuples and arrays as lists."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return [_plain(part) for part in value] if isinstance(value, tuple | list) else value
