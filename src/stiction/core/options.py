"""Reader of a command line into options, for every verb; one line for an error.

The fields of a dataclass are the options (`core.flags`): some are flags, the others settings, which `--set path=value`
or a YAML file, `--config FILE`, give by the same decoder of plain data. Later ones win: defaults, those of a preset
among them, then the file, then --set and flags; a field that both of these give is refused.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from stiction.core.decode import short, value_of
from stiction.core.effects import check_effects
from stiction.core.errors import ConfigurationError, closest, escaped, nearest, one_line
from stiction.core.flags import NO_PATH, Entry, convert, default_of, entries, flag
from stiction.core.help import Groups, help_text, named, sentence, settings_text, wanted

Options = TypeVar("Options")

Choice = Callable[[Mapping[str, Any]], Options]
"""Function from the values on the command line, by the keys of --set, to the remaining defaults."""

HELP, HELP_ALL = ("-h", "--help"), "--help-all"
"""Words that ask for help: the common options, or all of them."""

WIDEST = 120

SET = Entry(
    *("", "set", "--set"),
    flag(help="Setting, PATH=VALUE, the value as in YAML; again for another one. `--set help` lists all settings."),
    *(str, object, None),
)
CONFIG = Entry(
    *("", "config", "--config"),
    flag(help="File of settings, YAML or JSON, nested as their paths are; --set and flags override it."),
    *(Path | None, object, None),
)
"""Flags of a verb that has settings."""

ASSIGNMENT = "PATH=VALUE; `--set help` lists the settings"


class _Usage(Exception):
    """Invalid command line, with the cause."""


@dataclass(frozen=True)
class ParsedArguments:
    """Values of a command line."""

    values: Mapping[str, Any] = field(default_factory=dict)
    """Path of a field -> its value, checked by its type."""
    typed: Mapping[str, str] = field(default_factory=dict)
    """Path of a field, and `--config` -> its source: `--seed`, `--set teacher.gamma`, or a place in the file."""


def read_options(
    kind: type[Options],
    arguments: Sequence[str],
    program: str,
    description: str,
    default: Options | Choice[Options] | None = None,
    groups: Groups | None = None,
) -> Options:
    """Return the options on a command line.

    kind: dataclass of the options, a field each; program: words before the arguments, `stiction train`; description:
    purpose, in paragraphs, one of them with examples, in indented lines; default: options with the defaults, or a
    function that chooses them; groups: options that `--help` shows; without groups all. Raises `ConfigurationError`: an
    option lacks a required one, or two exclude each other (`core.effects`); `SystemExit`: help was printed (status 0),
    or the words are invalid, with one line on standard error (status 2).
    """
    return read_parsed(kind, arguments, program, description, default, groups)[0]


def read_parsed(
    kind: type[Options],
    arguments: Sequence[str],
    program: str,
    description: str,
    default: Options | Choice[Options] | None = None,
    groups: Groups | None = None,
) -> tuple[Options, Options | None, ParsedArguments]:
    """Return options as `read_options`, the defaults (None where some options are required), and the typed values.

    Raises as `read_options`.
    """
    table = entries(kind)
    help_words = [word for word in arguments if word in (*HELP, HELP_ALL)]
    words = [word for word in arguments if word not in help_words]
    rest = _without_list(words) if _has_settings(table) else words
    listed = len(rest) < len(words)
    try:
        parsed = _read(table, rest)
    except _Usage as wrong:
        if not help_words and not listed:
            refuse(program, str(wrong))
        parsed = ParsedArguments()
    keys = {entry.path: entry.key for entry in table}
    base: Any = default({keys[path]: value for path, value in parsed.values.items()}) if callable(default) else default
    if help_words or listed:
        shown, width = entries(kind, MISSING if base is None else base), min(WIDEST, shutil.get_terminal_size().columns)
        if listed and not help_words:
            print(settings_text(shown, program, width))
        else:
            shown += [SET, CONFIG] if _has_settings(shown) else []
            brief = groups is not None and HELP_ALL not in help_words
            print(help_text(shown, program, description, groups or {}, brief, width))
        raise SystemExit(0)
    missing = [entry for entry in table if _is_missing(entry, parsed.values)] if base is None else []
    if missing:
        refuse(
            program, "; ".join(f"{named(item)} is missing: {sentence(item.meaning).rstrip('.')}" for item in missing)
        )
    options: Any = _built(kind, parsed.values, MISSING if base is None else base, "")
    check_effects(options, *([] if base is None else [base]))
    return options, base, parsed


def refuse(program: str, what: str) -> NoReturn:
    """Print in one line why a command line is invalid, and exit with status 2."""
    end = "" if what.endswith("?") else ";"
    print(f"{program}: {one_line(escaped(what))}{end} `{program} --help` shows the usage", file=sys.stderr)
    raise SystemExit(2)


def _without_list(words: list[str]) -> list[str]:
    """Return words without `--set help`, which asks for the list of settings."""
    pair = ["--set", "help"]
    begins = [number for number in range(len(words)) if words[number : number + 2] == pair]
    left_out = {*begins, *(number + 1 for number in begins)}
    return [word for number, word in enumerate(words) if number not in left_out and word != "--set=help"]


def _has_settings(table: Sequence[Entry]) -> bool:
    return any(not entry.name for entry in table)


def _is_missing(entry: Entry, values: Mapping[str, Any]) -> bool:
    """Return whether a required field has no value; a repeatable argument is never missing."""
    several = entry.form.kind == "argument" and entry.values[1]
    return entry.default is MISSING and entry.path not in values and not several


def _read(table: Sequence[Entry], arguments: Sequence[str]) -> ParsedArguments:
    """Return the values of the words; raise `_Usage` for the first invalid one."""
    values: dict[str, Any] = {}
    typed: dict[str, str] = {}
    path: Path | None = None
    for entry, name, value in _words(table, arguments):
        if entry is SET:
            entry, value = _setting(table, value)
            name = f"--set {entry.key}"
        place = entry.path or entry.name
        if before := typed.get(place):
            both = f"{name} is given twice" if before == name else f"{before} and {name} are one option, given twice"
            raise _Usage(f"{both}; give it once")
        typed[place] = name
        if entry is CONFIG:
            path = value
        else:
            values[place] = value
    if path is None:
        return ParsedArguments(values, typed)
    file, keys = _of_file(table, path), {entry.path: entry.key for entry in table}
    return ParsedArguments({**file, **values}, {**{place: f"{path}: {keys[place]}" for place in file}, **typed})


def _words(table: Sequence[Entry], arguments: Sequence[str]) -> Iterator[tuple[Entry, str, Any]]:
    """Yield the value of each flag or argument, in the order of the words: its field, its name as typed, its value."""
    known = {entry.name: entry for entry in table if entry.name.startswith("--")}
    known |= {reserved.name: reserved for reserved in (SET, CONFIG) if _has_settings(table)}
    negative = {entry.negative: entry for entry in known.values() if entry.switch}
    free = [entry for entry in table if entry.form.kind == "argument"]
    rest, loose = [*arguments], list[str]()
    while rest:
        word = rest.pop(0)
        if word == "--":
            loose, rest = [*loose, *rest], []
        elif not _is_flag(word):
            loose.append(word)
        else:
            name, equals, value = word.partition("=")
            name = name.replace("_", "-")
            entry = known.get(name) or negative.get(name)
            if entry is None:
                raise _Usage(f"unknown option {name}{_meant(name, table, known)}")
            if entry.switch:
                if equals:
                    raise _Usage(f"{name} takes no value; {entry.negative} is its opposite")
                yield entry, name, name in known
                continue
            words, most = [value] if equals else [], len(rest) if entry.values[1] else len(entry.values[0])
            while not equals and rest and len(words) < most and not _is_flag(rest[0]):
                words.append(rest.pop(0))
            yield entry, name, _value(entry, name, words)
    for entry in free:
        taken, loose = (loose, []) if entry.values[1] else (loose[:1], loose[1:])
        if taken:
            yield entry, entry.name, _value(entry, entry.name, taken)
    if loose:
        raise _Usage(f"{' '.join(loose)}: unexpected argument")


def _is_flag(word: str) -> bool:
    """Return whether a word is a flag and not a value, such as a negative number."""
    if len(word) < 2 or not word.startswith("-"):
        return False
    try:
        float(word)
    except ValueError:
        return True
    return False


def _meant(name: str, table: Sequence[Entry], known: Mapping[str, Entry]) -> str:
    plain = {f"--{entry.key.replace('_', '-')}": entry.typed for entry in table if entry.form.kind != "argument"}
    last = f"--{name.rpartition('.')[2]}"
    match = closest(name, [*known, *plain]) or (last if last in known else None)
    meant = plain.get(match or "", match)
    if meant is None:
        return ""
    return f"; did you mean '{meant}=VALUE'?" if meant.startswith("--set ") else f"; did you mean {meant!r}?"


def _value(entry: Entry, name: str, words: Sequence[str]) -> Any:
    typed = f"{name} {' '.join(words)!r}"
    for word in words if entry.choices else ():
        if word not in (*entry.choices, "None"):
            raise _Usage(f"{typed}; expected {', '.join(entry.choices)}{nearest(word, entry.choices)}")
    try:
        return convert(entry, words)
    except ValueError as error:
        if str(error) == NO_PATH:
            raise _Usage(f"{name} '': {NO_PATH}") from None
        expected = ASSIGNMENT if entry is SET else wanted(entry)
        raise _Usage(
            f"{typed}: expected {expected}" if words else f"{name}: a value is missing; expected {expected}"
        ) from None


def _setting(table: Sequence[Entry], word: str) -> tuple[Entry, Any]:
    """Return the field and value of a word of --set."""
    from stiction.core.yaml_files import SettingsLoader, parse_yaml

    key, equals, text = word.partition("=")
    if not equals:
        raise _Usage(f"--set {word!r}: expected {ASSIGNMENT}")
    entry, where = _keyed(table, key, "--set "), f"--set {key}"
    try:
        plain = parse_yaml(text, where, ConfigurationError, SettingsLoader)
        return entry, value_of(entry.kind, plain, where, ConfigurationError)
    except ConfigurationError as error:
        raise _Usage(str(error)) from error


def _keyed(table: Sequence[Entry], key: str, where: str) -> Entry:
    """Return the field with a key. where: prefix of messages."""
    fields_of = {entry.key: entry for entry in table if entry.form.kind != "argument"}
    name = key.replace("-", "_")
    if name in fields_of:
        return fields_of[name]
    below = [path for path in fields_of if path.startswith(f"{name}.")]
    if below:
        raise _Usage(f"{where}{short(key)}: a group of settings; expected one of {', '.join(below)}")
    near = closest(name, fields_of) or next((path for path in fields_of if path.rpartition(".")[2] == name), None)
    remedy = "`--set help` lists the settings" if near is None else f"did you mean {near!r}?"
    raise _Usage(f"{where}{short(key)}: unknown setting; {remedy}")


def _of_file(table: Sequence[Entry], path: Path) -> dict[str, Any]:
    """Return the values of a file of settings, by the paths of their fields."""
    from stiction.core.yaml_files import SettingsLoader, read_yaml

    groups = {entry.key[:end] for entry in table for end, letter in enumerate(entry.key) if letter == "."}
    values, where = {}, f"--config {path}: "
    try:
        plain = read_yaml(path, "a file of settings", ConfigurationError, SettingsLoader)
        for key, value in _leaves(plain, groups, "", where):
            entry = _keyed(table, key, where)
            if entry.path in values:
                raise _Usage(f"{where}{entry.key} is given twice; give it once")
            values[entry.path] = value_of(entry.kind, value, f"{where}{entry.key}", ConfigurationError)
    except ConfigurationError as error:
        raise _Usage(str(error)) from error
    return values


def _leaves(plain: Any, groups: Collection[str], key: str, where: str) -> Iterator[tuple[str, Any]]:
    """Yield key and value of each setting in nested plain data. groups: keys of settings with others below."""
    if not isinstance(plain, dict):
        raise _Usage(f"{where}{key.rstrip('.') or 'the file'} is {short(plain)}; expected settings with values")
    for name, value in plain.items():
        if f"{key}{name}" in groups:
            yield from _leaves(value, groups, f"{key}{name}.", where)
        else:
            yield f"{key}{name}", value


def _built(kind: type[Any], values: Mapping[str, Any], before: Any, path: str) -> Any:
    """Return the options at a path with their new values. before: the options without them."""
    changed: dict[str, Any] = {}
    for item in fields(kind):
        place = f"{path}{item.name}"
        old = default_of(item) if before is MISSING else getattr(before, item.name)
        if place in values:
            changed[item.name] = values[place]
        elif any(name.startswith(f"{place}.") for name in values):
            changed[item.name] = _built(type(old), values, old, f"{place}.")
        elif old is MISSING:
            changed[item.name] = ()
    return kind(**changed) if before is MISSING else replace(before, **changed)
