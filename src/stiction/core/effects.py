"""Options that require or exclude others: declared at the field, checked as options are read, refused in one sentence.

log_robots: int = field(default=4, metadata=needs("--log"))                            --log is set
static_ratio: float = field(default=1.5, metadata=needs("--friction-law stribeck"))    it has this value
model: Path | None = field(default=None, metadata=needs("--to mujoco or urdf"))        it has one of these values
loop: bool = field(default=False, metadata=excludes("--train", "--preset"))
plan: bool = field(default=False, metadata=needs("--preset full") | excludes(but=("--runs",)))
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from operator import attrgetter
from typing import Any

from stiction.core.errors import ConfigurationError
from stiction.core.flags import default_of, entries


@dataclass(frozen=True)
class Need:
    """Requirement of an option."""

    text: str
    """Required option, as typed: `--log`, or with values `--to mujoco, urdf or webots`."""
    met: Callable[[Any], bool] | None
    """Condition on the options of the verb; by default the option is set, or has one of the values."""
    part: str


def needs(text: str, met: Callable[[Any], bool] | None = None, part: str = "") -> dict[str, Any]:
    """Return the metadata of a field that requires another option; the arguments are those of `Need`."""
    return {"needs": Need(text, met, part)}


def excludes(*flags: str, but: Sequence[str] = ()) -> dict[str, Any]:
    """Return the metadata of a field that excludes other options: `flags`, or all except `but`."""
    return {"excludes": lambda flag: flag not in but if but else any(_within(flag, name) for name in flags)}


def requirement(option: str, needed: str) -> str:
    """Return the message for an option without what it requires."""
    return f"{option} requires {needed}; add {needed} or remove {option}"


def exclusion(option: str, other: str) -> str:
    """Return the message for two options that exclude each other."""
    return f"{option} and {other} exclude each other; remove one of them"


def check_effects(options: Any, defaults: Any = None) -> None:
    """Raise `ConfigurationError` for the first changed option that lacks another one, or is excluded by it.

    defaults: options of the same dataclass, unchanged; by default those of its fields.
    """
    changed = {flag_of(name): name for name in changed_options(options, defaults)}
    for field in fields(options):
        flag, need, excluded = flag_of(field.name), field.metadata.get("needs"), field.metadata.get("excludes")
        if need is not None:
            place = flag_of(f"{field.name}.{need.part}" if need.part else field.name)
            lacking = [name for name in changed if _within(name, place)]
            if lacking and not (_is_met(options, need.text, changed) if need.met is None else need.met(options)):
                raise ConfigurationError(requirement(_typed(options, changed[lacking[0]]), need.text))
        if excluded is not None and flag in changed:
            for name in changed:
                if name != flag and excluded(name):
                    raise ConfigurationError(exclusion(_typed(options, field.name), _typed(options, changed[name])))


def _within(flag: str, group: str) -> bool:
    return flag == group or flag.startswith(f"{group}.")


def _is_met(options: Any, text: str, changed: dict[str, str]) -> bool:
    flag, _, values = text.partition(" ")
    if not values:
        return flag in changed
    return str(attrgetter(flag[2:].replace("-", "_"))(options)) in re.split(", | or ", values)


def _typed(options: Any, path: str) -> str:
    return next((entry.typed for entry in entries(type(options)) if entry.path == path), flag_of(path))


def changed_options(options: Any, defaults: Any = None, place: str = "") -> Iterator[str]:
    """Yield the options that differ from their defaults, nested ones with their path; required ones have none.

    place: path of the options themselves.
    """
    for field in fields(options if defaults is None else defaults):
        now, name = getattr(options, field.name), place + field.name
        before = default_of(field) if defaults is None else getattr(defaults, field.name)
        if is_dataclass(before):
            yield from changed_options(now, before, f"{name}.")
        elif before is not MISSING and now != before:
            yield name


def flag_of(name: str) -> str:
    """Return the flag of a field by its path."""
    return f"--{name.replace('_', '-')}"
