"""A `ControlLoop` on a robot behind a `Port`: reads the sensors, sends joint commands back. No simulator.

What is behind the port is not known here: a virtual robot in the same process (`virtual`), or a real robot behind its
transport.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stiction.core.errors import ConfigurationError, PolicyError, RobotError
from stiction.deploy.control import ControlLoop, Driver, JointCommand
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import PolicyStep
from stiction.files.contract import Contract
from stiction.joints.compensation import BY_ERROR, Compensation


@dataclass(frozen=True)
class Reading:
    """The last measurements that arrived from the robot."""

    time: float
    """Time of arrival since the robot was put in place [s]; the robot measured somewhat earlier."""
    sensors: Sensors
    """IMU and encoders, shapes (4,), (3,), (J,), (J,)."""
    joint_torque: np.ndarray
    """Motor currents times the data sheet's torque constant, at the joint [N m], shape (J,)."""
    foot_contact: np.ndarray
    """Whether each foot bears load, bool, shape (L,)."""


class Port(Protocol):
    """A robot, as a computer on it sees it."""

    joint_names: tuple[str, ...]
    """Order of every vector over joints."""
    period: float
    """Time between two readings [s]."""

    def read(self) -> Reading:
        """Return what came last; no time passes."""

    def exchange(self, command: JointCommand) -> Reading:
        """Send a command, wait for one period, and return what has come by then."""


class DrivingPolicy(Driver, Protocol):
    """The policy interface of a pilot: `Policy`, or another implementation of the same computation."""

    @property
    def contract(self) -> Contract:
        """What it expects."""


@dataclass(frozen=True)
class ControlStep:
    """What happened in one control period."""

    velocity: np.ndarray
    """Commanded: forward, sideways [m/s], turn [rad/s], shape (3,)."""
    before: Reading
    """Input of the policy."""
    policy: PolicyStep
    """Its output."""
    readings: tuple[Reading, ...]
    """Readings while its targets were held, the last one at the end of the period."""


class Pilot:
    """One policy on one robot."""

    def __init__(
        self,
        port: Port,
        policy: DrivingPolicy,
        friction: np.ndarray | None = None,
        compensation: Compensation = BY_ERROR,
        load: np.ndarray | float = 0.0,
    ) -> None:
        """Connect a policy, as from `deploy.policy.load_policy`, to a robot.

        friction: f that is fed forward [N m], shape (J,): at every reading the joint controllers get a torque beside
        target and gains. None: they get none. compensation: how; by default by the error. load: c that is fed beside f,
        friction per torque that the gains ask for [1], shape (J,); not read without friction, nor by the error.

        Raises:
            StictionError: the robot's joints are not the policy's, its readings do not fit the control period, the
                policy compensates friction itself, or the compensation is that of the motors.

        """
        contract = policy.contract
        if port.joint_names != contract.joint_names:
            raise RobotError(f"the robot has the joints {port.joint_names}, the bundle {contract.joint_names}")
        self._readings = round(contract.control_period / port.period)
        if self._readings < 1 or abs(self._readings * port.period - contract.control_period) > 1e-9:
            raise PolicyError(
                f"the robot is read every {port.period} s, the policy acts every {contract.control_period} s; expected "
                "a whole number of readings to an action"
            )
        if compensation.in_motor:
            raise ConfigurationError(
                f"the compensation {compensation.by!r} runs in the motors' controllers, not in the computer; expected "
                f"{compensation.by.removesuffix('-motor')!r} here"
            )
        forward = None
        if friction is not None:
            forward = compensation.controller(friction, port.period, load=load)
        self._port, self._loop = port, ControlLoop(policy, contract, forward)
        self._seen: Reading | None = None

    def reset(self) -> None:
        """Forget the history: the robot was put in place anew."""
        self._loop.reset()
        self._seen = None

    def step(self, velocity: np.ndarray) -> ControlStep:
        """Advance by one control period under a commanded velocity: forward, sideways [m/s], turn [rad/s].

        Raises `PolicyError`: a sensor or the command is not finite.
        """
        before = self._port.read()
        step = self._loop.act(before.sensors, velocity)
        # Noise that is put before the policy alone, and so is in `before`, is not in the joint controllers.
        self._seen, readings = self._seen or before, []
        for _ in range(self._readings):
            joints = self._seen.sensors
            self._seen = self._port.exchange(self._loop.command(joints.joint_position, joints.joint_velocity))
            readings.append(self._seen)
        return ControlStep(velocity, before, step, tuple(readings))
