"""The arguments of the public functions: their names and types, checked where a person gives them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from functools import wraps
from inspect import Parameter, signature
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from stiction.core.decode import from_plain
from stiction.core.errors import ConfigurationError, nearest, unknown_name
from stiction.core.extras import explain_missing

Options = TypeVar("Options")
Arguments = ParamSpec("Arguments")
Returned = TypeVar("Returned")

NAMELESS = ("options", "policies", "log", "more_logs", "base")
"""Parameters and fields that nobody gives by name."""

ACCEPTED: dict[Any, tuple[type, ...]] = {
    float: (int, float, np.integer, np.floating),
    int: (int, np.integer),
    Path: (os.PathLike,),
}
"""Annotation -> what else than it is taken."""


def public(function: Callable[Arguments, Returned]) -> Callable[Arguments, Returned]:
    """Have a function refuse, before any work, what its signature does not take, and say which extra is missing.

    Both as a `ConfigurationError` that names the argument, what came, and what was expected.
    """
    called = explain_missing(function)

    @wraps(function)
    def checked(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Returned:
        _check_call(function, args, kwargs)
        return called(*args, **kwargs)

    return checked


def _check_call(function: Callable[..., Any], args: Sequence[Any], kwargs: Mapping[str, Any]) -> None:
    """Raise `ConfigurationError` for an argument that a function does not have, or of another type than its own."""
    form, where = signature(function), function.__name__
    parameters = form.parameters
    if Parameter.VAR_KEYWORD not in [one.kind for one in parameters.values()]:
        for name in kwargs.keys() - parameters.keys():
            raise ConfigurationError(f"{where}: {unknown_name('option', name, parameters)}")
    try:
        bound = form.bind(*args, **kwargs).arguments
    except TypeError as error:
        named = [f"{one.name}=..." for one in parameters.values() if one.kind is Parameter.KEYWORD_ONLY]
        first = [one.name for one in parameters.values() if one.kind is Parameter.POSITIONAL_OR_KEYWORD]
        raise ConfigurationError(f"{where}: {error}; expected {where}({', '.join(first + named)})") from error
    hints = get_type_hints(function)
    for name, value in bound.items():
        kind = parameters[name].kind
        for one in value if kind is Parameter.VAR_POSITIONAL else () if kind is Parameter.VAR_KEYWORD else (value,):
            if not _fits(hints[name], one):
                expected = _expected(hints[name], one, str(parameters[name].annotation))
                raise ConfigurationError(f"{where}: {name} is {_short(one)}; expected {expected}")


def _fits(kind: Any, value: Any) -> bool:
    """Tell whether a value is one of an annotation; a single value is a sequence of its kind."""
    origin, inner = get_origin(kind), get_args(kind)
    if kind is Any or isinstance(kind, TypeVar):
        return True
    if origin in (Union, UnionType):
        return any(_fits(part, value) for part in inner)
    if origin is Literal:
        return isinstance(value, str) and value in inner
    if origin is tuple:
        return isinstance(value, Sequence | np.ndarray) and len(value) == len(inner) and all(map(_fits, inner, value))
    if isinstance(origin, type) and issubclass(origin, Sequence):
        # A word is a sequence of letters, and here one thing.
        if isinstance(value, str):
            return _fits(inner[0], value)
        parts = value if isinstance(value, Sequence | np.ndarray) else ()
        return isinstance(value, Iterable) and all(_fits(inner[0], part) for part in parts)
    # To Python a truth value is an int.
    if kind in (float, int) and isinstance(value, bool):
        return False
    return isinstance(value, ACCEPTED.get(kind, origin or kind))


def _expected(kind: Any, value: Any, annotation: str) -> str:
    """Return what an annotation expects, in words; of a word among some the nearest too."""
    parts = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    words = [str(word) for part in parts if get_origin(part) is Literal for word in get_args(part)]
    if not words or len([part for part in parts if part is not NoneType]) > 1:
        return annotation.replace(" | ", " or ")
    return ", ".join(words) + (nearest(value, words) if isinstance(value, str) else "")


def _short(value: Any) -> str:
    """Return a value for a message: itself where it is plain, else what it is."""
    plain = value is None or isinstance(value, str | int | float | list | tuple | Path)
    return repr(value)[:60] if plain else f"a {type(value).__name__}"


def several(value: Any) -> tuple[Any, ...]:
    """Return what was given as one, or as several."""
    return tuple(value) if isinstance(value, Iterable) and not isinstance(value, str) else (value,)


def options_of(kind: type[Options], settings: Mapping[str, Any], function: Callable[..., Any]) -> Options:
    """Return a dataclass of options, such as the flags of a verb fill, from keyword arguments: same names, same checks.

    function: the one that was called, for messages. Raises `ConfigurationError` for a name that is none, with the
    nearest, and for a value of another type than the field's.
    """
    where, names = function.__name__, [item.name for item in fields(kind)]  # type: ignore[arg-type]
    for name in settings:
        if name not in names:
            known = [one for one in (*signature(function).parameters, *names) if one not in NAMELESS]
            raise ConfigurationError(f"{where}: {unknown_name('option', name, dict.fromkeys(known))}")
    return from_plain(kind, {name: _plain(value) for name, value in settings.items()}, where, ConfigurationError)


def _plain(value: Any) -> Any:
    """Return a value as JSON has it: numbers of NumPy as Python's, tuples and arrays as lists."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return [_plain(part) for part in value] if isinstance(value, tuple | list) else value
