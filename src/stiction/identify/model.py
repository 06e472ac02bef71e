"""Which torque equation a joint is given: a friction law, with or without gravity, and the names of its parameters.

I θ'' + B θ' + f(θ') sign(θ') + offset + gravity_sin sin θ + gravity_cos cos θ = k τ + d, where τ is the motor's torque,
k its strength (1 where the torque is in N m), and d a known torque from outside. The four laws are

    coulomb      f = b_c                                               b_c at rest
    asymmetric   f = b_c and B for each direction; the offset is the difference of the two b_c
    stribeck     f = b_c + (b_s - b_c) exp(-(θ'/v_s)²)                 b_s > b_c at rest
    load         f = b_c + c |load|, the load being gravity and d      the same at rest
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Law = Literal["coulomb", "asymmetric", "stribeck", "load"]

LAWS: tuple[Law, ...] = ("coulomb", "asymmetric", "stribeck", "load")
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
}
"""Law -> its parameters; forward means θ' > 0."""

GRAVITY = ("gravity_sin", "gravity_cos")
"""Torque that holds the link: gravity_sin sin θ + gravity_cos cos θ [N m]."""


@dataclass(frozen=True)
class Model:
    """A torque equation."""

    law: Law = "coulomb"
    """Friction law."""
    gravity: bool = False
    """Whether gravity pulls on the link."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order in which estimators hold them."""
        return PARAMETERS_OF[self.law] + (GRAVITY if self.gravity else ())
