"""The robot as its description has it, under one law of friction: what other simulators are compared with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.formats.friction import Law, has_coefficient
from stiction.robots.spec import RobotSpec
from stiction.transfer.engines.joint_physics import JointFriction
from stiction.transfer.robot.hidden import Hidden


@dataclass(frozen=True)
class DataSheet:
    """A case like those of the factorial, with nothing hidden and the same share of friction in every joint."""

    seed: int
    """Of start poses and sensor noise."""
    law: Law
    """Of the friction."""
    level: float
    """Friction as a fraction of the torque limit, or its coefficient [-]."""

    def robot(self, hidden: Hidden) -> Hidden:
        """Return a robot in which nothing is hidden."""
        return hidden.only(())

    def friction(self, hidden: Hidden, spec: RobotSpec, timestep: float) -> JointFriction:
        """Return the dry friction of its joints; `timestep`: of the physics [s]."""
        unit = np.ones(spec.num_joints) if has_coefficient(self.law.name) else spec.joint_values("torque_limit")
        return JointFriction.under(self.law, self.level * unit, timestep)
