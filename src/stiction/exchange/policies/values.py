"""Values of others' settings and metadata of policies: additions to those of every YAML file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from stiction.core.errors import FileError
from stiction.core.yaml_files import Values
from stiction.robots.description import check_pattern


class PolicyValues(Values):
    """Values of a policy, one number of which may stand for all joints."""

    def one_or_all(self, value: Any, where: str) -> float | tuple[float, ...]:
        """Return one number, or a list of them; a list of one number over and over is that number."""
        if not isinstance(value, list):
            return self.number(value, where)
        values = self.numbers(value, where)
        return values[0] if values and len(set(values)) == 1 else values

    def by_joint(self, value: Any, where: str) -> float | tuple[float, ...] | dict[str, float]:
        """Return a number, a list of them, or regular expressions of joints with numbers."""
        if isinstance(value, Mapping):
            entries = self.mapping(value, where).items()
            return {
                check_pattern(pattern, where): self.number(item, f"{where}: {pattern}") for pattern, item in entries
            }
        return self.numbers(value, where) if isinstance(value, list) else self.number(value, where)

    def bounds(self, value: Any, where: str) -> tuple[float, float] | None:
        """Return lowest and highest value of a clip: a list of two, or the symmetric bound; None where it is null."""
        if value is None or value == "none":
            return None
        if isinstance(value, list):
            low, high = self.numbers(value, where, 2)
            return low, high
        high = self.number(value, where)
        return -high, high

    def infinite(self, text: str, where: str) -> float:
        """Return a number of text in metadata, where infinite ones are allowed."""
        try:
            number = float(text)
        except ValueError as error:
            raise self.kind(f"{where} is {text[:60]!r}; expected a number") from error
        if math.isnan(number):
            raise self.kind(f"{where} is not a number; expected one")
        return number


take = PolicyValues(FileError)
