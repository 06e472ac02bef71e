"""What a rule of safety found: which rule, which joint, which value, beside what it allows."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Violation:
    """One broken rule of the robot's state, of a command, or of the machine."""

    rule: str
    """Name of the rule, from `RULES` of the module that has it: `stale state`, `joint range`, ..."""
    joint: str | None
    """The joint that broke it; None where the rule is of no joint."""
    value: float
    """What was measured, in the rule's unit; NaN where that is what was measured."""
    limit: float
    """What the rule allows, in the same unit."""
    unit: str = ""
    """Of value and limit: `rad`, `rad/s`, `s`, ..."""

    def sentence(self) -> str:
        """Return the violation in one line: rule, joint, value and limit."""
        where = "" if self.joint is None else f" of {self.joint}"
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.rule}{where}: {self.value:.4g}{unit}, allowed {self.limit:.4g}{unit}"
