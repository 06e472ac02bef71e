"""An engine in a few lines for tests: independent hinges with known inertia, so that numbers can be worked out by hand.

Its joints are those of a shipped robot by name; nothing hangs on them but `link`, and the base floats where it was put.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stiction.engines.engine import Body, Motion
from stiction.engines.ground import Ground


class Hinges:
    """`Engine`: (M + I) q'' = τ − m g l sin(q) − B q' − dry friction, each joint by itself, semi-implicit steps."""

    name = "hinges"

    def __init__(self, body: Body, ground: Ground | None, timestep: float, link: float = 0.01, weight: float = 0.0):
        """link: M [kg m²]; weight: m g l [N m]."""
        self.body, self.timestep = body, timestep
        self._inertia, self._weight = link + body.armature, weight
        self.force, self.torque = np.zeros_like(body.armature), np.zeros_like(body.armature)
        """Forces and torques that the joints report."""
        self.torques, self.bounds = [], []
        """Every step's torques and bounds."""
        self.reset(np.zeros_like(body.armature), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))

    def reset(self, joint_position: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Put the joints there, at rest."""
        joints = len(self._inertia)
        self._motion = Motion(
            base_position=np.array(position, float),
            base_quaternion=np.array(quaternion, float),
            base_linear_velocity=np.zeros(3),
            base_angular_velocity=np.zeros(3),
            joint_position=np.array(joint_position, float),
            joint_velocity=np.zeros(joints),
            foot_contact=np.ones(len(self.body.spec.feet), bool),
            joint_force=self.force,
            joint_torque=self.torque,
        )

    def step(self, torque: np.ndarray, friction: np.ndarray) -> None:
        """Advance; dry friction takes what it can of the velocity, at most all of it."""
        self.torques.append(np.array(torque))
        self.bounds.append(np.array(friction))
        angle, speed = self._motion.joint_position, self._motion.joint_velocity
        pull = torque - self._weight * np.sin(angle)
        free = (speed + self.timestep * pull / self._inertia) / (1 + self.timestep * self.body.damping / self._inertia)
        braked = np.sign(free) * np.maximum(np.abs(free) - self.timestep * friction / self._inertia, 0.0)
        moved = angle + self.timestep * braked
        loads = {"joint_force": self.force, "joint_torque": self.torque}
        self._motion = replace(self._motion, joint_position=moved, joint_velocity=braked, **loads)

    def motion(self, loads: bool = True) -> Motion:
        """Return what the joints do now."""
        none = np.zeros_like(self.force)
        return self._motion if loads else replace(self._motion, joint_force=none, joint_torque=none)
