"""From the words of a command line to its options: one door for every verb, its help, and one line for what is wrong.

tyro reads the words, from the fields of a dataclass. Its help is a page of boxes in which nobody finds the few options
that are needed, and its errors are boxes too: both are said here as the rest of the program speaks.
"""

from __future__ import annotations

import argparse
import io
import re
import shutil
import sys
import textwrap
import warnings
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr
from typing import Any, NoReturn, TypeVar

import tyro

from stiction.core.effects import check_effects
from stiction.core.errors import escaped, nearest

Options = TypeVar("Options")

Groups = Mapping[str, Sequence[str]]
"""Heading -> the options that people use, `--out`, in the order in which `--help` shows them."""

HELP, HELP_ALL = ("-h", "--help"), "--help-all"
"""Words that ask for help: with the options that people use, and with all of them."""

WIDEST, LEFT = 120, 30
"""Columns of a help page, and those of an option's name in it."""

RULE = re.compile("[-─]{5,}")
"""A line that tyro draws within the box of an error; behind it stand hints."""


def read_options(
    kind: type[Options],
    arguments: Sequence[str],
    program: str,
    description: str,
    default: Options | None = None,
    groups: Groups | None = None,
) -> Options:
    """Return the options that the words of a command line say.

    kind: dataclass of the options, a field each; program: words before the arguments, `stiction train`; description:
    what it does, in paragraphs, one of them with examples, in indented lines; default: options from which unsaid ones
    are taken; groups: options that `--help` shows, all of them without.

    Raises:
        ConfigurationError: an option lacks another one that it requires, or two exclude each other (`core.effects`).
        SystemExit: help was asked for and printed (status 0), or the words are wrong, which one line on standard error
            says (status 2).

    """
    extra: dict[str, Any] = {} if default is None else {"default": default}
    asked = [word for word in arguments if word in (*HELP, HELP_ALL)]
    if asked:
        parser = _parser(kind, program, extra)
        brief = None if HELP_ALL in asked else groups
        width = min(WIDEST, shutil.get_terminal_size().columns)
        print(help_text(parser, program, description, groups or {}, brief is not None, width))
        raise SystemExit(0)
    if twice := _repeated(kind, arguments, program, extra):
        refuse(program, f"{twice}; say it once")
    said = io.StringIO()
    try:
        with redirect_stderr(said):
            options = tyro.cli(kind, args=arguments, prog=program, **extra)
    except SystemExit as stop:
        # Not wrong: tyro was asked for a shell's completions, has printed them and ends.
        if not stop.code:
            raise
        refuse(program, _wrong(_parser(kind, program, extra), arguments, said.getvalue()))
    # The parser takes a while to make, and hardly anybody says nothing.
    empty = any(not word.partition("=")[2] and word[-1:] in ("", "=") for word in arguments)
    if empty and (name := _empty_path(_parser(kind, program, extra), arguments)):
        refuse(program, f"{name} '': expected a path, and the empty one would be the folder that you are in")
    check_effects(options, default)
    return options


def refuse(program: str, what: str) -> NoReturn:
    """Say in one line what is wrong with a command line, and end with status 2."""
    end = "" if what.endswith("?") else ";"
    print(f"{program}: {escaped(what)}{end} `{program} --help` shows the usage", file=sys.stderr)
    raise SystemExit(2)


def _parser(kind: type[Any], program: str, extra: dict[str, Any]) -> argparse.ArgumentParser:
    """Return the options as an argparse parser, the only form in which tyro exposes them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        parser: Any = tyro.extras.get_parser(kind, prog=program, **extra)
        return parser


def _repeated(kind: type[Any], arguments: Sequence[str], program: str, extra: dict[str, Any]) -> str | None:
    """Return the option that is given twice, of which tyro would silently ignore one; None without any."""
    names = [word.partition("=")[0].replace("_", "-") for word in arguments if word.startswith("--")]
    own: Mapping[str, str] = {}
    if any("." in name for name in names):
        # Only options of nested settings have a second, shorter name.
        parser = _parser(kind, program, extra)
        own = {name: action.dest for action in parser._actions for name in action.option_strings}
    seen: dict[str, str] = {}
    for name in names:
        option = own.get(name, name)
        if option in seen:
            before = seen[option]
            return f"{name} is given twice" if before == name else f"{before} and {name} are one option, given twice"
        seen[option] = name
    return None


def _empty_path(parser: argparse.ArgumentParser, arguments: Sequence[str]) -> str | None:
    """Return the option or argument that is given an empty path, as of a shell's variable that is not set; or None."""
    known = {name: action for action in parser._actions for name in action.option_strings}
    owner: argparse.Action | None = None
    for word in arguments:
        name, equals, value = word.partition("=")
        if word.startswith("--"):
            owner = known.get(name.replace("_", "-"))
            if value or not equals:
                continue
        elif word:
            continue
        free = owner is None or not _values(owner)[0]
        named = [action for action in parser._actions if not action.option_strings] if free else [owner]
        for action in named:
            if action is not None and "PATH" in _values(action)[0]:
                return name if equals else _name(action).split()[0].strip("[]")
    return None


def _wrong(parser: argparse.ArgumentParser, arguments: Sequence[str], said: str) -> str:
    """Return what is wrong with the arguments, in a line. said: what tyro printed of it, in its box."""
    text = _plain(said)
    known = {name: action for action in parser._actions for name in action.option_strings}
    named = {action.dest: action for action in parser._actions} | known
    names = [word.partition("=")[0].replace("_", "-") for word in arguments]
    # First: of a required option that is misspelt tyro says above all that it is missing.
    for name in names:
        if name.startswith("--") and name not in known:
            return f"unknown option {name}{nearest(name, known)}"
    if found := re.match(r"invalid choice '(.*?)' for argument '([\w.-]+)", text):
        value, name = found.groups()
        action = named[name]
        choices = _choices(action)
        name = name if name in known else _name(action).strip("[]")
        return f"{name} {value!r}; expected {', '.join(choices)}{nearest(value, choices)}"
    if found := re.match(r"(?:Error parsing|Missing value for argument) '?([\w.-]+)", text):
        taking = named.get(found[1])
        typed = [name for name in names if taking is not None and name in taking.option_strings]
        name, wanted = (typed or [found[1]])[0], _wanted(taking)
        words = _given(arguments, name)
        return (
            f"{name} {' '.join(words)!r}: expected {wanted}"
            if words
            else f"{name}: a value is missing; expected {wanted}"
        )
    if text.startswith("Missing from"):
        lacking = {word for line in said.splitlines() for word in line.strip("│| ").split()[:1]}
        missing = [action for action in parser._actions if action.required and _heading(action) in lacking]
        if missing:
            return "; ".join(
                f"{_name(action)} is missing: {_sentence(_meaning(action)[0]).rstrip('.')}" for action in missing
            )
    if text.startswith("Unrecognized"):
        return f"{text.partition(': ')[2]}: a word that no option takes"
    return text or "the options cannot be read"


def _heading(action: argparse.Action) -> str:
    """Return the word by which tyro heads what it says of a missing option; an argument has the name of its kind."""
    return action.option_strings[0] if action.option_strings else str(action.metavar).split()[0]


def _plain(said: str) -> str:
    """Return the message of an error of tyro, without its title, its box and the hints after it."""
    lines: list[str] = []
    for line in said.splitlines()[1:]:
        bare = line.strip().strip("│|").strip()
        if RULE.fullmatch(bare) and lines:
            break
        if not RULE.fullmatch(bare) and not bare.startswith(("╰", "+")):
            lines.append(bare)
    return " ".join(lines)


def _given(arguments: Sequence[str], name: str) -> list[str]:
    """Return the words that were given to an option."""
    words: list[str] = []
    taken = False
    for word in arguments:
        option, equals, value = word.partition("=")
        if word.startswith("--"):
            taken = option.replace("_", "-") == name
            words += [value] if taken and equals else []
        elif taken:
            words.append(word)
    return words


def _choices(action: argparse.Action) -> list[str]:
    """Return the words that an option takes, in their order; none where it takes any."""
    found = re.search(r"\{([^{}]*,[^{}]*)\}", str(action.metavar or "")) if action.choices else None
    return [word for word in found[1].split(",") if word != "None"] if found else []


def _values(action: argparse.Action) -> tuple[list[str], bool]:
    """Return the kinds of an option's values, FLOAT FLOAT of a pair, and whether they may come any number of times."""
    metavar = str(action.metavar or "").replace("{None}|", "")
    first = metavar.lstrip("[").split(" [")[0]
    return ["WORD"] if _choices(action) else first.strip("[]{}").split(), metavar.endswith(" ...]]")


KINDS = {
    "INT": ("a whole number", "whole numbers"),
    "FLOAT": ("a number", "numbers"),
    "STR": ("a word", "words"),
    "PATH": ("a path", "paths"),
}
"""Kind of value, as tyro writes it -> what it is called, one and several."""

COUNTS = ("no", "one", "two", "three", "four")
"""Small numbers in words."""


def _wanted(action: argparse.Action | None) -> str:
    """Return what an option expects, in words, with its default as an example where there are several values."""
    kinds, many = ([], False) if action is None else _values(action)
    if action is None or not kinds:
        return "a value"
    single, several = KINDS.get(kinds[0], (kinds[0], kinds[0]))
    if len(set(kinds)) > 1:
        wanted = " and ".join(KINDS.get(kind, (kind,))[0] for kind in kinds) + (", any number of times" if many else "")
    elif len(kinds) > 1:
        wanted = f"{COUNTS[len(kinds)]} {several}"
    else:
        wanted = f"{several}, one or more" if many else single
    default = _meaning(action)[1]
    return f"{wanted}, such as {default}" if len(kinds) > 1 and default not in ("", "None") else wanted


def help_text(
    parser: argparse.ArgumentParser, program: str, description: str, groups: Groups, brief: bool, width: int
) -> str:
    """Return the help of a program: what it does, examples, its options.

    brief: the groups alone, a sentence an option, and of the description the first paragraph and the examples.
    """
    actions = {name: action for action in parser._actions for name in action.option_strings}
    paragraphs = description.strip().split("\n\n")
    if brief:
        paragraphs = [one for index, one in enumerate(paragraphs) if not index or "\n  stiction " in f"\n{one}"]
    positional = [action for action in parser._actions if not action.option_strings]
    usage = " ".join([f"usage: {program}", *map(_name, positional), "[options]"])
    blocks = [usage, *(_wrapped(one, width) for one in paragraphs)]
    sections = {"arguments": positional} if positional else {}
    sections |= {title: [actions[name] for name in names] for title, names in groups.items()}
    shown = {id(action) for section in sections.values() for action in section}
    rest = [action for action in actions.values() if id(action) not in shown and "-h" not in action.option_strings]
    if not brief:
        for group in parser._action_groups:
            members = [action for action in group._group_actions if any(action is one for one in rest)]
            if members:
                sections[str(group.title).replace("task.", "").replace("options", "").strip() or "options"] = members
    for title, section in sections.items():
        lines = [_line(action, brief, width) for action in section if _meaning(action)[0] != argparse.SUPPRESS]
        blocks.append("\n".join([f"{title}:", *lines]))
    count = len({id(action) for action in rest})
    if brief and count:
        blocks.append(f"{count} more options: {program} {HELP_ALL}")
    return "\n\n".join(blocks)


def _wrapped(paragraph: str, width: int) -> str:
    """Return a paragraph as wide as the page; indented lines, which are commands, stay as they are."""
    parts: list[str] = []
    for line in paragraph.split("\n"):
        if parts and not line.startswith("  ") and not parts[-1].startswith("  "):
            parts[-1] += " " + line
        else:
            parts.append(line)
    return "\n".join(part if part.startswith("  ") else textwrap.fill(part, width) for part in parts)


def _line(action: argparse.Action, brief: bool, width: int) -> str:
    """Return an option with what it means, the text in a column of its own."""
    text, default = _meaning(action)
    text = " ".join((f"{_sentence(text).rstrip('.')}." if brief and text else text).split())
    choices = _choices(action)
    unsaid = [choice for choice in choices if not re.search(rf"\b{re.escape(choice)}\b", text)]
    if unsaid:
        text += f" One of {', '.join(choices)}."
    if default not in ("", "None", "False"):
        text += f" [{default}]"
    left = f"  {_name(action)}"
    body = textwrap.wrap(text, width - LEFT, break_on_hyphens=False) or [""]
    body = [" " * LEFT + part for part in body]
    if len(left) < LEFT - 1:
        return "\n".join([left.ljust(LEFT) + body[0].lstrip(), *body[1:]])
    return "\n".join([left, *body])


def _name(action: argparse.Action) -> str:
    """Return an option as it is typed, with a word for each value; an argument in capitals, in brackets if optional."""
    kinds, many = _values(action)
    if not action.option_strings:
        kind = "" if not kinds or _choices(action) else kinds[0]
        name = action.dest.rpartition(".")[2].replace("-", "_").upper() if kind in ("PATH", "STR", "") else kind
        return f"[{name} ...]" if action.nargs in ("*", "+") else f"[{name}]" if action.nargs == "?" else name
    name = next(iter(action.option_strings))
    if _meaning(action)[1] == "True":
        name = ", ".join(action.option_strings)
    return " ".join([name, *kinds, *(["..."] if many else [])])


def _meaning(action: argparse.Action) -> tuple[str, str]:
    """Return what an option means, and its default."""
    text = str(action.help or "").replace("%%", "%")  # argparse would expand a single one
    found = re.search(r"\s*\((?:default: (.*?)|required|optional)\)\s*$", text, re.DOTALL)
    return (text[: found.start()], (found[1] or "").strip()) if found else (text, "")


def _sentence(text: str) -> str:
    """Return the first sentence of a text, up to a full stop or to a semicolon outside brackets."""
    whole = " ".join(text.split())
    # Full stops in a row, of something that goes on, end no sentence.
    first = re.split(r"(?<=[^.][.;])\s", whole, maxsplit=1)[0].rstrip(";")
    return first if first.count("[") == first.count("]") else re.split(r"(?<=[^.][.])\s", whole, maxsplit=1)[0]
