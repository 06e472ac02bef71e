"""The laws of dry friction for one robot in any engine: the bound of each joint, from its state before each step.

The laws are those of the training (`stiction.sim.friction`), and so are their delays: `effort` takes the motor's torque
of the step before, and `load` the force and torque that the joint transmitted in it.
"""

from __future__ import annotations

import numpy as np

from stiction.formats.friction import Law
from stiction.sim.friction import KEPT, stribeck_bound
from stiction.transfer.engines.engine import Motion


class JointFriction:
    """Dry friction of one robot's joints under one law; `level` may be written at any time, for wear."""

    def __init__(self, law: Law, level: np.ndarray) -> None:
        """`level`: what the law is given at each joint, f_c [N m] or the coefficient c [-], shape (J,)."""
        self.law, self.level = law, np.array(level, float)
        self._last: np.ndarray | None = None

    def reset(self) -> None:
        """Forget the bound of the last step: the robot begins anew."""
        self._last = None

    def bound(self, motion: Motion, torque: np.ndarray) -> np.ndarray:
        """Return the bounds of the coming step [N m], shape (J,).

        motion: what the robot does now; torque: what its motors gave in the last step [N m], shape (J,), zero where
        there was none.
        """
        law, level = self.law, self.level
        if law.name == "stribeck":
            return stribeck_bound(level, law.static_ratio, law.stribeck_velocity, motion.joint_velocity)
        if law.name == "effort":
            return level * np.abs(torque)
        if law.name == "load":
            fresh = level * (motion.joint_force + motion.joint_torque)
            self._last = fresh if self._last is None else KEPT * self._last + (1.0 - KEPT) * fresh
            return self._last
        return level.copy()
