"""Which torque equation a joint is given: a friction law, with or without gravity, and the names of its parameters.

I θ'' + B θ' + f(θ') sign(θ') + offset + gravity_sin sin θ + gravity_cos cos θ = k τ + d, where τ is the motor's torque,
k its strength (1 where the torque is in N m), and d a known torque from outside. The laws are

    coulomb      f = b_c                                               b_c at rest
    asymmetric   f = b_c and B for each direction; the offset is the difference of the two b_c
    stribeck     f = b_c + (b_s - b_c) exp(-(θ'/v_s)²)                 b_s > b_c at rest
    load         f = b_c + c |load|, the load being gravity and d      the same at rest
    position     f = b_c + slope (θ - θ_m) + curvature (θ - θ_m)²      the same at rest; θ_m is mid-range

The last is for joints behind a linkage, a belt or a cable guide: the knees of a measured Unitree Go2 have it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from stiction.formats.errors import StictionError
from stiction.joints.friction import Asymmetric, Coulomb, FrictionLaw, LoadDependent, PositionDependent, Stribeck
from stiction.joints.gravity import Gravity
from stiction.joints.simulate import Joint

Law = Literal["coulomb", "asymmetric", "load", "stribeck", "position"]

LAWS: tuple[Law, ...] = ("coulomb", "asymmetric", "load", "stribeck", "position")
"""Friction laws, the simplest first."""

PARAMETERS_OF: dict[Law, tuple[str, ...]] = {
    "coulomb": ("inertia", "viscous_friction", "coulomb_friction", "offset"),
    "asymmetric": (
        *("inertia", "viscous_friction_forward", "viscous_friction_backward"),
        *("coulomb_friction_forward", "coulomb_friction_backward"),
    ),
    "stribeck": (
        *("inertia", "viscous_friction", "coulomb_friction", "offset", "static_friction", "stribeck_velocity"),
    ),
    "load": ("inertia", "viscous_friction", "coulomb_friction", "offset", "load_coefficient"),
    "position": (
        *("inertia", "viscous_friction", "coulomb_friction", "offset", "position_slope", "position_curvature"),
    ),
}
"""Law -> its parameters; forward means θ' > 0."""

GRAVITY = ("gravity_sin", "gravity_cos")
"""Torque that holds the link: gravity_sin sin θ + gravity_cos cos θ [N m]."""


NOT_NEGATIVE = ("coulomb_friction", "static_friction", "load_coefficient")
"""Parameters that no joint has below zero. An estimate may be: where there is no friction it scatters about zero."""


def nearest_joint(values: Mapping[str, float]) -> dict[str, float]:
    """Return estimates as the nearest joint has them, by name: less than no friction is none."""
    return {name: max(0.0, value) if name in NOT_NEGATIVE else value for name, value in values.items()}


@dataclass(frozen=True)
class Model:
    """A torque equation."""

    law: Law = "coulomb"
    """Friction law."""
    gravity: bool = False
    """Whether gravity pulls on the link."""
    middle: float = 0.0
    """θ_m of the position law [rad]."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order in which estimators hold them."""
        return PARAMETERS_OF[self.law] + (GRAVITY if self.gravity else ())

    def joint(self, values: Sequence[float]) -> Joint:
        """Return the joint with these parameter values, in the order of `names`, motor strength apart.

        Raises `StictionError` where no joint has them: inertia not positive, or friction that would drive it.
        """
        if len(values) != len(self.names):
            raise StictionError(f"{len(values)} values for {', '.join(self.names)}: expected {len(self.names)}")
        of = {name: float(value) for name, value in zip(self.names, values)}
        friction: FrictionLaw
        viscous, offset = of.get("viscous_friction", 0.0), of.get("offset", 0.0)
        if self.law == "asymmetric":
            # What pushes one way all the time and friction that differs by direction are the same torque: so the law
            # may have less than no friction in one direction, as long as there is friction on the whole.
            forward, backward = of["coulomb_friction_forward"], of["coulomb_friction_backward"]
            middle, offset = 0.5 * (forward + backward), 0.5 * (forward - backward)
            friction = Asymmetric(middle, middle, of["viscous_friction_forward"], of["viscous_friction_backward"])
        elif self.law == "stribeck":
            friction = Stribeck(of["coulomb_friction"], of["static_friction"], of["stribeck_velocity"])
        elif self.law == "load":
            friction = LoadDependent(of["coulomb_friction"], of["load_coefficient"])
        elif self.law == "position":
            shape = (of["position_slope"], of["position_curvature"])
            friction = PositionDependent(of["coulomb_friction"], *shape, self.middle)
        else:
            friction = Coulomb(of["coulomb_friction"])
        gravity = Gravity(of["gravity_sin"], of["gravity_cos"]) if self.gravity else None
        return Joint(of["inertia"], viscous, friction, offset, gravity)
