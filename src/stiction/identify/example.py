"""Logs of motors whose parameters are known: the paper's two shank motors, simulated with the noise of real ones.

For trying the program without a robot, and for tests: what comes out can be compared with what went in.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from stiction.formats.log import JointSignals, Log, LogSetup
from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Joint, simulate


@dataclass(frozen=True)
class Motor:
    """A motor and its controller."""

    name: str
    """Name of the log."""
    joint: Joint
    """The truth."""
    gains: PDGains
    """Low gains, so that friction shows: at high ones the position follows whatever friction does."""


GO1 = Motor("go1_shank", Joint(0.0121, 0.0342, Coulomb(0.0481), 0.01), PDGains(20.0, 0.5, 35.55))
"""Means of the paper's table; the offset is invented."""

SATURN_LITE = Motor("saturn_lite_shank", Joint(0.0145, 0.0704, Coulomb(0.442), -0.05), PDGains(20.0, 0.5, 45.0))
"""Means of the paper's table; the offset is invented."""


@dataclass(frozen=True)
class Excitation:
    """A sum of sines as target, A sin(ωt) in the paper."""

    amplitudes: tuple[float, ...] = (0.4, 0.3)
    """[rad]."""
    frequencies: tuple[float, ...] = (0.5, 2.0)
    """[Hz]. Two, because one sine hardly tells viscous from dry friction."""
    duration: float = 20.0
    """[s]."""
    rate: float = 500.0
    """Samples per second [Hz]."""

    def target(self) -> tuple[np.ndarray, np.ndarray]:
        """Return time [s] and target [rad], shape (num_samples,) each."""
        time = np.arange(round(self.duration * self.rate)) / self.rate
        pairs = zip(self.amplitudes, self.frequencies, strict=True)
        return time, np.sum([size * np.sin(2 * np.pi * frequency * time) for size, frequency in pairs], axis=0)


@dataclass(frozen=True)
class SensorNoise:
    """What stands between the joint and the log; chosen to be like small geared actuators, not measured on one."""

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


def example_log(
    motor: Motor = SATURN_LITE,
    excitation: Excitation | None = None,
    noise: SensorNoise | None = None,
    seed: int = 0,
) -> Log:
    """Simulate a log; the same seed gives the same log.

    The controller acts on the noisy angle and velocity, so their noise moves the joint, as in a real loop.
    """
    noise, rng = noise or SensorNoise(), np.random.default_rng(seed)
    time, target = (excitation or Excitation()).target()
    step = float(time[1] - time[0])
    angle = noise.position * rng.standard_normal(len(time))
    speed = _correlated(rng, len(time), noise.velocity, 0.005 / step)
    felt = target - angle - motor.gains.kd / motor.gains.kp * speed
    made = simulate(motor.joint, motor.gains, step, felt, position=float(target[0]))
    position = made.position + angle
    if noise.resolution > 0:
        position = np.round(position / noise.resolution) * noise.resolution
    torque = made.torque + noise.torque * rng.standard_normal(len(time))
    torque += _correlated(rng, len(time), noise.ripple, 0.02 / step)
    signals = JointSignals(position=position, target=target, torque=torque)
    setup = LogSetup(
        kp=motor.gains.kp,
        kd=motor.gains.kd,
        torque_limit=motor.gains.torque_limit,
        torque_source="motor_side",
        test_condition="bare_motor",
        axis="rotary",
    )
    return Log(motor.name, time, {"shank": signals}, setup)


def _correlated(rng: np.random.Generator, count: int, std: float, memory: float) -> np.ndarray:
    """Return stationary noise of size `std` whose correlation falls to 1/e in `memory` samples, shape (count,)."""
    keep = float(np.exp(-1 / memory))
    start = std * rng.standard_normal()
    fresh = std * np.sqrt(1 - keep**2) * rng.standard_normal(count)
    return lfilter([1.0], [1.0, -keep], fresh, zi=[keep * start])[0]
