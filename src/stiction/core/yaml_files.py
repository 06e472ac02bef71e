"""Strict YAML: small files and single values, without aliases or duplicate keys; `1e-3` is a number."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from stiction.core.errors import StictionError
from stiction.core.files import read_bounded

MOST_BYTES = 256 * 1024

MOST_ENTRIES = 8192
"""Maximum length of a list."""

EXPONENT = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$")
FLOAT = re.compile(EXPONENT.pattern + r"|[-+]?([0-9]+\.[0-9]*|\.[0-9]+|\.inf)$|\.nan$")
INTEGER = re.compile(r"[-+]?[0-9]+$")
"""Number formats of users: YAML 1.1 takes `1e-3` for text, `010` for 8 and `1:0` for 60."""

NUMBERS = "tag:yaml.org,2002:float", "tag:yaml.org,2002:int"


class StrictLoader(yaml.SafeLoader):
    """YAML without aliases, which can make a short file enormous, and without duplicate keys."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Reject an alias."""
        if self.check_event(yaml.events.AliasEvent):
            raise yaml.YAMLError("an alias (*name) is not read; write the entry out")
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        """Reject a duplicate key."""
        names = [self.construct_object(key, deep=True) for key, _ in node.value]
        for name in names:
            if not isinstance(name, str):
                raise yaml.YAMLError(f"the key {name!r} is not text; put it in quotes")
            if names.count(name) > 1:
                raise yaml.YAMLError(f"{name!r} is given twice")
        return super().construct_mapping(node, deep)


class SettingsLoader(StrictLoader):
    """Strict YAML with numbers in users' formats."""

    yaml_implicit_resolvers = {  # noqa: RUF012
        first: [(tag, pattern) for tag, pattern in resolvers if tag not in NUMBERS]
        for first, resolvers in StrictLoader.yaml_implicit_resolvers.items()
    }


SettingsLoader.add_implicit_resolver(NUMBERS[0], FLOAT, list("-+.0123456789"))
SettingsLoader.add_implicit_resolver(NUMBERS[1], INTEGER, list("-+0123456789"))
SettingsLoader.add_constructor(NUMBERS[1], lambda loader, node: int(loader.construct_scalar(node)))


def parse_yaml(text: str, where: str, kind: type[StictionError], loader: type[StrictLoader] = StrictLoader) -> Any:
    """Return the plain data of a YAML text; raise `kind`, naming `where`, for invalid text."""
    try:
        return yaml.load(text, Loader=loader)
    # The last three: a tag, such as `!!timestamp`, on a value of another form.
    except (yaml.YAMLError, RecursionError, ValueError, AttributeError, KeyError, IndexError) as error:
        raise kind(f"{where}: is not YAML: {' '.join(str(error).split())[:200]}") from error


def read_yaml(path: Path, expected: str, kind: type[StictionError], loader: type[StrictLoader] = StrictLoader) -> Any:
    """Return the plain data of a small YAML file; raise `kind` for a file that cannot be read, or is not YAML.

    expected: kind of file, for messages.
    """
    content = read_bounded(path, expected, kind, MOST_BYTES)
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise kind(f"{path}: is not YAML: {error}") from error
    return parse_yaml(text, str(path), kind, loader)


@dataclass(frozen=True)
class Values:
    """Checked access to the values of others' YAML files and metadata; `where`: file and entry, for messages.

    All methods raise `kind` for another value.
    """

    kind: type[StictionError]

    def mapping(self, value: Any, where: str) -> Mapping[str, Any]:
        """Return a mapping with names as keys."""
        if not isinstance(value, Mapping) or not all(isinstance(name, str) for name in value):
            what = "empty" if value is None else repr(str(value)[:60])
            raise self.kind(f"{where} is {what}; expected names with values")
        return value

    def number(self, value: Any, where: str) -> float:
        """Return a number, also from text such as `1e-3`."""
        if isinstance(value, str) and EXPONENT.fullmatch(value):
            value = float(value)
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e9:
            raise self.kind(f"{where} is {str(value)[:60]!r}; expected a number")
        return float(value)

    def whole(self, value: Any, where: str) -> int:
        """Return a whole number."""
        if (number := self.number(value, where)) != int(number):
            raise self.kind(f"{where} is {number:g}; expected a whole number")
        return int(number)

    def word(self, value: Any, where: str) -> str:
        """Return a name."""
        if not isinstance(value, str) or not 0 < len(value) <= 200:
            raise self.kind(f"{where} is {str(value)[:60]!r}; expected a name")
        return value

    def choice(self, value: Any, where: str, *known: str) -> str:
        """Return one of several words."""
        if value not in known:
            raise self.kind(f"{where} is {str(value)[:60]!r}; expected {' or '.join(known)}")
        return str(value)

    def sequence(self, value: Any, where: str) -> list[Any]:
        """Return a list of a bounded length."""
        if not isinstance(value, list | tuple) or len(value) > MOST_ENTRIES:
            raise self.kind(f"{where} is {str(value)[:60]!r}; expected a list")
        return list(value)

    def names(self, value: Any, where: str) -> tuple[str, ...]:
        """Return a list of distinct names."""
        names = tuple(self.word(item, where) for item in self.sequence(value, where))
        if len(set(names)) != len(names):
            raise self.kind(f"{where} has a duplicate name: {list(names)}")
        return names

    def numbers(self, value: Any, where: str, count: int | None = None) -> tuple[float, ...]:
        """Return a list of numbers, `count` of them unless None."""
        numbers = tuple(self.number(item, where) for item in self.sequence(value, where))
        if count is not None and len(numbers) != count:
            raise self.kind(f"{where} has {len(numbers)} numbers; expected {count}")
        return numbers
