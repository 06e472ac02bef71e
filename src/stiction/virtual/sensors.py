"""Sensor models: quantisation, offsets, filters, noise, and drift of the orientation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stiction.core.rotation import tilted
from stiction.deploy.control import JointCommand, Port, Reading
from stiction.deploy.observation import Sensors
from stiction.task.config import NoiseCfg


def disturbed(true: Sensors, noise: NoiseCfg, drawn: np.ndarray) -> Sensors:
    """Return noisy measurements of N robots; drawn: numbers in [-1, 1), shape (N, `drawn_width`).

    What no sensor measures, velocity of the base and heights, stays true.
    """
    joints = true.joint_position.shape[-1]
    # A quaternion of a small turn: (1, half of the angles).
    tilt = np.hstack([np.ones((len(drawn), 1)), noise.roll_pitch / 2 * drawn[:, 3:5]])
    return replace(
        true,
        quaternion=tilted(true.quaternion, tilt),
        angular_velocity=true.angular_velocity + noise.angular_velocity * drawn[:, :3],
        joint_position=true.joint_position + noise.joint_position * drawn[:, 5 : 5 + joints],
        joint_velocity=true.joint_velocity + noise.joint_velocity * drawn[:, 5 + joints :],
    )


def drawn_width(joints: int) -> int:
    """Return how many random numbers the noise of one robot's sensors takes."""
    return 5 + 2 * joints


INITIAL_ANGLE = 0.1
"""Half-width of the initial joint angles about the standing pose [rad], as in training: the first entry of
`task.events.RESET_NOISE`, a module that needs torch. A test compares the two."""

WANDERING = 1.0
"""Correlation time of the orientation filter's error [s]."""


@dataclass(frozen=True)
class SensorErrors:
    """Errors of the sensors of one robot. White noise has a standard deviation, per reading."""

    encoder_step: float
    """Step of the measured rotor angle, at the joint [rad]; 0 for none."""
    encoder_offset: np.ndarray
    """Measured less true rotor angle [rad], shape (J,): the zero was set by hand."""
    velocity_filter: float
    """Time constant with which the motor controller smooths differences of the angle [s]; 0: it knows φ' exactly."""
    torque_noise: float
    """White noise of the reported torque over the motor's limit [1]."""
    torque_zero: np.ndarray
    """Constant error of the reported torque over the limit [1], shape (J,)."""
    gyroscope_noise: float
    """White noise [rad/s]."""
    gyroscope_bias: np.ndarray
    """Constant error, base frame [rad/s], shape (3,)."""
    tilt_bias: np.ndarray
    """Constant error of the estimated roll and pitch [rad], shape (2,): how the IMU was mounted."""
    tilt_wander: float
    """Standard deviation of what the orientation filter adds, correlated over `WANDERING` [rad]."""

    @classmethod
    def perfect(cls, num_joints: int) -> SensorErrors:
        """Return sensors without errors."""
        zero = np.zeros(num_joints)
        return cls(0.0, zero, 0.0, 0.0, zero, 0.0, np.zeros(3), np.zeros(2), 0.0)


class Encoders:
    """Rotor angles and velocities as the motor controllers measure them, at every physics step. Shapes (J,)."""

    def __init__(self, errors: SensorErrors, timestep: float) -> None:
        """timestep: of the physics, at which the controllers run [s]."""
        self._errors, self._timestep = errors, timestep

    def reset(self, angle: np.ndarray) -> None:
        """Begin with rotors at rest at an angle [rad]."""
        self.angle, self.velocity = self._measured(angle), np.zeros_like(angle)
        """Measured, [rad] and [rad/s]."""

    def follow(self, angle: np.ndarray, velocity: np.ndarray) -> None:
        """Measure the rotors after a step: true angles φ [rad], velocities φ' [rad/s]."""
        before, self.angle = self.angle, self._measured(angle)
        if self._errors.velocity_filter:
            fresh = 1.0 - np.exp(-self._timestep / self._errors.velocity_filter)
            # Of counted angles: the steps of the encoder are in the velocity, as on a motor controller.
            self.velocity = self.velocity + fresh * ((self.angle - before) / self._timestep - self.velocity)
        else:
            self.velocity = velocity.copy()

    def _measured(self, angle: np.ndarray) -> np.ndarray:
        """Return angles as the encoder counts them [rad]."""
        shifted = angle + self._errors.encoder_offset
        step = self._errors.encoder_step
        return np.round(shifted / step) * step if step else shifted


class Imu:
    """Gyroscope and orientation filter."""

    def __init__(self, errors: SensorErrors, period: float, generator: np.random.Generator) -> None:
        """period: between two readings [s]; generator: of the noise."""
        self._errors, self._generator = errors, generator
        self._decay = float(np.exp(-period / WANDERING))
        self.reset()

    def reset(self) -> None:
        """Begin with the stationary distribution of the filter's error."""
        self._wander = self._errors.tilt_wander * self._generator.standard_normal(2)

    def read(self, quaternion: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return orientation and angular velocity as measured, from the true ones; shapes (4,) and (3,) [rad/s]."""
        errors, draw = self._errors, self._generator.standard_normal
        # So that its variance stays that of the start, whatever the period.
        fresh = errors.tilt_wander * np.sqrt(1.0 - self._decay**2)
        self._wander = self._decay * self._wander + fresh * draw(2)
        half = 0.5 * (errors.tilt_bias + self._wander)
        turned = tilted(quaternion[None], np.array([[1.0, *half]]))[0]
        return turned, rate + errors.gyroscope_bias + errors.gyroscope_noise * draw(3)


class Noisy:
    """A `Port` that adds the training's noise to another one; each `read` draws anew."""

    def __init__(self, port: Port, noise: NoiseCfg, generator: np.random.Generator) -> None:
        """Disturb what `port` reads."""
        self._port, self._noise, self._generator = port, noise, generator
        self.joint_names, self.period = port.joint_names, port.period

    def read(self) -> Reading:
        """Return what came last, with noise."""
        reading = self._port.read()
        drawn = self._generator.uniform(-1.0, 1.0, (1, drawn_width(len(self.joint_names))))
        noisy = disturbed(reading.sensors.each(lambda value: value[None]), self._noise, drawn)
        return replace(reading, sensors=noisy.each(lambda value: value[0]))

    def exchange(self, command: JointCommand) -> Reading:
        """Send a command; what comes back has no noise: joint controllers use it, no policy."""
        return self._port.exchange(command)
