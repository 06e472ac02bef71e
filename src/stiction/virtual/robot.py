"""Virtual robot: a body in a physics engine, with its motors, gears, friction and sensors.

A physics step, in this order:

1. the command that arrives now (sent `delays.command` ago) becomes valid; 2. each motor controller computes its torque
from its encoder, without a delay, and adds its feed-forward against friction; 3. the motor limits it by torque, speed
and voltage, and scales it by its true torque constant; 4. the gears transmit it, or cross their gap; 5. the engine
moves the body, under that torque and the bounds of dry friction; 6. rotors and encoders follow, and the readings are
sent; the computer has them `delays.sensors` later.

Until the first command arrives the motors are limp.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from typing import Generic, TypeVar

import numpy as np

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.core.names import kind_of
from stiction.core.rotation import UPRIGHT
from stiction.deploy.control import JointCommand, Reading
from stiction.deploy.observation import Sensors
from stiction.engines.engine import Engine, FrictionSensing, JointFriction, Motion
from stiction.joints.compensation import FrictionController
from stiction.joints.net import TorqueSource
from stiction.virtual.hardware import Drive, Encoders, Gears, Imu, commanded_torque
from stiction.virtual.hidden import Hidden

Signal = TypeVar("Signal")


class DelayLine(Generic[Signal]):
    """Delay line of `steps` places: a signal comes out that many pushes later, at once without any."""

    def __init__(self, steps: int) -> None:
        """Make an empty line; it must be filled before use."""
        self._line: deque[Signal] = deque(maxlen=steps + 1)

    def fill(self, signal: Signal) -> None:
        """Fill the line as if `signal` had been pushed forever."""
        self._line.extend([signal] * (self._line.maxlen or 1))

    def push(self, signal: Signal) -> Signal:
        """Add the signal sent now and return the one that arrives now."""
        self._line.append(signal)
        return self._line[0]

    @property
    def arrived(self) -> Signal:
        """Last signal that arrived."""
        return self._line[0]


def whole_steps(delay: float, timestep: float) -> int:
    """Return a delay [s] in steps of `timestep` [s], the nearest whole number."""
    return round(delay / timestep)


SEALS_OUT = 0.3
"""Friction of a joint without its seals over that with them, as measured in the paper [1]."""


@dataclass(frozen=True)
class Wear:
    """Factor on some joints' dry friction that grows by equal ratios: 0.3 to 0.6 takes as long as 1 to 2."""

    joints: tuple[str, ...] = ()
    """Names of joints (`FL_shank`) or kinds (`shank`); empty: all. The others have the factor 1."""
    start: float = SEALS_OUT
    """Factor at the beginning [1]."""
    end: float = 3.0
    """Factor from `seconds` on [1]."""
    seconds: float = 60.0
    """Time from `start` to `end` [s]."""

    def __post_init__(self) -> None:
        """Validate the factors."""
        numbers = (self.start, self.end, self.seconds)
        if not all(0 < number < math.inf for number in numbers):
            raise ConfigurationError(
                f"wear from x{self.start} to x{self.end} in {self.seconds} s: expected three positive numbers"
            )

    def factor(self, time: float) -> float:
        """Return the factor of the worn joints at a time since the beginning [s]."""
        reached = min(max(time / self.seconds, 0.0), 1.0)
        return self.start * (self.end / self.start) ** reached

    def worn(self, joint_names: tuple[str, ...]) -> np.ndarray:
        """Return the mask of worn joints, bool, shape (J,); raise `StictionError` for an unknown name."""
        of_kind = {name: kind_of(name) for name in joint_names}
        known = {*of_kind, *of_kind.values()}
        if wrong := sorted(set(self.joints) - known):
            raise ConfigurationError(f"wear: {unknown_name('joint', wrong[0], sorted(known))}")
        return np.array([not self.joints or bool({name, of_kind[name]} & set(self.joints)) for name in joint_names])


PERIOD = 0.002
"""Time between two readings [s]: legged robots send the state of their joints at 500 Hz."""


@dataclass(frozen=True)
class GroundTruth:
    """Ground truth of the last physics step: for metrics, and for no policy."""

    time: float
    """Time since the robot was placed [s]."""
    motion: Motion
    torque: np.ndarray
    """Torque of the motors [N m], shape (J,)."""
    friction: np.ndarray
    """Bounds of dry friction [N m], shape (J,)."""
    chatter: float
    """Integral since the robot was placed of the joints' squared acceleration, by physics step, mean over joints
    [rad²/s³]."""


class RobotHandle:
    """`Port` of a virtual robot; nothing hidden can be read from it by accident."""

    __slots__ = ("_exchange", "_read", "joint_names", "period")

    def __init__(
        self,
        joint_names: tuple[str, ...],
        period: float,
        read: Callable[[], Reading],
        exchange: Callable[[JointCommand], Reading],
    ) -> None:
        """Connect to a robot through its two functions."""
        self.joint_names, self.period, self._read, self._exchange = joint_names, period, read, exchange

    def read(self) -> Reading:
        """Return the last reading; see `Port.read`."""
        return self._read()

    def exchange(self, command: JointCommand) -> Reading:
        """Send a command and wait for one period; see `Port.exchange`."""
        return self._exchange(command)


class VirtualRobot:
    """Robot that an experiment places, wears out and observes; its driver gets only its `handle`."""

    def __init__(
        self,
        engine: Engine,
        hidden: Hidden,
        friction: JointFriction,
        generator: np.random.Generator,
        period: float = PERIOD,
        wear: Wear | None = None,
        loads: bool = True,
        torque_source: TorqueSource = "motor_side",
    ) -> None:
        """Build the robot around an engine, made with `hidden.body(...)`.

        generator: of the noise of its sensors; period: between two readings [s], whole physics steps; torque_source:
        torque is measured at the motor, or behind the gear, with friction in it and the rotor's inertia added back;
        loads: the ground truth includes the loads of joints. Raises `StictionError` for other periods, unknown joints,
        and engines without a report of friction torque.
        """
        self._steps = whole_steps(period, engine.timestep)
        if self._steps < 1 or abs(self._steps * engine.timestep - period) > 1e-9:
            raise ConfigurationError(
                f"readings every {period} s from physics of {engine.timestep} s: expected whole physics steps"
            )
        self._output_sensing: FrictionSensing | None = None
        if torque_source == "output_side":
            if not isinstance(engine, FrictionSensing):
                raise ConfigurationError(
                    f"the engine {engine.name!r} does not say what dry friction did, so that nothing can measure "
                    "torque behind the gear; use 'physx' or 'mujoco', or torque of the motor's side"
                )
            self._output_sensing = engine
        spec = engine.body.spec
        self._engine, self._hidden, self._friction, self._wear = engine, hidden, friction, wear
        self._names, self._limit = spec.joint_names, spec.joint_values("torque_limit")
        self._loads = loads or friction.loaded
        self._worn = np.zeros(spec.num_joints, bool) if wear is None else wear.worn(self._names)
        self._drive = Drive(hidden.motors, self._limit, engine.timestep)
        self._gears = Gears(hidden.gears, engine.body.armature, engine.timestep)
        self._encoders = Encoders(hidden.sensors, engine.timestep)
        self._generator, self._imu = generator, Imu(hidden.sensors, period, generator)
        self._commands: DelayLine[JointCommand] = DelayLine(whole_steps(hidden.delays.command, engine.timestep))
        self._samples: DelayLine[Reading] = DelayLine(whole_steps(hidden.delays.sensors, engine.timestep))
        self._reported: deque[np.ndarray] = deque(maxlen=self._steps)
        self._compensation: FrictionController | None = None
        self.handle = RobotHandle(self._names, period, lambda: self._reading, self._exchange)
        standing = spec.joint_values("default_position")
        self.place(standing, np.array([0.0, 0.0, spec.standing_height]), UPRIGHT)

    def program(self, compensation: FrictionController | None) -> None:
        """Set the motor controllers' feed-forward of friction, from their encoders at the physics step; None: no
        feed-forward.
        """
        self._compensation = compensation

    def place(self, joint_position: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Place the robot, at rest and limp; see `Engine.reset`."""
        self._engine.reset(joint_position, position, quaternion)
        self._motion, self._tick, self._chatter = self._engine.motion(self._loads), 0, 0.0
        for part in (self._drive, self._friction, self._imu):
            part.reset()
        if self._compensation is not None:
            self._compensation.reset()
        self._gears.reset(joint_position)
        self._encoders.reset(joint_position)
        zero = np.zeros_like(joint_position)
        self._given, self._bound = zero, zero
        self._commands.fill(JointCommand(joint_position, zero, zero, zero))
        self._reported.clear()
        self._samples.fill(self._measure(zero))
        self._reading = self._receive()

    def ground_truth(self) -> GroundTruth:
        """Return the ground truth of the last physics step."""
        return GroundTruth(self._time, self._motion, self._given, self._bound, self._chatter)

    @property
    def _time(self) -> float:
        """Time since the robot was placed [s]."""
        return self._tick * self._engine.timestep

    def _exchange(self, command: JointCommand) -> Reading:
        """Advance one period under a command, which is copied: its sender may write over its arrays."""
        parts = command.target, command.kp, command.kd, command.forward
        sent = JointCommand(*(np.array(part, float) for part in parts))
        for _ in range(self._steps):
            self._advance(sent)
        self._reading = self._receive()
        return self._reading

    def _advance(self, sent: JointCommand) -> None:
        """Take one physics step; the numbers are those of the module's docstring."""
        command, encoders = self._commands.push(sent), self._encoders  # 1
        commanded = commanded_torque(
            command.kp, command.kd, command.target, command.forward, encoders.angle, encoders.velocity
        )  # 2
        if self._compensation is not None:  # a joint that is commanded limp stays so
            forward = self._compensation.torque(command.target, encoders.angle, encoders.velocity, commanded)
            commanded = commanded + np.where(command.kp > 0.0, forward, 0.0)
        # Laws that read the motor's torque read that of the step before, as in training.
        last = self._given
        self._given, reported = self._drive.torque(commanded, self._gears.velocity)  # 3
        wear = 1.0 if self._wear is None else np.where(self._worn, self._wear.factor(self._time), 1.0)
        self._bound = self._friction.bound(self._motion, last, wear)
        transmitted = self._gears.transmit(self._given)
        self._engine.step(transmitted, self._bound)  # 4 and 5
        before = self._motion.joint_velocity
        self._motion, self._tick = self._engine.motion(self._loads), self._tick + 1
        change = self._motion.joint_velocity - before
        self._chatter += float(change @ change) / (len(change) * self._engine.timestep)
        self._gears.follow(self._given, self._motion.joint_position, self._motion.joint_velocity)  # 6
        self._encoders.follow(self._gears.angle, self._gears.velocity)
        if self._output_sensing is not None:
            viscous = self._engine.body.damping * self._motion.joint_velocity
            reported = transmitted + self._output_sensing.friction_torque() - viscous
        self._samples.push(self._measure(reported))

    def _measure(self, reported: np.ndarray) -> Reading:
        """Return the readings sent to the computer now, before noise; reported: torque of the last step [N m], shape
        (J,).

        The torque is a mean over the period, as from current sensors: it jumps with every target.
        """
        # The line holds one period: the oldest step drops out by itself.
        self._reported.append(reported)
        motion, encoders = self._motion, self._encoders
        sensors = Sensors(motion.base_quaternion, motion.base_angular_velocity, encoders.angle, encoders.velocity)
        torque = reduce(np.add, self._reported) / len(self._reported)
        return Reading(self._time, sensors, torque, motion.foot_contact)

    def _receive(self) -> Reading:
        """Return the readings that the computer has now, with the noise of the sensors."""
        sent, errors = self._samples.arrived, self._hidden.sensors
        true = sent.sensors
        quaternion, rate = self._imu.read(true.quaternion, true.angular_velocity)
        # Drawn once a reading, on arrival: noise that was put in on sending would depend on the physics step.
        noise = errors.torque_noise * self._generator.standard_normal(len(self._limit)) + errors.torque_zero
        sensors = Sensors(quaternion, rate, true.joint_position.copy(), true.joint_velocity.copy())
        return Reading(self._time, sensors, sent.joint_torque + noise * self._limit, sent.foot_contact.copy())
