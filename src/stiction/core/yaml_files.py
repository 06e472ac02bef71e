"""YAML from people: small files and single values, without aliases, double keys, and numbers taken for text."""

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
"""Entries of the longest list that is read."""

EXPONENT = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$")
FLOAT = re.compile(EXPONENT.pattern + r"|[-+]?([0-9]+\.[0-9]*|\.[0-9]+|\.inf)$|\.nan$")
INTEGER = re.compile(r"[-+]?[0-9]+$")
"""Numbers as people write them: YAML 1.1 takes `1e-3` for text, `010` for 8 and `1:0` for 60."""

NUMBERS = "tag:yaml.org,2002:float", "tag:yaml.org,2002:int"


class StrictLoader(yaml.SafeLoader):
    """YAML without aliases, which can make a short file enormous, and without keys that stand twice."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Refuse an alias."""
        if self.check_event(yaml.events.AliasEvent):
            raise yaml.YAMLError("an alias (*name) is not read; write the entry out")
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        """Refuse a key that stands twice."""
        names = [self.construct_object(key, deep=True) for key, _ in node.value]
        for name in names:
            if not isinstance(name, str):
                raise yaml.YAMLError(f"the key {name!r} is no text; put it into quotes")
            if names.count(name) > 1:
                raise yaml.YAMLError(f"{name!r} stands twice")
        return super().construct_mapping(node, deep)


class SettingsLoader(StrictLoader):
    """The same, with numbers as people write them."""

    yaml_implicit_resolvers = {  # noqa: RUF012
        first: [(tag, pattern) for tag, pattern in found if tag not in NUMBERS]
        for first, found in StrictLoader.yaml_implicit_resolvers.items()
    }


SettingsLoader.add_implicit_resolver(NUMBERS[0], FLOAT, list("-+.0123456789"))
SettingsLoader.add_implicit_resolver(NUMBERS[1], INTEGER, list("-+0123456789"))
SettingsLoader.add_constructor(NUMBERS[1], lambda loader, node: int(loader.construct_scalar(node)))


def parse_yaml(text: str, where: str, kind: type[StictionError], loader: type[StrictLoader] = StrictLoader) -> Any:
    """Return the plain data of a YAML text; raise `kind`, which names `where` it stands, for another text."""
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
    """Values of others' YAML files and metadata, each checked when it is taken; `where`: file and entry, for messages.

    All methods raise `kind` for another value.
    """

    kind: type[StictionError]

    def mapping(self, value: Any, where: str) -> Mapping[str, Any]:
        """Return names with values."""
        if not isinstance(value, Mapping) or not all(isinstance(name, str) for name in value):
            what = "empty" if value is None else repr(str(value)[:60])
            raise self.kind(f"{where} is {what}; expected names with values")
        return value

    def number(self, value: Any, where: str) -> float:
        """Return a number; YAML takes `1e-3` for text, as people do not."""
        if isinstance(value, str) and EXPONENT.fullmatch(value):
            value = float(value)
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e9:
            raise self.kind(f"{where} is {str(value)[:60]!r}; expected a number")
        return float(value)

    def whole(self, value: Any, where: str) -> int:
        """Return a whole number."""
        if (found := self.number(value, where)) != int(found):
            raise self.kind(f"{where} is {found:g}; expected a whole number")
        return int(found)

    def word(self, value: Any, where: str) -> str:
        """Return a name."""
        if not isinstance(value, str) or not 0 < len(value) <= 200:
            raise self.kind(f"{where} is {str(value)[:60]!r}; expected a name")
        return value

    def choice(self, value: Any, where: str, *known: str) -> str:
        """Return one of some words."""
        if value not in known:
            raise self.kind(f"{where} is {str(value)[:60]!r}; expected {' or '.join(known)}")
        return str(value)

    def sequence(self, value: Any, where: str) -> list[Any]:
        """Return a list of a bounded length."""
        if not isinstance(value, list | tuple) or len(value) > MOST_ENTRIES:
            raise self.kind(f"{where} is {str(value)[:60]!r}; expected a list")
        return list(value)

    def names(self, value: Any, where: str) -> tuple[str, ...]:
        """Return a list of different names."""
        found = tuple(self.word(item, where) for item in self.sequence(value, where))
        if len(set(found)) != len(found):
            raise self.kind(f"{where} names one thing twice: {list(found)}")
        return found

    def numbers(self, value: Any, where: str, count: int | None = None) -> tuple[float, ...]:
        """Return a list of numbers, of `count` where that is given."""
        found = tuple(self.number(item, where) for item in self.sequence(value, where))
        if count is not None and len(found) != count:
            raise self.kind(f"{where} has {len(found)} numbers; expected {count}")
        return found
