"""The family of errors that a user can act on, and the sentence for a name that there is not."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from typing import Any

UNSAFE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ud800-\udfff]")
"""Characters that steer a terminal, hide, turn the direction of the text, or are none at all."""


def escaped(text: str) -> str:
    """Return a text whose `UNSAFE` characters are written out, as JSON does: what a file says must not do anything."""
    return UNSAFE.sub(lambda found: json.dumps(found[0])[1:-1], text)


def one_line(text: str) -> str:
    """Return a text with every unprintable character written out, line breaks among them."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


class StictionError(Exception):
    """A failure that the user can act on: what came, what was expected, what to do, in one line.

    The command line prints the message on standard error and exits with status 1. Unprintable characters, such as of a
    name in a file, are escaped.
    """

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


class ConfigurationError(StictionError):
    """Raised for options or settings that cannot be run, contradict each other, or name what there is not."""


class FileError(StictionError):
    """Raised for a file or folder that cannot be read or written, or does not hold what was asked of it."""


class UnwrittenError(FileError):
    """Raised for a file or folder that cannot be written; what it held before is unchanged."""


class LogError(FileError):
    """Raised for a log, of joints or of a walk, that cannot be read or does not hold what was asked of it."""


class BundleError(FileError):
    """Raised for a policy bundle that is incomplete, damaged or altered, in any of its files."""


class PolicyError(StictionError):
    """Raised for a policy that cannot act as asked: its network fails, or its inputs are none to act on."""


class RobotError(StictionError):
    """Raised for a robot that is unknown, contradicts itself, or is not the one that was expected."""


class EngineError(StictionError):
    """Raised for a physics engine or renderer that is unknown, is not installed, cannot do this, or gave up."""


class TrainingError(StictionError):
    """Raised for a training run that diverged, was stopped, is not finished, or cannot be continued."""


MOST_NAMES = 24
"""Names that a message lists: the joints of a legged robot, and kinds of them."""


SIMILAR = 0.6
"""Least similarity of a word and a slip of it, by difflib and without the dashes of flags."""


def nearest(word: str, known: Iterable[str]) -> str:
    """Return `; did you mean 'hip'?` with the nearest of the known words, nothing where none is near."""
    found = closest(word, known)
    return "" if found is None else f"; did you mean {found!r}?"


def closest(word: str, known: Iterable[str]) -> str | None:
    """Return the nearest of the known words, None where none is near."""
    names, bare = {name.lstrip("-"): name for name in known}, word.lstrip("-")
    # Letters of the wrong case are no near match to difflib where a word is short.
    same = [name for name in names if name.lower() == bare.lower()]
    found = same or get_close_matches(bare, names, n=1, cutoff=SIMILAR)
    return names[found[0]] if found else None


def unknown_name(what: str, name: str, known: Iterable[str]) -> str:
    """Return the message for an unknown name of a kind of thing (`what`: such as `robot`), with the nearest."""
    names = list(known)
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    listed = ", ".join(names[:MOST_NAMES]) or "none"
    return f"unknown {what} {name!r}{nearest(name, names) or ';'} known: {listed}{more}"


def if_per_cent(level: float) -> str:
    """Return the question whether a level, which is a share, was meant in per cent; empty where it hardly was."""
    return f"; is {level:g} % meant? use {level / 100:g}" if 1.0 < level <= 100.0 else ""


def check_once(what: str, given: Sequence[Any], least: int = 1, same: Callable[[Any], Any] = lambda one: one) -> None:
    """Raise `ConfigurationError` where something was given twice, or there are less than `least`, 0 or 1.

    what: such as `levels`; same: of what was given, what it means, where that can be said in two ways.
    """
    if len({same(one) for one in given}) < len(given) or len(given) < least:
        few = "at least one, " if least else ""
        raise ConfigurationError(f"{what} {' '.join(map(str, given)) or 'none'}: expected {few}each once")
