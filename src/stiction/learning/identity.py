"""Identity of a training: its settings that differ from the defaults, flat, named as on the command line.

A policy's contract holds them. Two policies are seeds of one training where these are equal; a missing setting has its
default, so a default is never changed: a preset is. Names and values in files are text, and nothing looks them up.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any

from stiction.files.method import installed_methods
from stiction.learning.config import TrainCfg

APART = ("seed", "joints", "actuator", "checkpoint-every", "video-every", "logger", "contacts", "task.robot")
"""Settings that do not tell trainings apart: seed, settings that change no number, and files, which a contract has by
their content (joints.json, Actuator Net, robot)."""

MISSING = "not recorded"
"""Text in place of the settings of a bundle that is older than their field."""

SHOWN, LONGEST_SHOWN = 3, 60
"""Settings that a name shows, and characters of a value."""

PLAIN = frozenset("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789 .,:;+-=/%@()_'")
"""Characters that mean nothing to terminals, tables, pages and figures."""


def settings_of(cfg: TrainCfg) -> dict[str, Any]:
    """Return the settings that differ from defaults, as plain JSON, lists flat: `teacher.final-std` -> 0.2."""
    default = defaults()
    return {name: value for name, value in _flat(cfg) if name not in APART and value != default[name]}


@cache
def defaults() -> dict[str, Any]:
    """Return every setting with its default, those of installed methods among them."""
    settings = dict(_flat(TrainCfg()))
    for method in installed_methods():
        settings |= {} if method.settings is None else dict(_flat(method.settings(), f"{method.name}."))
    return settings


def _flat(config: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield name and value of every field of a nested dataclass; settings of a method under the method's name."""
    for field in fields(config):
        name, value = prefix + field.name.replace("_", "-"), getattr(config, field.name)
        if name == "method-settings":
            yield from () if value is None else _flat(value, f"{config.method.name}.")
        elif is_dataclass(value):
            yield from _flat(value, f"{name}.")
        else:
            yield name, [*_entries(value)] if isinstance(value, tuple) else value


def _entries(values: tuple[Any, ...]) -> Iterator[Any]:
    """Yield the entries of tuples within tuples."""
    for value in values:
        if isinstance(value, tuple):
            yield from _entries(value)
        else:
            yield value


def effective(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings, by name, without defaults and those that do not tell trainings apart."""
    default = defaults()
    told = (name for name in sorted(settings) if name not in APART)
    return {name: settings[name] for name in told if name not in default or not same(settings[name], default[name])}


def same(first: Any, second: Any) -> bool:
    """Return whether two values of settings are equal; true is not 1, as it is to Python."""
    return _canonical(first) == _canonical(second)


def _canonical(value: Any) -> str:
    """Return a text that equal values share: 1 is 1.0."""
    return json.dumps([*map(_plain, value)] if isinstance(value, list | tuple) else _plain(value))


def _plain(value: Any) -> Any:
    """Return a value, a float that is whole as an integer: a person may have written either."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def key_of_settings(settings: Mapping[str, Any] | None) -> str | None:
    """Return a text that is equal for seeds of one training; None where the settings are not recorded."""
    if settings is None:
        return None
    return json.dumps({name: json.loads(_canonical(value)) for name, value in effective(settings).items()})


def settings_in(key: str) -> dict[str, Any]:
    """Return the settings in a text of `key_of_settings`."""
    return json.loads(key)


def value_in(settings: Mapping[str, Any], name: str) -> Any:
    """Return a setting, its default where it is missing, None where this version does not know it."""
    return settings[name] if name in settings else defaults().get(name)


def differing(first: Mapping[str, Any], second: Mapping[str, Any]) -> list[str]:
    """Return the names of the settings in which two trainings differ."""
    ours, theirs = effective(first), effective(second)
    names = sorted(ours.keys() | theirs.keys())
    return [name for name in names if not same(value_in(ours, name), value_in(theirs, name))]


def shown(text: str) -> str:
    """Return a text with characters outside `PLAIN` escaped as their numbers."""
    return "".join(sign if sign in PLAIN else f"\\u{ord(sign):04x}" for sign in text)


def value_text(value: Any) -> str:
    """Return a value as typed, shortened."""
    values = value if isinstance(value, list | tuple) else [value]
    words = [each if isinstance(each, str) else json.dumps(_plain(each)) for each in values[:LONGEST_SHOWN]]
    return _short(" ".join(words)) or "empty"


def _short(text: str) -> str:
    """Return a text escaped, and truncated where it is long."""
    return shown(text) if len(text) <= LONGEST_SHOWN else f"{shown(text[:LONGEST_SHOWN])}..."


def setting_text(settings: Mapping[str, Any], name: str) -> str:
    """Return name and value of a setting: `teacher.quiet 30`."""
    return f"{_short(name)} {value_text(value_in(settings, name))}"


def settings_text(settings: Mapping[str, Any] | None, most: int = 60) -> str:
    """Return all settings in one line."""
    if settings is None:
        return MISSING
    told = effective(settings)
    words = [setting_text(told, name) for name in [*told][:most]]
    more = [f"and {len(told) - most} more"] if len(told) > most else []
    return ", ".join((*words, *more)) or "all as by default"


def difference(first: Mapping[str, Any] | None, second: Mapping[str, Any] | None) -> tuple[str, str] | None:
    """Return the first setting in which two trainings differ, `teacher.quiet 30`, and the second's value, `0`.

    None where they agree, or one of them is not recorded.
    """
    if first is None or second is None or not (names := differing(first, second)):
        return None
    more = f" ({len(names) - 1} more differ)" if len(names) > 1 else ""
    return setting_text(first, names[0]), value_text(value_in(second, names[0])) + more


NAMED = 5


def unrecorded_note(names: Sequence[str]) -> list[str]:
    """Return a warning, or none, on policies that are taken for seeds of one training without recorded settings."""
    if not names:
        return []
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return [
        f"Settings {MISSING}: {', '.join(names[:NAMED])}{more}. Exported before bundles had the settings of their "
        "training; that they are seeds of one training is taken on trust. Export the runs again, where they still are."
    ]
