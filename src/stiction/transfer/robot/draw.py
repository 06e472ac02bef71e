"""A virtual robot from a seed. The ranges are what data sheets and workshops know, not what any policy can bear."""

from __future__ import annotations

import numpy as np

from stiction.formats.reproducibility import seed_streams
from stiction.robots.spec import RobotSpec
from stiction.transfer.robot.friction import FrictionShape
from stiction.transfer.robot.hidden import GROUPS, Delays, Hidden, Masses
from stiction.transfer.robot.motor import Motors
from stiction.transfer.robot.sensors import SensorErrors

FRICTION = {
    "share": (0.5, 1.5),
    "static_ratio": (1.1, 1.6),
    "stribeck_velocity": (0.05, 0.3),
    "load_share": (0.7, 1.3),
}
"""Legs of one robot, measured in the air, differ in friction by a factor of two to three; seals and greased gears hold
a tenth to a half more at rest than they brake in motion, and let go within some degrees per second."""

MOTORS = {
    "armature": (0.9, 1.1),
    "damping": (0.7, 1.4),
    "strength": (0.93, 1.07),
    "no_load_speed": (20.0, 28.0),
}
"""Torque constants are given to some per cent and fall as magnets warm up. Viscous friction follows the grease's
temperature. The speeds are those of leg motors with 25 to 45 N m [rad/s]."""

KNEE = (0.5, 0.7)
CHARGE = (0.85, 1.0)
RESISTANCE = (2e-5, 8e-5)
"""Lithium cells fall by 15 % from full to nearly empty; 0.05 to 0.2 Ω at 50 V are 2e-5 to 8e-5 of the voltage per
watt."""

COMMAND_DELAY = (0.002, 0.008)
SENSOR_DELAY = (0.001, 0.006)
"""One to several cycles of a bus at 500 to 1000 Hz, and the computer's own work [s]. Training draws the sum from 0 to
0.02 s."""

GAP = (0.002, 0.009)
"""Backlash of planetary gears, 7 to 30 minutes of arc [rad]."""

ENCODER_STEP = 2 * np.pi / 2**14 / 6.0
"""14 bits on the rotor behind a gear of 6 [rad]."""

VELOCITY_FILTER = 0.002
"""Of a motor controller at 1 kHz and more [s]."""

ENCODER_OFFSET = 0.01
TORQUE_NOISE = 0.005
TORQUE_ZERO = 0.005
GYROSCOPE_NOISE = 0.01
GYROSCOPE_BIAS = 0.01
TILT_BIAS = 0.01
TILT_WANDER = 0.003
"""Half-widths of the constant errors, deviations of the others, in the units of `SensorErrors`: a zero set by hand to
half a degree, a current sensor of half a per cent, a cheap IMU after calibration."""

MASS = {"base": (0.95, 1.15), "hip_link": (0.9, 1.15), "thigh_link": (0.9, 1.15), "shank_link": (0.9, 1.15)}
"""Cables and screws that the drawing lacks: a robot is heavier than its drawing more often than lighter."""

BASE_COM = (0.03, 0.01, 0.02)
"""Half-widths along x, y, z [m]."""


def draw(spec: RobotSpec, seed: int) -> Hidden:
    """Return the robot of a seed; every group has a stream of its own, so that a change in one shifts no other."""
    streams = seed_streams(seed, [f"virtual robot, {group}" for group in GROUPS])
    by = {group: streams[f"virtual robot, {group}"] for group in GROUPS}
    joints = spec.num_joints
    return Hidden(
        friction=_friction(by["friction"], joints),
        motors=_motors(by["motors"], joints),
        delays=Delays(by["delays"].uniform(*COMMAND_DELAY), by["delays"].uniform(*SENSOR_DELAY)),
        gears=by["gears"].uniform(*GAP, joints),
        sensors=_sensors(by["sensors"], joints),
        masses=_masses(by["masses"]),
    )


def _friction(generator: np.random.Generator, joints: int) -> FrictionShape:
    """Draw how joints differ; the shares are scaled to a mean of one, which a level then multiplies."""
    drawn = {name: generator.uniform(*span, joints) for name, span in FRICTION.items()}
    for name in ("share", "load_share"):
        drawn[name] = drawn[name] / drawn[name].mean()
    return FrictionShape(**drawn)


def _motors(generator: np.random.Generator, joints: int) -> Motors:
    """Draw every motor by itself, and one battery."""
    drawn = {name: generator.uniform(*span, joints) for name, span in MOTORS.items()}
    knee, charge, resistance = (float(generator.uniform(*span)) for span in (KNEE, CHARGE, RESISTANCE))
    return Motors(**drawn, knee=knee, charge=charge, resistance=resistance)


def _sensors(generator: np.random.Generator, joints: int) -> SensorErrors:
    """Draw the constant errors."""

    def within(half_width: float, count: int) -> np.ndarray:
        return half_width * generator.uniform(-1.0, 1.0, count)

    return SensorErrors(
        encoder_step=ENCODER_STEP,
        encoder_offset=within(ENCODER_OFFSET, joints),
        velocity_filter=VELOCITY_FILTER,
        torque_noise=TORQUE_NOISE,
        torque_zero=within(TORQUE_ZERO, joints),
        gyroscope_noise=GYROSCOPE_NOISE,
        gyroscope_bias=within(GYROSCOPE_BIAS, 3),
        tilt_bias=within(TILT_BIAS, 2),
        tilt_wander=TILT_WANDER,
    )


def _masses(generator: np.random.Generator) -> Masses:
    """Draw a factor for every kind of link, and where the trunk's centre of mass is."""
    factors = {name: float(generator.uniform(*span)) for name, span in MASS.items()}
    x, y, z = (float(half * generator.uniform(-1.0, 1.0)) for half in BASE_COM)
    return Masses(**factors, base_com=(x, y, z))
