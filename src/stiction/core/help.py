"""Help of a verb (purpose, examples, options), and the list of all its settings."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import MISSING
from pathlib import Path
from typing import Any, Literal, get_origin

from stiction.core.flags import Entry, text_of

Groups = Mapping[str, Sequence[str]]
"""Heading -> the common options, `--out`, in the order in which `--help` shows them."""

LEFT = 30
"""Width of the column of option names."""

KINDS: dict[Any, tuple[str, str, str]] = {
    int: ("INT", "a whole number", "whole numbers"),
    float: ("FLOAT", "a number", "numbers"),
    str: ("STR", "a word", "words"),
    Path: ("PATH", "a path", "paths"),
}
"""Kind of value -> its name in the help, and in words: singular and plural."""

COUNTS = ("no", "one", "two", "three", "four")


def help_text(table: Sequence[Entry], program: str, description: str, groups: Groups, brief: bool, width: int) -> str:
    """Return the help of a program: purpose, examples, options.

    brief: only `groups`, with one sentence an option, and of the description the first paragraph and the examples.
    """
    paragraphs = description.strip().split("\n\n")
    if brief:
        paragraphs = paragraphs[:1] + [part for part in paragraphs[1:] if "\n  stiction " in f"\n{part}"]
    flags = {entry.name: entry for entry in table if entry.name.startswith("--")}
    arguments = [entry for entry in table if entry.form.kind == "argument"]
    usage = " ".join([f"usage: {program}", *map(named, arguments), "[options]"])
    blocks = [usage, *(_wrapped(paragraph, width) for paragraph in paragraphs)]
    sections = {"arguments": arguments} if arguments else {}
    sections |= {title: [flags[name] for name in names] for title, names in groups.items()}
    shown = {entry.name for section in sections.values() for entry in section}
    rest = [entry for entry in flags.values() if entry.name not in shown]
    for entry in () if brief else rest:
        sections.setdefault(entry.heading, []).append(entry)
    for title, section in sections.items():
        blocks.append("\n".join([f"{title}:", *(_line(entry, brief, width) for entry in section)]))
    more = [f"{len(rest)} more options: {program} --help-all"] if brief and rest else []
    if settings := sum(not entry.name for entry in table):
        more.append(f"{settings} settings: {program} --set help")
    joined = "; ".join(more)
    blocks += [joined if len(joined) <= width else "\n".join(more)] if more else []
    return "\n\n".join(blocks)


def settings_text(table: Sequence[Entry], program: str, width: int) -> str:
    """Return the list of all settings for --set and --config: path, kind, meaning, default, flag."""
    intro = (
        f"Settings of {program}: --set PATH=VALUE, with the value as YAML has it, or a YAML file of them, nested: "
        "--config FILE. Those with a flag are given by it as well."
    )
    sections: dict[str, list[str]] = {}
    for entry in table:
        if entry.form.kind != "argument":
            default = "" if entry.default is MISSING else f" Default: {text_of(entry.default, True)}."
            flagged = f" Flag: {entry.name}." if entry.name else ""
            kinds, many = words(entry)
            left = " ".join([f"  {entry.key}", *kinds, *(["..."] if many else [])])
            text = f"{_with_choices(entry, entry.meaning.rstrip('.') + '.')}{default}{flagged}"
            sections.setdefault(entry.key.rpartition(".")[0] or "general", []).append(columns(left, text, width))
    blocks = ["\n".join([f"{title}:", *lines]) for title, lines in sections.items()]
    return "\n\n".join([_wrapped(intro, width), *blocks])


def _wrapped(paragraph: str, width: int) -> str:
    """Return a paragraph wrapped to the page; indented lines, which are commands, stay unchanged."""
    parts: list[str] = []
    for line in paragraph.split("\n"):
        if parts and not line.startswith("  ") and not parts[-1].startswith("  "):
            parts[-1] += " " + line
        else:
            parts.append(line)
    return "\n".join(part if part.startswith("  ") else textwrap.fill(part, width) for part in parts)


def _line(entry: Entry, brief: bool, width: int) -> str:
    """Return an option with its meaning in the second column."""
    text = entry.meaning
    text = _with_choices(entry, f"{sentence(text).rstrip('.')}." if brief and text else text)
    default = "" if entry.default is MISSING else text_of(entry.default)
    return columns(f"  {named(entry)}", f"{text} [{default}]" if default not in ("", "None", "False") else text, width)


def _with_choices(entry: Entry, text: str) -> str:
    """Return a text with the accepted words of an option appended, unless it names them all."""
    unsaid = [choice for choice in entry.choices if not re.search(rf"\b{re.escape(choice)}\b", text)]
    return f"{text} One of {', '.join(entry.choices)}." if unsaid else text


def columns(left: str, text: str, width: int, begin: int = LEFT) -> str:
    """Return a name with its text in a column that begins at `begin`; a long name has its text below."""
    body = textwrap.wrap(" ".join(text.split()), width - begin, break_on_hyphens=False) or [""]
    body = [" " * begin + part for part in body]
    if len(left) < begin - 1:
        return "\n".join([left.ljust(begin) + body[0].lstrip(), *body[1:]])
    return "\n".join([left, *body])


def named(entry: Entry) -> str:
    """Return an option as typed, with a word for each value; an argument in capitals, in brackets if optional."""
    kinds, many = words(entry)
    if entry.form.kind == "argument":
        name = f"{entry.name} ..." if many else entry.name
        return f"[{name}]" if many or entry.default is not MISSING else name
    if entry.switch:
        return f"{entry.name}, {entry.negative}" if entry.default is True else entry.name
    return " ".join([entry.name, *kinds, *(["..."] if many else [])])


def words(entry: Entry) -> tuple[list[str], bool]:
    """Return the kinds of an option's values, FLOAT FLOAT of a pair, and whether they may be repeated."""
    kinds, many = entry.values
    return ["WORD" if entry.choices or get_origin(kind) is Literal else _kind(kind)[0] for kind in kinds], many


def _kind(kind: Any) -> tuple[str, str, str]:
    return KINDS.get(kind, ("BOOL", "true or false", "true or false"))


def wanted(entry: Entry) -> str:
    """Return the expected value of an option in words, with its default as an example of several values."""
    kinds, many = entry.values
    if entry.choices:
        return ", ".join(entry.choices)
    _, single, several = _kind(kinds[0])
    if len(set(kinds)) > 1:
        expected = " and ".join(_kind(kind)[1] for kind in kinds) + (", any number of times" if many else "")
    elif len(kinds) > 1:
        expected = f"{COUNTS[len(kinds)]} {several}"
    else:
        expected = f"{several}, one or more" if many else single
    example = len(kinds) > 1 and entry.default not in (MISSING, None)
    return f"{expected}, such as {text_of(entry.default)}" if example else expected


def sentence(text: str) -> str:
    """Return the first sentence of a text, up to a full stop or to a semicolon outside brackets."""
    whole = " ".join(text.split())
    # Full stops in a row, of something that goes on, end no sentence.
    first = re.split(r"(?<=[^.][.;])\s", whole, maxsplit=1)[0].rstrip(";")
    return first if first.count("[") == first.count("]") else re.split(r"(?<=[^.][.])\s", whole, maxsplit=1)[0]
