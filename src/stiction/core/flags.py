"""How the fields of an options dataclass are given: as arguments, as flags, or as settings, `--set path=value`.

bundle: Annotated[Path, ARGUMENT]                           the word BUNDLE
seconds: float = 2.0                                        --seconds
method: Annotated[str, flag("--method")]                    of a nested group, by this name
iterations: Annotated[int, FLAG] = 700                      of the nested group `teacher`, --teacher.iterations
gamma: float = 0.99                                         of the nested group `teacher`, --set teacher.gamma=0.98
cutoff: Annotated[float | None, SETTING] = None             --set cutoff=20
config: Annotated[TrainCfg, FLAT]                           its fields are those of the verb
"""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

NO_PATH = "expected a path, and the empty one would be the folder that you are in"
"""Cause of an error: `--out "$FOLDER"` with a variable that is not set."""


@dataclass(frozen=True)
class Form:
    """Form of a field on the command line."""

    kind: Literal["flag", "argument", "setting", "flat", "fixed"]
    """`flat`: the fields of this group appear at the level of the group; `fixed`: not settable."""
    name: str = ""
    """Name of a flag, `--method`; by default the path of the field."""
    help: str = ""
    """Meaning; by default the docstring of the field."""
    choices: Callable[[], Sequence[str]] | None = None


FLAG, ARGUMENT, SETTING, FLAT, FIXED = (Form("flag"), Form("argument"), Form("setting"), Form("flat"), Form("fixed"))


def flag(name: str = "", help: str = "", choices: Callable[[], Sequence[str]] | None = None) -> Form:
    """Return the form of a flag; the arguments are those of `Form`."""
    return Form("flag", name, help, choices)


@dataclass(frozen=True)
class Entry:
    """Field of options, nested or not, that can be set."""

    path: str
    """Path of attributes."""
    key: str
    """Name for --set: the path without flat groups."""
    name: str
    """`--seconds` for a flag, `BUNDLE` for an argument, empty for a setting."""
    form: Form
    kind: Any
    owner: type
    default: Any
    """Default value; `MISSING` for a required field."""

    @property
    def typed(self) -> str:
        """Entry as it is typed, without a value."""
        return self.name or f"--set {self.key}"

    @property
    def negative(self) -> str:
        """Opposite of a switch, `--task.no-log` of `--task.log`."""
        group, dot, last = self.name.removeprefix("--").rpartition(".")
        return f"--{group}{dot}no-{last}"

    @property
    def heading(self) -> str:
        """Heading of its group in the help."""
        return self.key.rpartition(".")[0].removeprefix("task.") or "options"

    @property
    def meaning(self) -> str:
        """Documentation, with the unit."""
        return self.form.help or documentation(self.owner).get(self.path.rpartition(".")[2], "")

    @property
    def choices(self) -> list[str]:
        """Accepted words; empty where any word is accepted."""
        kinds = self.values[0]
        if self.form.choices is not None:
            return [*self.form.choices()]
        if get_origin(kinds[0]) is Literal:
            return [str(word) for word in get_args(kinds[0])]
        return ["True", "False"] if kinds[0] is bool and not self.switch else []

    @property
    def values(self) -> tuple[list[Any], bool]:
        """Types of the words of its value, and whether they may be repeated."""
        kind = optional(self.kind)[0]
        if get_origin(kind) is not tuple:
            return [kind], False
        inner = get_args(kind)
        if inner[-1] is not Ellipsis:
            return [*inner], False
        return [*get_args(inner[0])] if get_origin(inner[0]) is tuple else [inner[0]], True

    @property
    def switch(self) -> bool:
        """True if it is a flag without a value, `--log` or `--no-log`."""
        return self.kind is bool


def optional(kind: Any) -> tuple[Any, bool]:
    """Return a type without None, and whether None was in it."""
    if get_origin(kind) not in (Union, UnionType):
        return kind, False
    return next(part for part in get_args(kind) if part is not type(None)), type(None) in get_args(kind)


def default_of(field: Field[Any]) -> Any:
    """Return the default of a field, or `MISSING`."""
    return field.default if field.default_factory is MISSING else field.default_factory()


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind, include_extras=True)


def entries(kind: type, options: Any = MISSING) -> list[Entry]:
    """Return all settable fields of an options dataclass, nested ones included, in their order.

    options: instance that holds the defaults; without it, those of the fields.
    """
    return [*_entries(kind, options, "", "", True)]


def _entries(kind: type, options: Any, path: str, key: str, flat: bool) -> Iterator[Entry]:
    """Yield the fields at and under a place. flat: fields are flags unless they declare another form."""
    for field in fields(kind):
        hint = _hints(kind)[field.name]
        form = next((item for item in getattr(hint, "__metadata__", ()) if isinstance(item, Form)), None)
        plain = get_args(hint)[0] if get_origin(hint) is Annotated else hint
        default = default_of(field) if options is MISSING else getattr(options, field.name)
        place = f"{path}{field.name}"
        if form is FIXED:
            continue
        if is_dataclass(plain):
            below = key if form is FLAT else f"{key}{field.name}."
            yield from _entries(plain, default, f"{place}.", below, flat and form is FLAT)  # type: ignore[arg-type]
            continue
        form, full_key = form or (FLAG if flat else SETTING), f"{key}{field.name}"
        named = {"flag": f"--{full_key.replace('_', '-')}", "argument": field.name.upper(), "setting": ""}
        yield Entry(place, full_key, form.name or named[form.kind], form, plain, kind, default)


@cache
def documentation(kind: type) -> dict[str, str]:
    """Return the docstrings of a dataclass's fields, inherited ones included; empty without its source."""
    docs: dict[str, str] = {}
    for part in reversed(kind.__mro__[:-1]):
        body = _classes(part.__module__).get(part.__qualname__, [])
        for statement, after in pairwise(body):
            if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
                docstring = after.value if isinstance(after, ast.Expr) else None
                if isinstance(docstring, ast.Constant) and isinstance(docstring.value, str):
                    docs[statement.target.id] = inspect.cleandoc(docstring.value)
    return docs


@cache
def _classes(module: str) -> dict[str, list[ast.stmt]]:
    try:
        tree = ast.parse(inspect.getsource(sys.modules[module]))
    except (OSError, KeyError, TypeError):
        return {}
    return {node.name: node.body for node in tree.body if isinstance(node, ast.ClassDef)}


def convert(entry: Entry, words: Sequence[str]) -> Any:
    """Return the value of an entry from words; raise `ValueError` for words of another kind.

    The error has no text unless its cause is other than the kind.
    """
    kind, may_lack = optional(entry.kind)
    if may_lack and [*words] == ["None"]:
        return None
    kinds, many = entry.values
    if get_origin(kind) is tuple and {*kinds} <= {int, float}:
        # People write lists with commas, too: 0,0.1,0.2 or 0, 0.1, 0.2.
        words = [part for word in words for part in word.removesuffix(",").split(",")]
    if not words or (len(words) % len(kinds) if many else len(words) != len(kinds)):
        raise ValueError
    values = tuple(_scalar(kinds[number % len(kinds)], word) for number, word in enumerate(words))
    if get_origin(kind) is not tuple:
        return values[0]
    if many and len(kinds) > 1:
        return tuple(values[begin : begin + len(kinds)] for begin in range(0, len(values), len(kinds)))
    return values


def _scalar(kind: Any, word: str) -> Any:
    if kind is Path and not word:
        raise ValueError(NO_PATH)
    if get_origin(kind) is not Literal and kind is not bool:
        return kind(word)
    matches = [choice for choice in get_args(kind) or (True, False) if str(choice) == word]
    if not matches:
        raise ValueError
    return matches[0]


def text_of(value: Any, setting: bool = False) -> str:
    """Return a value as typed after a flag, or after `--set path=`."""
    if isinstance(value, tuple):
        return f"[{','.join(text_of(part, True) for part in value)}]" if setting else " ".join(map(text_of, value))
    plain = {None: "null", True: "true", False: "false"}
    return plain[value] if setting and isinstance(value, bool | None) else str(value)


def assignment(kind: type, path: str, value: Any) -> str:
    """Return a field as typed: `--method direct`, or `--set teacher.gamma=0.98`. path: from `kind` on."""
    entry = next(entry for entry in entries(kind) if entry.path == path)
    return f"{entry.name} {text_of(value)}" if entry.name else f"{entry.typed}={text_of(value, True)}"
