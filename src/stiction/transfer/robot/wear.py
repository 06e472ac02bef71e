"""How friction grows while a robot walks: of one joint, of a kind, or of all."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stiction.formats.errors import StictionError

SEALS_OUT = 0.3
"""What is left of a joint's friction without its seals, by the paper's measurement [1]."""


@dataclass(frozen=True)
class Wear:
    """A factor on some joints' dry friction that grows by equal ratios: 0.3 to 0.6 takes as long as 1 to 2."""

    joints: tuple[str, ...] = ()
    """Names of joints (`FL_shank`) or kinds (`shank`); none: all. The others keep the factor 1."""
    start: float = SEALS_OUT
    """Factor at the beginning [1]."""
    end: float = 3.0
    """Factor from `seconds` on [1]."""
    seconds: float = 60.0
    """Time from `start` to `end` [s]: years, squeezed into a run."""

    def __post_init__(self) -> None:
        """Refuse factors that are none."""
        numbers = (self.start, self.end, self.seconds)
        if not all(0 < number < math.inf for number in numbers):
            raise StictionError(
                f"wear from x{self.start} to x{self.end} in {self.seconds} s: expected three positive numbers"
            )

    def factor(self, time: float) -> float:
        """Return the factor of the worn joints at a time since the beginning [s]."""
        reached = min(max(time / self.seconds, 0.0), 1.0)
        return self.start * (self.end / self.start) ** reached

    def worn(self, joint_names: tuple[str, ...]) -> np.ndarray:
        """Return which joints wear, bool, shape (J,).

        Raises:
            StictionError: `joints` names what the robot does not have.

        """
        of_kind = {name: name.rpartition("_")[2] for name in joint_names}
        known = {*of_kind, *of_kind.values()}
        if unknown := sorted(set(self.joints) - known):
            raise StictionError(f"wear of {unknown[0]!r}: expected some of {', '.join(sorted(known))}")
        return np.array([not self.joints or bool({name, of_kind[name]} & set(self.joints)) for name in joint_names])
