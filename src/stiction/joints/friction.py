"""Dry friction of a joint: the table of its laws, and its two measures, dead band and share of the torque.

The paper writes f = −b_c sign(θ') and leaves θ' = 0 open. Here friction at rest takes any value that holds the joint,
up to a limit: that is what makes it *static* friction.

A law has up to two forms, and `LAWS` holds both. For many robots at once it is a bound that is written before every
physics step, its level times a factor of speed, load or torque: training, evaluation and the engines use it. For one
joint simulated from event to event it is a chain of straight pieces in |θ'| for each direction, on each of which the
motion is known in closed form: identification uses that. The limit of friction at rest is the value of the first piece
at zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.core.files import digest_of
from stiction.core.provenance import PACKAGE

KNOTS = (0.0, 0.19, 0.4, 0.84, 1.15, 1.43, 1.76, 2.33)
"""Ends of the secants of exp(−x²), the last value being taken as zero: the error is below 1 % of its height."""

SECANTS = (*(float(np.exp(-(x**2))) for x in KNOTS[:-1]), 0.0)
"""exp(−x²) at the knots."""


class Piece(NamedTuple):
    """f = level + slope |θ'| from the speed `start` to the start of the next piece; the last piece has no end."""

    start: float
    """[rad/s]."""
    level: float
    """Value of the straight line at θ' = 0 [N m]."""
    slope: float
    """[N m s/rad]."""


NOT_NEGATIVE = {
    **{"level": "Coulomb friction", "coulomb": "Coulomb friction", "static": "static friction"},
    **{"forward": "Coulomb friction forward", "backward": "Coulomb friction backward"},
    "load_coefficient": "load coefficient",
    "effort_coefficient": "effort coefficient",
}
"""Parameter of a law that must not be negative, for it would drive the joint below zero -> its name in messages."""


class FrictionLaw:
    """Law in the simulation of one joint; this base depends on neither speed, load nor angle."""

    level: float
    """b_c [N m]."""
    load_coefficient: float = 0.0
    """Friction per torque transmitted by the load, at every speed and at rest [1]."""
    effort_coefficient: float = 0.0
    """Friction per torque of the motor, at every speed and at rest [1]."""
    depends_on_angle: bool = False
    """True if friction depends on the joint angle."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not math.isfinite(value) or (name in NOT_NEGATIVE and value < 0):
                expected = "a number that is not negative" if name in NOT_NEGATIVE else "a finite number"
                raise ConfigurationError(f"{NOT_NEGATIVE.get(name, name)} {value}: expected {expected}")

    def pieces(self, direction: int) -> tuple[Piece, ...]:
        """Return the friction of the unloaded joint turning in `direction`, 1 or -1, continuous from zero speed on."""
        return (Piece(0.0, self.level, 0.0),)

    def hold(self, direction: int) -> float:
        """Return the friction at rest of the unloaded joint that is pushed in `direction`, 1 or -1 [N m]."""
        return self.pieces(direction)[0].level

    def at_angle(self, position: np.ndarray) -> np.ndarray:
        """Return the additional friction at an angle [rad], at every speed and at rest [N m], shape of `position`."""
        return np.zeros_like(position)

    def slope_at_angle(self, position: np.ndarray) -> np.ndarray:
        """Return the derivative of `at_angle` [N m/rad]."""
        return np.zeros_like(position)


@dataclass(frozen=True)
class Coulomb(FrictionLaw):
    """f = b_c + c |load| at every speed, and up to as much at rest.

    The load is the torque on the joint from outside: gravity and known torques.
    """

    level: float
    """b_c [N m]."""
    load_coefficient: float = 0.0
    """c [1]."""


@dataclass(frozen=True)
class Effort(FrictionLaw):
    """f = b_c + c |τ|, with the motor's own torque: the loss in the teeth of a gear."""

    level: float
    """b_c [N m]."""
    effort_coefficient: float = 0.0
    """c [1]."""


@dataclass(frozen=True)
class Breakaway(FrictionLaw):
    """f = b_c in motion at any speed, and up to b_s at rest: a joint that sticks, then breaks away suddenly."""

    level: float
    """b_c [N m]."""
    static: float
    """b_s, where it is above b_c [N m]."""

    def hold(self, direction: int) -> float:
        """Return b_s, at least b_c."""
        return max(self.static, self.level)


@dataclass(frozen=True)
class Asymmetric(FrictionLaw):
    """Coulomb and viscous friction of each direction; forward means θ' > 0. `Joint.viscous` must be zero with it."""

    forward: float
    """b_c forward [N m]."""
    backward: float
    """b_c backward [N m]."""
    viscous_forward: float = 0.0
    """B forward [N m s/rad]."""
    viscous_backward: float = 0.0
    """B backward [N m s/rad]."""

    def pieces(self, direction: int) -> tuple[Piece, ...]:
        """Return b_c + B |θ'| of the direction."""
        forward, backward = (self.forward, self.viscous_forward), (self.backward, self.viscous_backward)
        return (Piece(0.0, *(forward if direction > 0 else backward)),)


@dataclass(frozen=True)
class Stribeck(FrictionLaw):
    """f = b_c + (b_s − b_c) exp(−(θ'/v_s)²): more friction at rest than in motion, as in lubricated gears.

    The Gaussian is a chain of secants (`KNOTS`), with an error below 1 % of b_s − b_c.
    """

    coulomb: float
    """b_c, at high speed [N m]."""
    static: float
    """b_s, at rest [N m]."""
    velocity: float
    """v_s [rad/s]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.velocity < math.inf:
            raise ConfigurationError(f"Stribeck velocity {self.velocity}: expected a positive number")

    def pieces(self, direction: int) -> tuple[Piece, ...]:
        """Return the secants and the constant level after them, for either direction."""
        speeds = [self.velocity * knot for knot in KNOTS]
        values = [self.coulomb + (self.static - self.coulomb) * height for height in SECANTS]
        chain = []
        # Secants meet at their ends: without a jump of friction the acceleration is continuous, as `variation` assumes.
        for (speed, value), (next_speed, next_value) in pairwise(zip(speeds, values, strict=True)):
            slope = (next_value - value) / (next_speed - speed)
            chain.append(Piece(speed, value - slope * speed, slope))
        return (*chain, Piece(speeds[-1], self.coulomb, 0.0))


@dataclass(frozen=True)
class PositionDependent(FrictionLaw):
    """f = b_c + slope (θ − θ_m) + curvature (θ − θ_m)²: a joint behind a linkage, a belt or a cable guide."""

    level: float
    """b_c in the middle [N m]."""
    slope: float
    """[N m/rad]."""
    curvature: float
    """[N m/rad²]."""
    middle: float = 0.0
    """θ_m [rad]."""
    # Without an annotation: it is the class's, and no field of the dataclass.
    depends_on_angle = True

    def at_angle(self, position: np.ndarray) -> np.ndarray:
        """Return slope (θ − θ_m) + curvature (θ − θ_m)², no less than −b_c."""
        offset = position - self.middle
        # What is cut off would make the whole friction negative, and drive the joint.
        return np.maximum(self.slope * offset + self.curvature * offset**2, -self.level)

    def slope_at_angle(self, position: np.ndarray) -> np.ndarray:
        """Return slope + 2 curvature (θ − θ_m), zero where there is no friction."""
        offset = position - self.middle
        positive = self.slope * offset + self.curvature * offset**2 > -self.level
        return positive * (self.slope + 2 * self.curvature * offset)


def dead_band(level: float, kp: float) -> float:
    """Return f/kp: the largest distance between target and angle at which the joint does not move [rad]."""
    if not kp > 0:
        raise ConfigurationError(f"kp {kp}: the dead band f/kp needs a positive gain")
    return level / kp


def friction_ratio(level: float, torque_limit: float) -> float:
    """Return f/τ_max, the share of the motor's torque that friction takes; section V of the paper."""
    if not torque_limit > 0:
        raise ConfigurationError(f"torque limit {torque_limit}: the ratio f/τ_max needs a positive limit")
    return level / torque_limit


Values = np.ndarray | float

Unit = Literal["share", "coefficient", "torque"]
"""Unit of a law's level: a fraction of the joint's torque limit, a coefficient [-], or a torque [N m]."""

Signal = Literal["velocity", "load", "torque"]
"""Inputs of a bound, before the physics step: the joint's velocity [rad/s]; |F| + |T| of the force [N] and torque [N m]
that the joint transmitted, T about the centre of mass of the link behind it; the motor's torque [N m]."""

UNITS = {
    "viscous_friction": "N m s/rad",
    "coulomb_friction": "N m",
    "offset": "N m",
    "viscous_friction_forward": "N m s/rad",
    "viscous_friction_backward": "N m s/rad",
    "coulomb_friction_forward": "N m",
    "coulomb_friction_backward": "N m",
    "static_friction": "N m",
    "stribeck_velocity": "rad/s",
    "load_coefficient": "1",
    "effort_coefficient": "1",
    "position_slope": "N m/rad",
    "position_curvature": "N m/rad²",
}
"""Parameter of an identified law, by its name in joints.json -> its unit. Forward means θ' > 0."""


@dataclass(frozen=True)
class LawSpec:
    """Law of dry friction. `register_law` adds it to the table that every command reads."""

    name: str
    """Name on the command line and in joints.json, contract.json and results.csv."""
    meaning: str
    unit: Unit = "share"
    """Unit of the level."""
    label: str = "dry friction"
    """Label of an axis of levels; for shares without their unit."""
    factor: Callable[..., Values] | None = None
    """Factor of the level that gives the bound of a physics step [N m], a function of `reads` and `numbers` by name;
    None: the batched simulator and the engines do not have the law."""
    reads: tuple[Signal, ...] = ()
    """Inputs of the factor. Without any the bound is written once, and the simulator need not stop at every physics
    step; `load` costs sensors in every joint."""
    numbers: tuple[str, ...] = ()
    """Fields of `Law` that the factor takes."""
    smoothing: float = 0.0
    """Share of the old bound that is left after `SMOOTHING_PERIOD`."""
    parameters: tuple[str, ...] = ()
    """Names in `UNITS` that identification estimates in addition to inertia and gravity, in its order; empty: not a
    candidate. The columns of a new one are in `identification.regression`, its torques in `identification.model`."""
    joint: Callable[[Mapping[str, float]], FrictionLaw] | None = None
    """Function that returns the exact pieces of one joint from values of `parameters`, and `position_middle` [rad]."""

    @property
    def loaded(self) -> bool:
        """True if the law depends on the load that a joint transmits."""
        return "load" in self.reads

    @property
    def sensed(self) -> bool:
        """True if the factor depends on sensors, which are not in the simulation's state."""
        return not set(self.reads) <= {"velocity"}


def stribeck_factor(velocity: Values, static_ratio: Values, stribeck_velocity: Values) -> Values:
    """Return 1 + (r − 1) exp(−(q'/v_s)²), friction relative to that at high speed [1]."""
    return 1.0 + (static_ratio - 1.0) * np.exp(-np.square(velocity / stribeck_velocity))


def _asymmetric(of: Mapping[str, float]) -> Asymmetric:
    """Return friction with the difference between the directions removed.

    A constant offset and friction that differs by direction are the same torque: an identified law may have negative
    friction in one direction, if the mean is positive. The difference is the joint's offset.
    """
    middle = 0.5 * (of["coulomb_friction_forward"] + of["coulomb_friction_backward"])
    return Asymmetric(middle, middle, of["viscous_friction_forward"], of["viscous_friction_backward"])


LAWS: dict[str, LawSpec] = {}

SYMMETRIC = ("viscous_friction", "coulomb_friction", "offset")
"""Parameters of viscous and Coulomb friction, which nearly every law has."""

SMOOTHING_PERIOD = 0.005
"""Time constant of `LawSpec.smoothing`: the physics step of the training [s]."""


def register_law(law: LawSpec) -> LawSpec:
    """Add a law to the table, before a command or a configuration names it; return it.

    Raises `StictionError` for a name in use, a law that nothing can simulate, or a parameter without a unit.
    """
    if law.name in LAWS:
        raise ConfigurationError(f"friction law {law.name!r} exists already; choose another name")
    if law.factor is None and law.joint is None:
        raise ConfigurationError(
            f"friction law {law.name!r} has neither a factor nor exact pieces; give it one of them"
        )
    if unknown := [name for name in law.parameters if name not in UNITS]:
        raise ConfigurationError(f"friction law {law.name!r}: parameter {unknown[0]!r} has no unit; add it to UNITS")
    LAWS[law.name] = law
    return law


for _law in (
    LawSpec(
        name="coulomb",
        meaning="a torque that depends on neither load nor speed",
        factor=lambda: 1.0,
        parameters=SYMMETRIC,
        joint=lambda of: Coulomb(of["coulomb_friction"]),
    ),
    LawSpec(
        name="asymmetric",
        meaning="a torque that differs between the directions, and so does viscous friction",
        unit="torque",
        parameters=(
            *("viscous_friction_forward", "viscous_friction_backward"),
            *("coulomb_friction_forward", "coulomb_friction_backward"),
        ),
        joint=_asymmetric,
    ),
    LawSpec(
        name="stribeck",
        meaning="a torque, more of it at rest than in motion",
        label="Stribeck friction in motion",
        factor=stribeck_factor,
        reads=("velocity",),
        numbers=("static_ratio", "stribeck_velocity"),
        parameters=(*SYMMETRIC, "static_friction", "stribeck_velocity"),
        joint=lambda of: Stribeck(of["coulomb_friction"], of["static_friction"], of["stribeck_velocity"]),
    ),
    LawSpec(
        name="breakaway",
        meaning="a torque, more of it at rest than at any speed",
        unit="torque",
        parameters=(*SYMMETRIC, "static_friction"),
        joint=lambda of: Breakaway(of["coulomb_friction"], of["static_friction"]),
    ),
    LawSpec(
        name="load",
        meaning="in proportion to the force and torque that the joint transmits",
        unit="coefficient",
        label="load friction c, N m per N and N m transmitted",
        factor=lambda load: load,
        reads=("load",),
        # Friction at a joint changes the forces that it transmits, and those, a step later, the friction: a loop that
        # chatters at a large c. Half of the old bound calms it; more would delay the friction and help the policy.
        smoothing=0.5,
        parameters=(*SYMMETRIC, "load_coefficient"),
        joint=lambda of: Coulomb(of["coulomb_friction"], of["load_coefficient"]),
    ),
    LawSpec(
        name="effort",
        meaning="in proportion to the motor's torque",
        unit="coefficient",
        label="effort friction c, N m per N m of the motor",
        factor=lambda torque: np.abs(torque),
        reads=("torque",),
        parameters=(*SYMMETRIC, "effort_coefficient"),
        joint=lambda of: Effort(of["coulomb_friction"], of["effort_coefficient"]),
    ),
    LawSpec(
        name="position",
        meaning="a torque that changes with the joint's angle",
        unit="torque",
        parameters=(*SYMMETRIC, "position_slope", "position_curvature"),
        joint=lambda of: PositionDependent(
            of["coulomb_friction"], of["position_slope"], of["position_curvature"], of["position_middle"]
        ),
    ),
):
    register_law(_law)

MAX_LEVEL = 0.9
"""Maximum friction level, and coefficient [-]: above it hardly any torque is left to move the joint."""


def find_law(name: str) -> LawSpec:
    """Return the law of a name. Raises `StictionError` for an unknown name."""
    if name not in LAWS:
        raise ConfigurationError(unknown_name("friction law", name, LAWS))
    return LAWS[name]


def simulated_laws() -> tuple[str, ...]:
    """Return the names of the laws that robots can be simulated with."""
    return tuple(law.name for law in LAWS.values() if law.factor is not None)


def candidate_laws() -> tuple[str, ...]:
    """Return the names of the laws that identification tries, the simplest first."""
    candidates = [law for law in LAWS.values() if law.parameters]
    return tuple(law.name for law in sorted(candidates, key=lambda law: len(law.parameters)))


@dataclass(frozen=True)
class Law:
    """Law of simulated robots, and the parameters common to all its levels."""

    name: str = "coulomb"
    """One of `simulated_laws`."""
    static_ratio: float = 1.5
    """Static over dynamic friction [1], for `stribeck`."""
    stribeck_velocity: float = 0.1
    """Speed at which 63 % of the excess at rest is gone [rad/s], for `stribeck`."""

    def __post_init__(self) -> None:
        if self.name not in simulated_laws():
            raise ConfigurationError(unknown_name("friction law", self.name, simulated_laws()))
        if not 1 <= self.static_ratio <= 10 or not 0 < self.stribeck_velocity < math.inf:
            raise ConfigurationError(
                f"static ratio {self.static_ratio}, Stribeck velocity {self.stribeck_velocity} rad/s: expected a ratio "
                "in [1, 10] and a positive speed"
            )

    @property
    def spec(self) -> LawSpec:
        """Row of the table."""
        return LAWS[self.name]

    @property
    def numbers(self) -> dict[str, float]:
        """Parameters of this law, by name."""
        return {name: getattr(self, name) for name in self.spec.numbers}

    def factor(self, **signals: Values) -> Values:
        """Return the factor that turns the level into the bound [N m].

        signals: at least those that the law reads; its numbers too, where robots differ in them.
        """
        assert self.spec.factor is not None
        known = self.numbers | signals
        return self.spec.factor(**{name: known[name] for name in (*self.spec.reads, *self.spec.numbers)})


def law_source(law: str) -> str | None:
    """Return the SHA-256 of the file that defines a law registered from outside; None for a built-in law."""
    code = getattr(LAWS[law].factor, "__code__", None) if law in LAWS else None
    file = None if code is None else Path(code.co_filename).resolve()
    return None if file is None or PACKAGE in file.parents or not file.is_file() else digest_of(file)


def has_coefficient(law: str) -> bool:
    """Return whether the level of a law is a coefficient; a virtual robot's built-in `real` is a fraction."""
    return law in LAWS and LAWS[law].unit == "coefficient"


def level_text(law: str, level: float) -> str:
    """Return a level for readers: `20 %` of the torque limit, or `c = 0.05`."""
    return f"c = {level:g}" if has_coefficient(law) else f"{100 * level:.4g} %"


def level_number(law: str, level: float) -> float:
    """Return a level in the unit of `level_axis`: per cent of the torque limit, or the coefficient."""
    return level if has_coefficient(law) else 100 * level


def level_axis(law: str) -> str:
    """Return the label of an axis of levels."""
    # A virtual robot's own friction, `real`, is no row of the table; it is a share of the limit, as Coulomb's is.
    label = LAWS.get(law, LAWS["coulomb"]).label
    return label if has_coefficient(law) else f"{label}, % of each joint's torque limit"
