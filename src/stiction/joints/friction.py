"""Dry friction of a joint, and the two numbers that say how large it is.

The paper writes f = −b_c sign(θ') and leaves θ' = 0 open. Here friction at rest takes whatever value holds the joint,
up to a limit: that is what makes it *static* friction.

Every law is a chain of straight pieces in |θ'| for each direction, for a joint on a straight piece is a linear system
and its motion is known in closed form. Friction at rest goes up to the value of the first piece at zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from stiction.formats.errors import StictionError

KNOTS = (0.0, 0.19, 0.4, 0.84, 1.15, 1.43, 1.76, 2.33)
"""Ends of the secants of exp(−x²), the last value being taken as zero: they are off by less than 1 % of its height."""

SECANTS = (*(float(np.exp(-(x**2))) for x in KNOTS[:-1]), 0.0)
"""exp(−x²) at the knots."""


class Piece(NamedTuple):
    """f = level + slope |θ'| from the speed `start` to the start of the next piece, the last one without end."""

    start: float
    """[rad/s]."""
    level: float
    """Where the straight line meets θ' = 0 [N m]."""
    slope: float
    """[N m s/rad]."""


class FrictionLaw(Protocol):
    """What a simulator asks of a friction law."""

    @property
    def load_coefficient(self) -> float:
        """Friction per torque that the load transmits, at every speed and at rest [1]."""
        ...

    @property
    def depends_on_angle(self) -> bool:
        """Whether `at_angle` is anything but zero."""
        ...

    def pieces(self, direction: int) -> tuple[Piece, ...]:
        """Return the friction of the unloaded joint turning in `direction`, 1 or -1, continuous from zero speed on."""
        ...

    def at_angle(self, position: np.ndarray) -> np.ndarray:
        """Return what comes on top at an angle [rad], at every speed and at rest [N m], in the shape of `position`."""
        ...

    def slope_at_angle(self, position: np.ndarray) -> np.ndarray:
        """Return the derivative of `at_angle` [N m/rad]."""
        ...


class SameEverywhere:
    """A law that asks neither for the load nor for the angle."""

    load_coefficient = 0.0
    depends_on_angle = False

    def at_angle(self, position: np.ndarray) -> np.ndarray:
        """Return nothing on top."""
        return np.zeros_like(position)

    def slope_at_angle(self, position: np.ndarray) -> np.ndarray:
        """Return no slope."""
        return np.zeros_like(position)


@dataclass(frozen=True)
class Coulomb(SameEverywhere):
    """The same friction at every speed, and up to as much at rest."""

    level: float
    """b_c [N m]."""

    def __post_init__(self) -> None:
        """Refuse friction that would drive the joint."""
        _not_negative("Coulomb friction", self.level)

    def pieces(self, direction: int) -> tuple[Piece, ...]:
        """Return b_c, whatever the direction."""
        return (Piece(0.0, self.level, 0.0),)


@dataclass(frozen=True)
class Asymmetric(SameEverywhere):
    """Coulomb and viscous friction of each direction; forward means θ' > 0. `Joint.viscous` is zero beside it."""

    forward: float
    """b_c forward [N m]."""
    backward: float
    """b_c backward [N m]."""
    viscous_forward: float = 0.0
    """B forward [N m s/rad]."""
    viscous_backward: float = 0.0
    """B backward [N m s/rad]."""

    def __post_init__(self) -> None:
        """Refuse friction that would drive the joint."""
        _not_negative("Coulomb friction forward", self.forward)
        _not_negative("Coulomb friction backward", self.backward)
        if not np.isfinite([self.viscous_forward, self.viscous_backward]).all():
            raise StictionError(
                f"viscous friction {self.viscous_forward} and {self.viscous_backward}: expected finite numbers"
            )

    def pieces(self, direction: int) -> tuple[Piece, ...]:
        """Return b_c + B |θ'| of the direction."""
        if direction > 0:
            return (Piece(0.0, self.forward, self.viscous_forward),)
        return (Piece(0.0, self.backward, self.viscous_backward),)


@dataclass(frozen=True)
class Stribeck(SameEverywhere):
    """f = b_c + (b_s − b_c) exp(−(θ'/v_s)²): more friction at rest than in motion, as in lubricated gears.

    The Gaussian is a chain of secants (`KNOTS`), within 1 % of b_s − b_c of it.
    """

    coulomb: float
    """b_c, at high speed [N m]."""
    static: float
    """b_s, at rest [N m]."""
    velocity: float
    """v_s [rad/s]."""

    def __post_init__(self) -> None:
        """Refuse friction that would drive the joint, and a fall without width."""
        _not_negative("Coulomb friction", self.coulomb)
        _not_negative("static friction", self.static)
        if not (self.velocity > 0 and np.isfinite(self.velocity)):
            raise StictionError(f"Stribeck velocity {self.velocity}: expected a positive number")

    def pieces(self, direction: int) -> tuple[Piece, ...]:
        """Return the secants and the level behind them, whatever the direction."""
        speeds = [self.velocity * knot for knot in KNOTS]
        values = [self.coulomb + (self.static - self.coulomb) * height for height in SECANTS]
        chain = []
        for index in range(len(speeds) - 1):
            slope = (values[index + 1] - values[index]) / (speeds[index + 1] - speeds[index])
            chain.append(Piece(speeds[index], values[index] - slope * speeds[index], slope))
        return (*chain, Piece(speeds[-1], self.coulomb, 0.0))


@dataclass(frozen=True)
class LoadDependent(SameEverywhere):
    """f = b_c + c |load|, the load being the torque that reaches the joint from outside: gravity and known torques."""

    level: float
    """b_c without load [N m]."""
    load_coefficient: float
    """c [1]."""

    def __post_init__(self) -> None:
        """Refuse friction that would drive the joint."""
        _not_negative("Coulomb friction", self.level)
        _not_negative("load coefficient", self.load_coefficient)

    def pieces(self, direction: int) -> tuple[Piece, ...]:
        """Return b_c, whatever the direction; the simulator adds c |load|."""
        return (Piece(0.0, self.level, 0.0),)


@dataclass(frozen=True)
class PositionDependent(SameEverywhere):
    """f = b_c + slope (θ − θ_m) + curvature (θ − θ_m)²: a joint behind a linkage, a belt or a cable guide."""

    level: float
    """b_c in the middle [N m]."""
    slope: float
    """[N m/rad]."""
    curvature: float
    """[N m/rad²]."""
    middle: float = 0.0
    """θ_m [rad]."""
    depends_on_angle = True

    def __post_init__(self) -> None:
        """Refuse friction that would drive the joint."""
        _not_negative("Coulomb friction", self.level)
        if not np.isfinite([self.slope, self.curvature, self.middle]).all():
            raise StictionError(
                f"friction with slope {self.slope}, curvature {self.curvature} about {self.middle}: expected finite "
                "numbers"
            )

    def pieces(self, direction: int) -> tuple[Piece, ...]:
        """Return b_c, whatever the direction; the simulator adds what the angle does."""
        return (Piece(0.0, self.level, 0.0),)

    def at_angle(self, position: np.ndarray) -> np.ndarray:
        """Return slope (θ − θ_m) + curvature (θ − θ_m)², no less than −b_c."""
        away = position - self.middle
        return np.maximum(self.slope * away + self.curvature * away**2, -self.level)

    def slope_at_angle(self, position: np.ndarray) -> np.ndarray:
        """Return slope + 2 curvature (θ − θ_m), zero where the friction is."""
        away = position - self.middle
        positive = self.slope * away + self.curvature * away**2 > -self.level
        return positive * (self.slope + 2 * self.curvature * away)


def _not_negative(name: str, value: float) -> None:
    """Raise `StictionError` unless the value is finite and not negative."""
    if not (value >= 0 and np.isfinite(value)):
        raise StictionError(f"{name} {value}: expected a number that is not negative")


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
