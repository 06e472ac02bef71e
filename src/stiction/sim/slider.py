"""Dry friction as a yielding spring on every joint, MuJoCo's joint plasticity; see `robots.physics`."""

from __future__ import annotations

import numpy as np

from stiction.robots.physics import SMALLEST_YIELD
from stiction.sim.protocol import Simulation


class Slider:
    """The sliders of a fleet, one a joint: bounds of friction in, yields of the springs out.

    `bound`: friction of each joint [N m], (N, joints), written by the caller. The state `plastic` holds the angle at
    which each spring is slack.
    """

    def __init__(self, simulation: Simulation, stiffness: float) -> None:
        """`stiffness`: k of every spring [N m/rad]."""
        self.stiffness = stiffness
        self._slack = simulation.bind("plastic")
        self._yield = simulation.expand("jnt_springyield")[:, -self._slack.shape[1] :]
        self.bound = np.zeros_like(self._slack)

    def write(self) -> None:
        """Make `bound` act from the next physics step."""
        np.maximum(self.bound / self.stiffness, SMALLEST_YIELD, out=self._yield)

    def release(self, ids: np.ndarray, position: np.ndarray) -> None:
        """Let the springs of the robots `ids` be slack where their joints are, `position`: [rad], (N, joints)."""
        self._slack[ids] = position[ids]
