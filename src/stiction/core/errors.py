"""User-facing exceptions, and the "unknown name; did you mean …?" message."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from typing import Any

UNSAFE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ud800-\udfff]")
"""Characters that steer a terminal, are invisible, turn the direction of the text, or are not assigned."""


def escaped(text: str) -> str:
    """Return a text with its `UNSAFE` characters written out, as in JSON: no file may steer the terminal."""
    return UNSAFE.sub(lambda match: json.dumps(match[0])[1:-1], text)


def one_line(text: str) -> str:
    """Return a text with every unprintable character written out, line breaks among them."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


class StictionError(Exception):
    """Failure that the user can act on, in one line: what came, what was expected, what to do.

    The command line prints the message on standard error and exits with status 1. Unprintable characters, for example
    in a name read from a file, are escaped.
    """

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


class ConfigurationError(StictionError):
    """Options or settings that cannot be run, contradict each other, or name something unknown."""


class FileError(StictionError):
    """File or folder that cannot be read or written, or lacks the expected content."""


class UnwrittenError(FileError):
    """File or folder that cannot be written; its content is unchanged."""


class LogError(FileError):
    """Log of joints or of a walk that cannot be read, or lacks the expected content."""


class BundleError(FileError):
    """Policy bundle that is incomplete, damaged or altered, in any of its files."""


class PolicyError(StictionError):
    """Policy that cannot act: its network fails, or its inputs are not valid."""


class RobotError(StictionError):
    """Robot that is unknown, contradicts itself, or is not the expected one."""


class EngineError(StictionError):
    """Physics engine or renderer that is unknown, not installed, unable to do this, or failed."""


class TrainingError(StictionError):
    """Training run that diverged, was stopped, is not finished, or cannot be continued."""


MOST_NAMES = 24
"""Maximum number of names in a message: the joints of a legged robot, and kinds of them."""


SIMILAR = 0.6
"""Minimum similarity of a misspelt word, by difflib and without the dashes of flags."""


def nearest(word: str, known: Iterable[str]) -> str:
    """Return `; did you mean 'hip'?` with the nearest of the known words, or an empty text."""
    match = closest(word, known)
    return "" if match is None else f"; did you mean {match!r}?"


def closest(word: str, known: Iterable[str]) -> str | None:
    """Return the nearest of the known words, or None."""
    names, bare = {name.lstrip("-"): name for name in known}, word.lstrip("-")
    # Letters of the wrong case are no near match to difflib where a word is short.
    same = [name for name in names if name.lower() == bare.lower()]
    matches = same or get_close_matches(bare, names, n=1, cutoff=SIMILAR)
    return names[matches[0]] if matches else None


def unknown_name(what: str, name: str, known: Iterable[str]) -> str:
    """Return the message for an unknown name of a kind (`what`: such as `robot`), with the nearest known one."""
    names = list(known)
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    listed = ", ".join(names[:MOST_NAMES]) or "none"
    return f"unknown {what} {name!r}{nearest(name, names) or ';'} known: {listed}{more}"


def if_per_cent(level: float) -> str:
    """Return the question whether a level, which is a share, was meant in per cent; empty where it hardly was."""
    return f"; is {level:g} % meant? use {level / 100:g}" if 1.0 < level <= 100.0 else ""


def check_once(
    what: str, values: Sequence[Any], least: int = 1, same: Callable[[Any], Any] = lambda value: value
) -> None:
    """Raise `ConfigurationError` for values given twice, or for fewer than `least` of them, 0 or 1.

    what: name of the option, such as `levels`; same: function that maps spellings of one value to the same key.
    """
    if len({same(value) for value in values}) < len(values) or len(values) < least:
        few = "at least one, " if least else ""
        raise ConfigurationError(f"{what}: got {' '.join(map(str, values)) or 'none'}, expected {few}each once")
