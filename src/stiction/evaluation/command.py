"""Commands that a policy was trained for, and the start of a walk that is not measured. No simulator."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from stiction.files.velocity import AXES, Command

if TYPE_CHECKING:
    from stiction.files.contract import Contract

SETTLE = 2.0
"""What is not measured at the start of a walk [s]: the robot gets up to speed."""


def untrained(commands: Iterable[Command], contract: Contract) -> str:
    """Return which of the commands a policy was not trained for, and what it was; nothing where it was for all."""
    # Not above: who only reads commands, such as a study's options, loads no runtime.
    from stiction.deploy.plausibility import command_range

    low, high = command_range(contract)
    beyond = [one.label for one in commands if not ((low <= one.velocity) & (one.velocity <= high)).all()]
    spans = ", ".join(f"{axis} {a:g} to {b:g}" for axis, a, b in zip(AXES, low, high, strict=True))
    return f"command {', '.join(beyond)}: the policy was trained for {spans}" if beyond else ""
