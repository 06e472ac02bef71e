"""Simulated logs of motors whose strength is not what was asked for, with and without a known payload."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stiction.files.log import Log
from stiction.identification.example import Excitation, Motor, SensorNoise, example_log
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Gravity

QUIET = SensorNoise.white(0.0, 0.0)


def late_motion(
    truth: Sequence[float], gains: PDGains, step: float, target: np.ndarray, delay: float, pieces: int, whole_loop: bool
) -> np.ndarray:
    """Return position and torque, shape (2, N), of a controller whose velocity, or all that it uses, is late [s].

    truth: inertia, viscous and Coulomb friction, offset; pieces: steps of the simulation in one of the log.
    """
    inertia, viscous, coulomb, offset = truth
    small, back = step / pieces, round(delay / step * pieces)
    fine = np.arange(len(target) * pieces) * small - delay * whole_loop
    position, velocity, past, motion = 0.0, 0.0, [(0.0, 0.0)] * (back + 1), []
    for index, goal in enumerate(np.interp(fine, step * np.arange(len(target)), target).tolist()):
        late = past[-1 - back]
        torque = gains.kp * (goal - (late[0] if whole_loop else position)) - gains.kd * late[1]
        if index % pieces == 0:
            motion.append((position, torque))
        moved = velocity + small * (torque - offset - viscous * velocity) / inertia
        moved = (1 if moved > 0 else -1) * max(abs(moved) - small * coulomb / inertia, 0.0)
        position += 0.5 * small * (velocity + moved)
        velocity = moved
        past.append((position, velocity))
    return np.array(motion).T


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
