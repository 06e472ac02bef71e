"""Drives a robot from a policy bundle: NumPy and onnxruntime on one side, a `Port` on the other, nothing else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.deploy.policy import Policy, PolicyStep
from stiction.formats.errors import StictionError
from stiction.transfer.robot.port import JointCommand, Port, Reading


@dataclass(frozen=True)
class Turn:
    """One control period."""

    velocity: np.ndarray
    """What was commanded: forward, sideways [m/s], turn [rad/s], shape (3,)."""
    before: Reading
    """What the policy saw."""
    policy: PolicyStep
    """What it made of it."""
    readings: tuple[Reading, ...]
    """What came while its targets were held, the last one at the end of the period."""


class Pilot:
    """One policy on one robot."""

    def __init__(self, port: Port, policy: Policy) -> None:
        """Plug a policy, as from `deploy.policy.load_policy`, into a robot.

        Raises:
            StictionError: the robot's joints are not the policy's, or its readings do not fit the control period.

        """
        contract = policy.contract
        if port.joint_names != contract.joint_names:
            raise StictionError(f"the robot has the joints {port.joint_names}, the bundle {contract.joint_names}")
        self._readings = round(contract.control_period / port.period)
        if self._readings < 1 or abs(self._readings * port.period - contract.control_period) > 1e-9:
            raise StictionError(
                f"the robot is read every {port.period} s, the policy acts every {contract.control_period} s; expected "
                "a whole number of readings to an action"
            )
        self._port, self._policy = port, policy
        self._kp, self._kd = contract.array("kp"), contract.array("kd")

    def reset(self) -> None:
        """Forget the history: the robot was put in place anew."""
        self._policy.reset()

    def step(self, velocity: np.ndarray) -> Turn:
        """Advance by one control period under a commanded velocity: forward, sideways [m/s], turn [rad/s].

        Raises:
            SensorError: a sensor or the command is not finite.

        """
        before = self._port.read()
        step = self._policy.step(before.sensors, velocity)
        command = JointCommand.position(step.target, self._kp, self._kd)
        readings = tuple(self._port.exchange(command) for _ in range(self._readings))
        return Turn(velocity, before, step, readings)
