"""Simulated logs of motors with known parameters, for trying the program without a robot.

The paper's shank motor with the noise of real ones, and a leg in the air.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.signal import lfilter

from stiction.core.errors import ConfigurationError
from stiction.files.log import JointSignals, Log, LogSetup
from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains, pd_torque
from stiction.joints.simulate import Gravity, Joint, Trajectory, simulate

FINE = 10
"""Steps of the simulation per sample where samples are taken at uneven instants."""


@dataclass(frozen=True)
class Motor:
    """Motor with its controller."""

    name: str
    """Name of the log."""
    joint: Joint
    """True joint."""
    gains: PDGains
    """Low gains, so that friction shows: at high ones the position follows whatever friction does."""


SATURN_LITE = Motor("saturn_lite_shank", Joint(0.0145, 0.0704, Coulomb(0.442), -0.05), PDGains(20.0, 0.5, 45.0))
"""Means of the paper's table; the offset is invented."""

LEG = Motor("leg_in_air", Joint(0.06, 0.0704, Coulomb(0.442), -0.05, Gravity(2.2, 0.4)), PDGains(20.0, 1.0, 45.0))
"""Saturn Lite's shank motor with a lower leg on it that hangs in the air."""


@dataclass(frozen=True)
class Excitation:
    """Sum of sines as target, A sin(ωt) in the paper."""

    amplitudes: tuple[float, ...] = (0.4, 0.3)
    """Amplitudes [rad]."""
    frequencies: tuple[float, ...] = (0.5, 2.0)
    """Frequencies [Hz]. Two, because one sine hardly tells viscous from dry friction."""
    duration: float = 20.0
    """Duration [s]."""
    rate: float = 500.0
    """Samples per second [Hz]."""

    def target(self) -> tuple[np.ndarray, np.ndarray]:
        """Return time [s] and target [rad], shape (num_samples,) each."""
        time = np.arange(round(self.duration * self.rate)) / self.rate
        pairs = zip(self.amplitudes, self.frequencies, strict=True)
        return time, np.sum([size * np.sin(2 * np.pi * frequency * time) for size, frequency in pairs], axis=0)


@dataclass(frozen=True)
class Played:
    """Target trajectory of the user."""

    time: np.ndarray
    """Time [s], an even grid, shape (num_samples,)."""
    angle: np.ndarray
    """Target [rad], shape (num_samples,)."""

    def target(self) -> tuple[np.ndarray, np.ndarray]:
        """Return time [s] and target [rad], shape (num_samples,) each."""
        return self.time, self.angle


@dataclass(frozen=True)
class SensorNoise:
    """Sensor errors between joint and log; chosen to be like small geared actuators, not measured on one."""

    position: float = 1e-4
    """White noise of the angle [rad]."""
    resolution: float = 2 * np.pi / 2**14 / 6.33
    """Step of the angle: 14 bits on the rotor behind a gear of 6.33 [rad]."""
    velocity: float = 0.02
    """Noise of the velocity that the controller sees, correlated over 5 ms [rad/s]."""
    torque: float = 0.05
    """White noise of the current sensor [N m]."""
    ripple: float = 0.02
    """Disturbance of the current sensor, correlated over 20 ms [N m]."""
    in_loop: bool = True
    """True if the controller acts on the noisy angle and velocity, so that their noise moves the joint, as in a real
    loop; else noise is in the log alone."""
    jitter: float = 0.0
    """Standard deviation of the instants at which samples are taken about an even grid, as a share of its step."""
    stamps: Literal["true", "even"] = "true"
    """Stamps of the log: those of the samples, or the even grid."""

    def __post_init__(self) -> None:
        """Reject jitter that would put samples out of order."""
        if not 0 <= self.jitter <= 0.1:
            raise ConfigurationError(f"jitter {self.jitter}: expected a share of the step from 0 to 0.1")

    @classmethod
    def white(cls, position: float, torque: float) -> SensorNoise:
        """Return white noise of the logged position [rad] and torque [N m] and nothing else, none of it in the loop."""
        return cls(position=position, resolution=0.0, velocity=0.0, torque=torque, ripple=0.0, in_loop=False)


def example_log(
    motor: Motor = SATURN_LITE,
    excitation: Excitation | Played | None = None,
    noise: SensorNoise | None = None,
    seed: int = 0,
    load: np.ndarray | None = None,
) -> Log:
    """Simulate a log; the same seed gives the same log.

    load: known torque on the joint from outside at the excitation's samples [N m], shape (num_samples,); it is logged.
    """
    noise, rng = noise or SensorNoise(), np.random.default_rng(seed)
    time, target = (excitation or Excitation()).target()
    step = float(time[1] - time[0])
    angle = noise.position * rng.standard_normal(len(time))
    speed = _correlated(rng, len(time), noise.velocity, 0.005 / step)
    # kp (a − θ − n) − kd (θ' + m) is the law of a target moved by −n − m kd/kp, so that the loop feels its noise.
    seen_target = target - angle - motor.gains.kd / motor.gains.kp * speed if noise.in_loop else target
    sampled = time
    if noise.jitter > 0:
        # Less than half a step, so that no two samples change places.
        wander = np.clip(noise.jitter * rng.standard_normal(len(time)), -0.4, 0.4) * step
        sampled = np.clip(time + wander, time[0], time[-1])
        motion = _between(motor, time, seen_target, sampled, load)
        target = np.interp(sampled, time, target)
        load = None if load is None else np.interp(sampled, time, load)
    else:
        motion = simulate(motor.joint, motor.gains, step, seen_target, position=float(target[0]), load=load)
    position = motion.position + angle
    if noise.resolution > 0:
        position = np.round(position / noise.resolution) * noise.resolution
    torque = motion.torque + noise.torque * rng.standard_normal(len(time))
    torque += _correlated(rng, len(time), noise.ripple, 0.02 / step)
    signals = JointSignals(position=position, target=target, torque=torque, disturbance=load)
    setup = LogSetup(
        kp=motor.gains.kp,
        kd=motor.gains.kd,
        torque_limit=motor.gains.torque_limit,
        torque_source="motor_side",
        test_condition="in_air" if motor.joint.gravity else "bare_motor",
        axis="rotary",
    )
    return Log(motor.name, sampled if noise.stamps == "true" else time, {"shank": signals}, setup)


def _between(
    motor: Motor, time: np.ndarray, target: np.ndarray, instants: np.ndarray, load: np.ndarray | None
) -> Trajectory:
    """Simulate on a finer grid and return the motion at `instants` [s], shape (num_samples,)."""
    step = float(time[1] - time[0]) / FINE
    fine = step * np.arange(FINE * (len(time) - 1) + 1)
    finer = None if load is None else np.interp(fine, time, load)
    goal = np.interp(fine, time, target)
    motion = simulate(motor.joint, motor.gains, step, goal, position=float(target[0]), load=finer)
    position = CubicHermiteSpline(fine, motion.position, motion.velocity)(instants)
    velocity = np.interp(instants, fine, motion.velocity)
    torque = pd_torque(motor.gains, np.interp(instants, time, target), position, velocity)
    return Trajectory(position, velocity, torque)


def _correlated(rng: np.random.Generator, count: int, std: float, memory: float) -> np.ndarray:
    """Return stationary noise of size `std` whose correlation falls to 1/e in `memory` samples, shape (count,)."""
    keep = float(np.exp(-1 / memory))
    # Begun in its stationary state: from zero the first samples would be too quiet.
    start = std * rng.standard_normal()
    fresh = std * np.sqrt(1 - keep**2) * rng.standard_normal(count)
    return lfilter([1.0], [1.0, -keep], fresh, zi=[keep * start])[0]
