"""The plug of a robot: joint targets and gains go in, sensors come out, once a period. No policy, and no physics.

What drives a robot knows it through this alone. A virtual robot in the same process has such a port; one in a process
of its own, or a real one, gets one from its transport.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stiction.deploy.observation import Sensors


@dataclass(frozen=True)
class JointCommand:
    """What the motor controllers are to do until the next command arrives. Arrays have shape (J,)."""

    target: np.ndarray
    """a [rad]."""
    kp: np.ndarray
    """[N m/rad]."""
    kd: np.ndarray
    """[N m s/rad]; the target's velocity is taken as zero."""
    forward: np.ndarray
    """Torque that is added to what the gains ask for, τ_ff [N m]."""

    @classmethod
    def position(cls, target: np.ndarray, kp: np.ndarray, kd: np.ndarray) -> JointCommand:
        """Return the command of a policy: targets and gains."""
        return cls(target, kp, kd, np.zeros_like(target))


@dataclass(frozen=True)
class Reading:
    """What came from the robot last."""

    time: float
    """When it arrived, since the robot was put in place [s]; the robot measured somewhat earlier."""
    sensors: Sensors
    """IMU and encoders, shapes (4,), (3,), (J,), (J,)."""
    joint_torque: np.ndarray
    """What the motors report: current times the data sheet's torque constant, at the joint [N m], shape (J,)."""
    foot_contact: np.ndarray
    """Whether each foot bears load, bool, shape (L,)."""


class Port(Protocol):
    """A robot, as a computer on it sees it."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Order of every vector over joints."""
        ...

    @property
    def period(self) -> float:
        """Time between two readings [s]."""
        ...

    def read(self) -> Reading:
        """Return what came last; no time passes."""
        ...

    def exchange(self, command: JointCommand) -> Reading:
        """Send a command, wait for one period, and return what has come by then."""
        ...
