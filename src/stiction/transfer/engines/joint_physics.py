"""Dry friction of one robot's joints in any engine: the bound of each joint, from its state before each step.

    bound_j = wear_j f_j (1 + (r_j − 1) exp(−(q'/v_j)²)) + c_j (|F_j| + |T_j|) + e_j |τ_j|

The terms are the laws of the training (`stiction.sim.friction`), and so are their delays: e multiplies the motor's
torque of the step before, c the force and torque that the joint transmitted in it, of which half of the old value is
kept over 5 ms. Wear acts on what a bench measures without load, as the paper's seals do, and not on c and e.
"""

from __future__ import annotations

import numpy as np

from stiction.formats.friction import Law
from stiction.sim.friction import KEPT, stribeck_bound
from stiction.transfer.engines.engine import Motion

KEPT_OVER = 0.005
"""Physics step of the training, over which `KEPT` of the old load's share is kept [s]; shorter steps keep as much over
it."""

Values = np.ndarray | float
"""Of the joints, shape (J,), or one for all."""


class JointFriction:
    """Dry friction of one robot."""

    def __init__(
        self,
        timestep: float,
        coulomb: Values = 0.0,
        static_ratio: Values = 1.0,
        stribeck_velocity: Values = 1.0,
        load: Values = 0.0,
        effort: Values = 0.0,
    ) -> None:
        """Begin without a past.

        Args:
            timestep: of the physics [s].
            coulomb: friction in motion, f [N m].
            static_ratio: friction at rest over that in motion, r [1].
            stribeck_velocity: speed at which 63 % of the excess at rest is gone, v [rad/s].
            load: coefficient c of what the joint transmits [-].
            effort: coefficient e of the motor's torque [-].

        """
        self._coulomb, self._ratio, self._velocity = np.array(coulomb, float), static_ratio, stribeck_velocity
        self._load, self._effort = np.array(load, float), np.array(effort, float)
        self._kept = KEPT ** (timestep / KEPT_OVER)
        self.reset()

    @classmethod
    def under(cls, law: Law, level: np.ndarray, timestep: float) -> JointFriction:
        """Return friction under one law of the training at some level: f [N m] or the coefficient [-], shape (J,)."""
        if law.name == "stribeck":
            return cls(timestep, level, law.static_ratio, law.stribeck_velocity)
        return cls(timestep, **{law.name: level})

    @property
    def loaded(self) -> bool:
        """Whether the friction depends on what a joint transmits."""
        return bool(self._load.any())

    def reset(self) -> None:
        """Forget the load of the last step: the robot begins anew."""
        self._last: np.ndarray | None = None

    def bound(self, motion: Motion, torque: np.ndarray, wear: Values = 1.0) -> np.ndarray:
        """Return the bounds of the coming step [N m], shape (J,).

        motion: what the robot does now; torque: what its motors gave in the last step [N m], shape (J,), zero where
        there was none; wear: factor on f [1].
        """
        fresh = self._load * (motion.joint_force + motion.joint_torque)
        self._last = fresh if self._last is None else self._kept * self._last + (1.0 - self._kept) * fresh
        dry = stribeck_bound(self._coulomb, self._ratio, self._velocity, motion.joint_velocity)
        return wear * dry + self._last + self._effort * np.abs(torque)
