"""Drives a robot from a policy bundle: NumPy and onnxruntime on one side, a `Port` on the other, nothing else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.deploy.policy import Policy, PolicyStep
from stiction.formats.errors import StictionError
from stiction.joints.pd import fed_forward
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

    def __init__(self, port: Port, policy: Policy, friction: np.ndarray | None = None) -> None:
        """Plug a policy, as from `deploy.policy.load_policy`, into a robot.

        friction: f that the joint controllers feed forward [N m], shape (J,): at every reading they get the torque
        f sat((a − θ)/width) beside target and gains, with the contract's `compensation_width`. None: they get none.

        Raises:
            StictionError: the robot's joints are not the policy's, its readings do not fit the control period, or the
                policy compensates friction itself.

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
        if friction is not None and contract.compensation is not None:
            raise StictionError("the policy compensates friction in its targets; it cannot be fed forward once more")
        self._port, self._policy = port, policy
        self._kp, self._kd = contract.array("kp"), contract.array("kd")
        self._friction = np.zeros(contract.num_joints) if friction is None else friction
        self._width = contract.compensation_width
        self._seen: Reading | None = None

    def reset(self) -> None:
        """Forget the history: the robot was put in place anew."""
        self._policy.reset()
        self._seen = None

    def step(self, velocity: np.ndarray) -> Turn:
        """Advance by one control period under a commanded velocity: forward, sideways [m/s], turn [rad/s].

        Raises:
            SensorError: a sensor or the command is not finite.

        """
        before = self._port.read()
        step = self._policy.step(before.sensors, velocity)
        # Noise that is put before the policy alone, and so is in `before`, is not in the joint controllers.
        self._seen, readings = self._seen or before, []
        for _ in range(self._readings):
            forward = fed_forward(step.target, self._seen.sensors.joint_position, self._friction, self._width)
            self._seen = self._port.exchange(JointCommand(step.target, self._kp, self._kd, forward))
            readings.append(self._seen)
        return Turn(velocity, before, step, tuple(readings))
