"""YAML from people: small files and single values, without aliases, double keys, and numbers taken for text."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from stiction.core.errors import StictionError
from stiction.core.files import read_bounded

MOST_BYTES = 256 * 1024

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
