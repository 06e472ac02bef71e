"""Dry friction of a joint, and the two numbers that say how large it is.

The paper writes f = −b_c sign(θ') and leaves θ' = 0 open. Here friction at rest takes whatever value holds the joint,
up to a limit: that is what makes it *static* friction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stiction.formats.errors import StictionError


class FrictionLaw(Protocol):
    """What a simulator asks of a friction law: how much holds a joint at rest, and how much brakes it in motion."""

    @property
    def breakaway(self) -> float:
        """Largest torque that friction holds at rest [N m]."""
        ...

    def sliding(self, velocity: np.ndarray) -> np.ndarray:
        """Return the size of the friction torque at a velocity that is not zero [N m], not negative."""
        ...


@dataclass(frozen=True)
class Coulomb:
    """The same friction at every speed, and up to as much at rest."""

    level: float
    """b_c [N m]."""

    def __post_init__(self) -> None:
        """Refuse friction that would drive the joint."""
        if not self.level >= 0:
            raise StictionError(f"Coulomb friction {self.level}: expected a number that is not negative")

    @property
    def breakaway(self) -> float:
        """Coulomb's law makes no difference between rest and motion."""
        return self.level

    def sliding(self, velocity: np.ndarray) -> np.ndarray:
        """Return b_c at every speed."""
        return np.full(np.shape(velocity), self.level)


def friction_torque(law: FrictionLaw, velocity: np.ndarray, applied: np.ndarray) -> np.ndarray:
    """Return f of I q'' + B q' = τ + f [N m]: against the motion, or at rest against what is applied.

    velocity: θ' [rad/s], zero means at rest; applied: every other torque on the joint [N m]. Shapes broadcast.
    """
    velocity, applied = np.broadcast_arrays(np.asarray(velocity, float), np.asarray(applied, float))
    holding = -np.clip(applied, -law.breakaway, law.breakaway)
    return np.where(velocity == 0, holding, -np.sign(velocity) * law.sliding(velocity))


def dead_band(level: float, kp: float) -> float:
    """Return f/kp: how far the target can be from the angle before the joint moves at all [rad]."""
    if not kp > 0:
        raise StictionError(f"kp {kp}: the dead band f/kp needs a positive gain")
    return level / kp


def friction_ratio(level: float, torque_limit: float) -> float:
    """Return f/τ_max, the share of the motor's torque that friction takes; section V of the paper."""
    if not torque_limit > 0:
        raise StictionError(f"torque limit {torque_limit}: the ratio f/τ_max needs a positive limit")
    return level / torque_limit
