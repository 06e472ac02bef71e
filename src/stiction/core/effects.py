"""Options of one that was not asked for: refused, since they would have no effect.

A verb lists in a table which options are of what, and every refusal reads the same.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from stiction.core.errors import ConfigurationError

LEAVE_ONE = "leave one of them out"
"""The remedy where two things were asked for, of which one replaces the other."""


@dataclass(frozen=True)
class OptionsOf:
    """Options that do something for one thing alone."""

    options: tuple[str, ...]
    """As the dataclass has them: `log_robots`, of nested ones `operator.heartbeat_timeout`, or `operator` for all."""
    owner: str
    """What they are of, in words: `--log`."""
    asked: Callable[[Any], bool]
    """Whether the options of a verb ask for it."""
    remedy: str = "leave it out, or add that"
    """What to do."""


def check_effects(options: Any, defaults: Any, table: Sequence[OptionsOf]) -> None:
    """Raise `ConfigurationError` for the first option that is not what it is by default, and would have no effect.

    options, defaults: dataclasses of one kind.
    """
    changed = list(changed_options(options, defaults))
    for entry in table:
        if entry.asked(options):
            continue
        for name in changed:
            if any(name == one or name.startswith(f"{one}.") for one in entry.options):
                raise ConfigurationError(
                    f"{flag_of(name)} is of {entry.owner}, and would have no effect; {entry.remedy}"
                )


def check_only(options: Any, defaults: Any, used: Collection[str], owner: str) -> None:
    """Raise as `check_effects` for every option but those that are used; owner: of what the others are, in words."""
    others = tuple(field.name for field in fields(defaults) if field.name not in used)
    check_effects(options, defaults, [OptionsOf(others, owner, lambda _: False, "leave one of the two out")])


def changed_options(options: Any, defaults: Any, place: str = "") -> Iterator[str]:
    """Yield the options that are not what they are by default, nested ones with their path; `place`: before it."""
    for field in fields(defaults):
        now, before, name = getattr(options, field.name), getattr(defaults, field.name), place + field.name
        if is_dataclass(before):
            yield from changed_options(now, before, f"{name}.")
        elif now != before:
            yield name


def flag_of(name: str) -> str:
    """Return an option as it is typed."""
    return f"--{name.replace('_', '-')}"
