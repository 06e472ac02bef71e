"""Simulated logs of motors whose strength is not what was asked for, with and without a known payload."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stiction.files.log import Log
from stiction.identification.example import Excitation, Motor, SensorNoise, example_log
from stiction.joints.simulate import Gravity

QUIET = SensorNoise.white(0.0, 0.0)


def without_torque(log: Log) -> Log:
    """Return the log of one joint as a robot without current sensors would have written it."""
    (name, signals), *_ = log.joints.items()
    return replace(log, joints={name: replace(signals, torque=None)})


def weak_log(
    motor: Motor, strength: float, seed: int = 0, noise: SensorNoise | None = None, excitation: Excitation | None = None
) -> Log:
    """Return a log of positions and targets of a motor that gives `strength` times the torque asked for."""
    weak = replace(motor, gains=replace(motor.gains, strength=strength))
    return without_torque(example_log(weak, excitation, noise, seed))


def carrying_log(
    motor: Motor,
    strength: float,
    mass: float,
    distance: float,
    angle: float,
    seed: int = 0,
    noise: SensorNoise | None = None,
) -> Log:
    """Return a log as `weak_log` does, with a mass on the joint, and a sidecar that tells of it.

    mass [kg]; distance: from the axis [m]; angle: of the joint where the mass hangs straight down [rad].
    """
    weight, own = mass * 9.81 * distance, motor.joint.gravity or Gravity(0.0)
    gravity = Gravity(own.sin + weight * np.cos(angle), own.cos - weight * np.sin(angle))
    joint = replace(motor.joint, inertia=motor.joint.inertia + mass * distance**2, gravity=gravity)
    log = weak_log(replace(motor, joint=joint), strength, seed, noise)
    condition = "in_air" if motor.joint.gravity else "bare_motor"
    setup = replace(log.setup, payload_mass=mass, payload_distance=distance, payload_angle=angle)
    return replace(log, setup=replace(setup, test_condition=condition))
