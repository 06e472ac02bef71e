"""Control step, the only one: sensors and command in, joint command out, for one robot or a batch.

    sensors ─▶ observation ─▶ policy ─▶ slew, range ─▶ torque ─▶ friction fed forward ─▶ joint command
    command ─▶ correction ─┘   └─ velocity ─▶ correction of the next step
    └───────────── once in a control period: `act` ──┘ └─ at every reading or physics step: `command` ─┘

Evaluation, golden vectors, virtual robots, the viewer, the policy's process on a robot and the Webots controller all
call it: what is evaluated is what runs. A `Pilot` calls it on one robot behind a `Port`: a virtual one in the same
process, or a real one behind its transport. The limits are the contract's `target_limits`, each joint by itself:

1. slew: the target moves at most `slew` [rad/s] times the control period from one action to the next;
2. range: it stays within the joint's limits less a margin;
3. torque: kp (a − θ) − kd θ' stays within the motor's limit. A motor that limits by itself gives the same torque.

Friction fed forward keeps to the motor's limit together with that torque, also in a bundle without `target_limits`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from stiction.core.errors import ConfigurationError, PolicyError, RobotError
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import PolicyStep
from stiction.files.contract import Contract
from stiction.joints.compensation import BY_ERROR, Compensation, FrictionController

FREE, SLEW, RANGE, TORQUE = 0, 1, 2, 3
LIMITED_BY = ("", "slew", "range", "torque")
"""Rule that limited a joint's target, the last one that changed it, by its code in the log."""

LEAST_CHANGE = 1e-9
"""Least change of a target that counts [rad]: of two limiters in a row, whose clocks round differently, one acts."""


@dataclass(frozen=True)
class JointCommand:
    """Input of the motor controllers until the next command arrives. Arrays have shape (*batch, J), gains (J,)."""

    target: np.ndarray
    """Target a [rad]."""
    kp: np.ndarray
    """Proportional gains [N m/rad]."""
    kd: np.ndarray
    """Derivative gains [N m s/rad]; the target's velocity is taken as zero."""
    forward: np.ndarray
    """Feed-forward torque in addition to that of the gains, τ_ff [N m]."""

    @classmethod
    def position(cls, target: np.ndarray, kp: np.ndarray, kd: np.ndarray) -> JointCommand:
        """Return targets and gains without any feed-forward torque."""
        return cls(target, kp, kd, np.zeros_like(target))

    def against_friction(
        self, position: np.ndarray, velocity: np.ndarray, forward: FrictionController | None, limit: np.ndarray
    ) -> JointCommand:
        """Return the command with friction fed forward at a measured angle [rad] and speed [rad/s].

        limit: of the motors [N m], shape (J,). The fed torque is cut to what the torque of the gains leaves of it.
        """
        if forward is None:
            return self
        asked = self.kp * (self.target - position) - self.kd * velocity
        fed = forward.torque(self.target, position, velocity, asked)
        # Gains that alone ask for more than the limit are the motor's to cut: the fed torque never turns against them.
        most, least = np.maximum(limit - asked, 0.0), np.minimum(-limit - asked, 0.0)
        return replace(self, forward=np.minimum(np.maximum(fed, least), most))


@dataclass(frozen=True)
class Limited:
    """Targets that go out. Arrays have shape (*batch, J)."""

    target: np.ndarray
    """Limited targets [rad]."""
    by: np.ndarray
    """Code of the rule that limited each joint, int, see `LIMITED_BY`."""


class Limits:
    """Slew, range and torque limits of one robot or a batch; holds the last targets that it passed."""

    def __init__(self, contract: Contract, slew: float, margin: float, kp: np.ndarray, kd: np.ndarray) -> None:
        """Take the joints' limits from the contract, and start in the standing pose.

        slew: [rad/s]; margin: [rad]; kp, kd: gains of the run [N m/rad, N m s/rad], shape (J,). Raises
        `ConfigurationError`: the margin leaves a joint no room.
        """
        self._slew, self._limit, self._kp, self._kd = slew, contract.array("torque_limit"), kp, kd
        self._lower, self._upper = contract.array("lower") + margin, contract.array("upper") - margin
        self._last = contract.array("standing")
        if (self._lower >= self._upper).any():
            joint = contract.joint_names[int(np.argmax(self._lower >= self._upper))]
            raise ConfigurationError(f"a margin of {margin} rad leaves {joint} no room between its limits")

    def begin(self, position: np.ndarray, mask: np.ndarray | None = None) -> None:
        """Start again from targets [rad], (J,), for the robots in `mask` (bool, the batch's shape), or for all."""
        position = np.array(position, dtype=np.float64)
        self._last = position if mask is None else np.where(mask[..., None], position, self._last)

    def step(self, requested: np.ndarray, elapsed: float) -> Limited:
        """Return the targets allowed by slew and range; `apply_torque` then applies the torque's limit.

        requested: finite [rad], shape (*batch, J); elapsed: time since the last change of the request [s].
        """
        most = self._slew * max(elapsed, 0.0)
        # Without np.clip, which takes twice as long on the joints of one robot.
        slow = np.minimum(np.maximum(requested, self._last - most), self._last + most)
        by = np.where(np.abs(slow - requested) > LEAST_CHANGE, SLEW, FREE)
        slow = np.where(by == FREE, requested, slow)
        inside = np.minimum(np.maximum(slow, self._lower), self._upper)
        by = np.where(np.abs(inside - slow) > LEAST_CHANGE, RANGE, by)
        # Without the torque's limit: it follows the joint, as a motor that limits by itself, and has no memory.
        self._last = inside
        return Limited(inside, by)

    def apply_torque(self, limited: Limited, position: np.ndarray, velocity: np.ndarray) -> Limited:
        """Return targets whose torque is within the motors' limits at a measured angle [rad] and velocity [rad/s]."""
        torque = self._kp * (limited.target - position) - self._kd * velocity
        within = np.minimum(np.maximum(torque, -self._limit), self._limit)
        # A torque within the limit stays as it is: the way to the torque and back would round it.
        target = np.where(within == torque, limited.target, position + (within + self._kd * velocity) / self._kp)
        # A joint that is thrown far behind its limit must not be commanded to go on.
        inside = np.minimum(np.maximum(target, self._lower), self._upper)
        return Limited(inside, np.where(np.abs(inside - limited.target) > LEAST_CHANGE, TORQUE, limited.by))


class CommandCorrection:
    """Integral action on the velocity command, of one robot or a batch; holds the correction.

        u ← clip(u + T/T_i (c − v), ±(share |c| + least)),    the policy gets c + u

    with the control period T, the time T_i, the command c and the velocity v: the policy's own estimate of the base's
    forward and sideways velocity, and the measured yaw rate. A policy that is slower than commanded, as with more
    friction than it makes up for, gets a larger command, until the mean over a stride is the commanded one. While
    standing is commanded there is no correction.
    """

    def __init__(self, time: float, share: float, least: float, period: float) -> None:
        """Start with no correction; time: T_i [s]; share: [1]; least: [m/s, rad/s]; period: T [s]."""
        self._rate, self._share, self._least = period / time, share, least
        self._value = np.zeros(3)

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget the correction of the robots in `mask` (bool, the batch's shape), of all without it."""
        self._value = np.zeros(3) if mask is None else np.where(mask[..., None], 0.0, self._value)

    def corrected(self, command: np.ndarray) -> np.ndarray:
        """Return the command that the policy gets, shape (*batch, 3)."""
        return command + self._within(self._value, command)

    def step(self, command: np.ndarray, velocity: np.ndarray) -> None:
        """Advance by one control period at a velocity: forward, sideways [m/s], turn [rad/s], shape (*batch, 3)."""
        self._value = self._within(self._value + self._rate * (command - velocity), command)

    def _within(self, value: np.ndarray, command: np.ndarray) -> np.ndarray:
        most = (self._share * np.abs(command) + self._least) * command.any(axis=-1, keepdims=True)
        return np.minimum(np.maximum(value, -most), most)


class Driver(Protocol):
    """Interface from sensors to joint targets: `Policy`, its twin in torch, or a function."""

    @property
    def reset(self) -> Callable[..., None]:
        """Reset function without arguments, or with a mask (bool, (N,)) for a batch; forgets history and action."""

    def step(self, sensors: Sensors, command: np.ndarray) -> PolicyStep:
        """Advance by one control period under commanded velocities, shape (*batch, 3); see `Policy.step`."""


class ControlLoop:
    """One policy on one robot, or on a batch: `act` once in a control period, `command` at every reading."""

    def __init__(self, policy: Driver, contract: Contract, forward: FrictionController | None = None) -> None:
        """Start in the standing pose.

        forward: controller of the friction that is fed forward; its period is that between two calls of `command`.
        Raises `StictionError`: the policy compensates friction itself, or the contract's margin leaves a joint no room.
        """
        if forward is not None and contract.compensation is not None:
            raise PolicyError("the policy compensates friction in its targets; it cannot be fed forward once more")
        self._policy, self._contract, self._forward = policy, contract, forward
        self._kp, self._kd, limits = contract.array("kp"), contract.array("kd"), contract.target_limits
        self._torque_limit = contract.array("torque_limit")
        self._limits = (
            None if limits is None else Limits(contract, limits["slew"], limits["margin"], self._kp, self._kd)
        )
        correction = contract.command_correction
        self._correction = (
            None if correction is None else CommandCorrection(**correction, period=contract.control_period)
        )
        standing = contract.array("standing")
        self.requested = standing
        """Last targets that the policy asked for [rad], shape (*batch, J)."""
        self.limited = Limited(standing, np.full(len(standing), FREE))
        """Last targets within slew and range."""

    @property
    def holds(self) -> bool:
        """True if the command is the same from one action to the next."""
        return self._limits is None and self._forward is None

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget history, last action and last targets of the robots in `mask` (bool, (N,)), of all without."""
        if mask is None:
            self._policy.reset()
        else:
            self._policy.reset(mask)
        if self._forward is not None:
            self._forward.reset(None if mask is None else np.flatnonzero(mask))
        if self._limits is not None:
            self._limits.begin(self._contract.array("standing"), mask)
        if self._correction is not None:
            self._correction.reset(mask)

    def act(self, sensors: Sensors, velocity: np.ndarray) -> PolicyStep:
        """Advance by one control period; return the policy's step, its targets within slew and range.

        Arguments and errors as of `Policy.step`.
        """
        step = self._policy.step(sensors, self._correction.corrected(velocity) if self._correction else velocity)
        if self._correction is not None and step.velocity is not None:
            reached = np.concatenate([step.velocity, sensors.angular_velocity[..., 2:]], axis=-1)
            self._correction.step(velocity, reached)
        self.requested = step.target
        if self._limits is None:
            self.limited = Limited(step.target, np.full(step.target.shape, FREE))
            return step
        self.limited = self._limits.step(step.target, self._contract.control_period)
        return PolicyStep(step.observation, step.action, self.limited.target, step.velocity)

    def command(self, position: np.ndarray, velocity: np.ndarray) -> JointCommand:
        """Return the command at a measured angle [rad] and velocity [rad/s], shape (*batch, J)."""
        limited = self.limited
        if self._limits is not None:
            limited = self._limits.apply_torque(limited, position, velocity)
        return JointCommand.position(limited.target, self._kp, self._kd).against_friction(
            position, velocity, self._forward, self._torque_limit
        )


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
    """True if a foot bears load, bool, shape (L,)."""


class Port(Protocol):
    """Robot as a computer on it sees it."""

    joint_names: tuple[str, ...]
    """Order of every vector over joints."""
    period: float
    """Time between two readings [s]."""

    def read(self) -> Reading:
        """Return the last reading; no time passes."""

    def exchange(self, command: JointCommand) -> Reading:
        """Send a command, wait for one period, and return the reading of that time."""


class DrivingPolicy(Driver, Protocol):
    """The policy interface of a pilot: `Policy`, or another implementation of the same computation."""

    @property
    def contract(self) -> Contract:
        """Contract of the policy."""


@dataclass(frozen=True)
class ControlStep:
    """Inputs and outputs of one control period."""

    velocity: np.ndarray
    """Commanded velocity: forward, sideways [m/s], turn [rad/s], shape (3,)."""
    before: Reading
    policy: PolicyStep
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

        friction: f that is fed forward at every reading [N m], shape (J,), or None; compensation: its method; load: c
        that is fed besides f, friction per torque of the gains [1], shape (J,); not read by the error. Raises
        `StictionError`: the robot's joints are not the policy's, its readings do not fit the control period, the policy
        compensates friction itself, or the compensation is that of the motors.
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
        forward = None
        if friction is not None:
            if compensation.in_motor:
                raise ConfigurationError(
                    f"the compensation {compensation.by!r} runs in the motors' controllers, not in the computer; "
                    f"expected {compensation.by.removesuffix('-motor')!r} here"
                )
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
        # Noise that only the policy gets, and that is so in `before`, is not in the joint controllers.
        self._seen, readings = self._seen or before, []
        for _ in range(self._readings):
            joints = self._seen.sensors
            self._seen = self._port.exchange(self._loop.command(joints.joint_position, joints.joint_velocity))
            readings.append(self._seen)
        return ControlStep(velocity, before, step, tuple(readings))
