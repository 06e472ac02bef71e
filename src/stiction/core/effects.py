"""Options that require or exclude others: declared at the field, checked as options are read, refused in one sentence.

log_robots: int = field(default=4, metadata=needs("--log"))                            --log is set
static_ratio: float = field(default=1.5, metadata=needs("--friction-law stribeck"))    it has this value
model: Path | None = field(default=None, metadata=needs("--to mujoco or urdf"))        it has one of these values
hold: float = field(default=0.5, metadata=needs("a limit above 0", lambda cfg: cfg.limit > 0))
stop: StopCfg = field(default_factory=StopCfg, metadata=needs("--stop-at 0.2", stops, but=("error",)))
loop: bool = field(default=False, metadata=excludes("--train", "--preset"))
plan: bool = field(default=False, metadata=needs("--preset full") | excludes(but=("--runs",)))
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from operator import attrgetter
from typing import Any

from stiction.core.errors import ConfigurationError
from stiction.core.flags import Entry, default_of, entries


@dataclass(frozen=True)
class Need:
    """Requirement of an option."""

    text: str
    """Required option, as typed: `--log`, or with values `--to mujoco, urdf or webots`."""
    met: Callable[[Any], bool] | None
    """Condition on the dataclass that declares the field; by default the option is set, or has one of the values."""
    parts: Sequence[str]
    """Nested options that have the requirement; by default all of them."""
    but: Sequence[str]
    """Nested options without the requirement."""


def needs(
    text: str, met: Callable[[Any], bool] | None = None, parts: Sequence[str] = (), but: Sequence[str] = ()
) -> dict[str, Any]:
    """Return the metadata of a field that requires another option; the arguments are those of `Need`."""
    return {"needs": (Need(text, met, parts, but),)}


def all_of(*each: dict[str, Any]) -> dict[str, Any]:
    """Return the metadata of a field with several requirements, the most important first."""
    return {"needs": tuple(need for group in each for need in group["needs"])}


def excludes(*flags: str, but: Sequence[str] = ()) -> dict[str, Any]:
    """Return the metadata of a field that excludes other options: `flags`, or all except `but`."""
    return {"excludes": lambda names: not names & {*but} if but else any(_within(name, flags) for name in names)}


def requirement(option: str, needed: str) -> str:
    """Return the message for an option whose required option is missing."""
    return f"{option} requires {needed}; add {needed} or remove {option}"


def exclusion(option: str, other: str) -> str:
    """Return the message for two options that exclude each other."""
    return f"{option} and {other} exclude each other; remove one of them"


def check_effects(options: Any, *defaults: Any) -> None:
    """Raise `ConfigurationError` for the first changed option that lacks a required option, or is excluded by another.

    defaults: unchanged options of the same dataclass; an option is changed if it differs from all of them. By default:
    the fields' defaults.
    """
    table = {entry.path: entry for entry in entries(type(options))}
    names = {path: {entry.name, flag_of(entry.key)} for path, entry in table.items()}
    changed = [*changed_options(options, *defaults)]
    for path, owner, field in _declared(options):
        for need in field.metadata.get("needs", ()):
            parts, but = ([f"{path}.{part}" for part in some] for some in (need.parts, need.but))
            lacking = [name for name in changed if _within(name, parts or [path]) and not _within(name, but)]
            if lacking and not (_is_met(options, need.text, changed, names) if need.met is None else need.met(owner)):
                raise ConfigurationError(requirement(_typed(table, lacking[0]), need.text))
        excluded = field.metadata.get("excludes", lambda names: False)
        for other in changed if path in changed else ():
            if other != path and excluded(names.get(other, {flag_of(other)})):
                raise ConfigurationError(exclusion(_typed(table, path), _typed(table, other)))


def _declared(options: Any, place: str = "") -> Iterator[tuple[str, Any, Field[Any]]]:
    """Yield path, owner and field of every option, groups before their nested options."""
    for field in fields(options):
        path, value = place + field.name, getattr(options, field.name)
        yield path, options, field
        if is_dataclass(value):
            yield from _declared(value, f"{path}.")


def _within(name: str, groups: Sequence[str]) -> bool:
    """Return whether a flag or path is in a list of paths, or nested in one of them."""
    return any(name == group or name.startswith(f"{group}.") for group in groups)


def _is_met(options: Any, text: str, changed: Sequence[str], names: dict[str, set[str]]) -> bool:
    """Return whether a required option is set, or has one of the values named."""
    flag, _, values = text.partition(" ")
    path = next(path for path, flags in names.items() if flag in flags)
    if not values:
        return path in changed
    return str(attrgetter(path)(options)) in re.split(", | or ", values)


def _typed(table: dict[str, Entry], path: str) -> str:
    """Return an option as it is typed: a flag, an argument in capitals, or a setting."""
    return table[path].typed if path in table else path


def changed_options(options: Any, *defaults: Any, place: str = "") -> Iterator[str]:
    """Yield the paths of options that differ from all their defaults; required options have none.

    place: path of the options themselves.
    """
    for field in fields(options):
        now, name = getattr(options, field.name), place + field.name
        before = [getattr(old, field.name) for old in defaults] or [default_of(field)]
        if is_dataclass(now) and not isinstance(now, type):
            yield from changed_options(now, *(old for old in before if type(old) is type(now)), place=f"{name}.")
        elif all(old is not MISSING and now != old for old in before):
            yield name


def flag_of(name: str) -> str:
    """Return the flag of a field by its path."""
    return f"--{name.replace('_', '-')}"
