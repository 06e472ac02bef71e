"""How the dry friction of a robot's joints differs from one to the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.transfer.engines.joint_physics import JointFriction


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

    def at(self, coulomb: np.ndarray, load: float, timestep: float) -> JointFriction:
        """Return the friction at a level.

        coulomb: the level's [N m], shape (J,); load: its coefficient [-]; timestep: of the physics [s].
        """
        return JointFriction(
            timestep, coulomb * self.share, self.static_ratio, self.stribeck_velocity, load * self.load_share
        )
