"""Dry friction of joints that are not alike: how much it is, what it does with speed, load and age.

    bound_j = wear_j(t) f_j (1 + (r_j − 1) exp(−(q'/v_j)²)) + c_j (|F_j| + |T_j|)

f_j is what the level asks for times the joint's own share; r_j and v_j are the joint's Stribeck curve; c_j multiplies
the force and torque that the joint transmits, as the law `load` of `stiction.sim.friction` does, with half of the old
load kept over 5 ms. Wear acts on what a bench measures without load, as the paper's seals do, and not on c.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.sim.friction import KEPT, stribeck_bound

KEPT_OVER = 0.005
"""Physics step of the training, over which `KEPT` of the old load is kept [s]; shorter ones keep as much over it."""


@dataclass(frozen=True)
class FrictionShape:
    """How the joints of a robot differ in their friction, whatever its level. Arrays have shape (J,)."""

    share: np.ndarray
    """Friction of the joint over the level's [1]; the mean over the joints is one, so that the level means what it
    says."""
    static_ratio: np.ndarray
    """Friction at rest over friction in motion, r [1]."""
    stribeck_velocity: np.ndarray
    """Speed at which 63 % of the excess at rest is gone, v [rad/s]."""
    load_share: np.ndarray
    """Load coefficient of the joint over the level's [1]; the mean is one."""

    @classmethod
    def perfect(cls, num_joints: int) -> FrictionShape:
        """Return Coulomb's law, the same share in every joint."""
        one = np.ones(num_joints)
        return cls(one, one, one, one)


class DryFriction:
    """The friction of one robot at one level."""

    def __init__(self, shape: FrictionShape, coulomb: np.ndarray, load_coefficient: float, timestep: float) -> None:
        """coulomb: the level's [N m], shape (J,); load_coefficient: the level's [1]; timestep: of the physics [s]."""
        self._shape = shape
        self._coulomb = coulomb * shape.share
        self._coefficient = load_coefficient * shape.load_share
        self._kept = KEPT ** (timestep / KEPT_OVER)
        self.reset()

    def reset(self) -> None:
        """Begin without a past."""
        self._load: np.ndarray | None = None

    def bound(self, speed: np.ndarray, load: np.ndarray, wear: np.ndarray | float = 1.0) -> np.ndarray:
        """Return the bounds of the coming step [N m], shape (J,).

        speed: q' of the links [rad/s]; load: |F| + |T| in the step before, numbers of N and N m added up; wear: factor
        on what a bench would measure [1].
        """
        shape = self._shape
        old = load if self._load is None else self._load
        self._load = self._kept * old + (1.0 - self._kept) * load
        dry = stribeck_bound(self._coulomb, shape.static_ratio, shape.stribeck_velocity, speed)
        return wear * dry + self._coefficient * self._load
