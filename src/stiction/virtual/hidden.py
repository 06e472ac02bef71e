"""Hidden truth of a virtual robot, group by group: no code that trains, identifies or drives may read it.

Such code knows its data sheet (`Robot`), the logs of its bench, and its sensors through a `Port`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.core.provenance import seed_streams
from stiction.engines.engine import Body, JointFriction, Term
from stiction.robots.model import Robot
from stiction.virtual.hardware import Motors, SensorErrors


@dataclass(frozen=True)
class FrictionShape:
    """Differences of friction between the joints of a robot, at any level. Arrays have shape (J,)."""

    share: np.ndarray
    """Friction of the joint over the level's [1]; the mean over the joints is one."""
    static_ratio: np.ndarray
    """Friction at rest over friction in motion, r [1]."""
    stribeck_velocity: np.ndarray
    """Speed at which 63 % of the excess at rest is gone, v [rad/s]."""
    load_share: np.ndarray
    """Load coefficient of the joint over the level's [1]; the mean is one."""

    @classmethod
    def perfect(cls, num_joints: int) -> FrictionShape:
        """Return Coulomb's law, with the same share in every joint."""
        ones = np.ones(num_joints)
        return cls(ones, ones, ones, ones)

    def at(self, coulomb: np.ndarray, load: float, timestep: float) -> JointFriction:
        """Return the friction at a level: coulomb [N m], (J,), load coefficient [-]; timestep: of the physics [s]."""
        numbers = {"static_ratio": self.static_ratio, "stribeck_velocity": self.stribeck_velocity}
        # A law without a level would be computed in every physics step, for nothing.
        loads = [Term("load", load * self.load_share)] if load else []
        return JointFriction(timestep, Term("stribeck", coulomb * self.share, numbers), *loads)


@dataclass(frozen=True)
class Masses:
    """Deviations of the links from the drawing. The same link has the same mass in every leg."""

    base: float = 1.0
    """Mass of the trunk over the drawing's [1]; inertia follows."""
    links: Mapping[str, float] = field(default_factory=dict)
    """Mass of the links behind each kind of joint [1]; 1 by default."""
    base_com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Shift of the trunk's centre of mass from the drawing's [m]."""


@dataclass(frozen=True)
class Delays:
    """Delays of signals; the loop of the joint controllers, at the motors, has neither."""

    command: float = 0.0
    """Delay from the computer to the motor controllers [s]."""
    sensors: float = 0.0
    """Delay from encoders and IMU to the computer [s]."""


@dataclass(frozen=True)
class Hidden:
    """Imperfections of one robot. Each field is a group that an experiment can have real or perfect."""

    friction: FrictionShape
    """Differences of dry friction between joints; the level scales it."""
    motors: Motors
    delays: Delays
    gears: np.ndarray
    """Backlash of each joint: the full width of its gap [rad], shape (J,)."""
    sensors: SensorErrors
    masses: Masses

    @classmethod
    def perfect(cls, num_joints: int) -> Hidden:
        """Return the robot of the data sheet."""
        return cls(
            friction=FrictionShape.perfect(num_joints),
            motors=Motors.perfect(num_joints),
            delays=Delays(),
            gears=np.zeros(num_joints),
            sensors=SensorErrors.perfect(num_joints),
            masses=Masses(),
        )

    def only(self, groups: Collection[str]) -> Hidden:
        """Return the robot with these groups real and all others perfect; raise `StictionError` for unknown groups."""
        if wrong := sorted(set(groups) - set(GROUPS)):
            raise ConfigurationError(f"virtual robot: {unknown_name('group', wrong[0], GROUPS)}")
        perfect = Hidden.perfect(len(self.gears))
        return replace(perfect, **{name: getattr(self, name) for name in groups})

    def body(self, spec: Robot, fixed: bool = False) -> Body:
        """Return the robot to build in an engine; `spec`: the data sheet, `fixed`: bolted to a bench."""
        pairs = zip(spec.joints, spec.links, strict=True)
        links = tuple(link.scaled(self.masses.links.get(joint.kind, 1.0)) for joint, link in pairs)
        return Body(
            spec=replace(spec, base=spec.base.scaled(self.masses.base), links=links),
            armature=spec.joint_values("armature") * self.motors.armature,
            damping=spec.joint_values("damping") * self.motors.damping,
            base_shift=self.masses.base_com,
            fixed=fixed,
        )


GROUPS = ("friction", "motors", "delays", "gears", "sensors", "masses")

FRICTION = {"share": (0.5, 1.5), "static_ratio": (1.1, 1.6), "stribeck_velocity": (0.05, 0.3), "load_share": (0.7, 1.3)}
"""Ranges of friction: legs of one robot differ by a factor of two to three; seals and greased gears hold a tenth to a
half more at rest than in motion."""

MOTORS = {"armature": (0.9, 1.1), "damping": (0.7, 1.4), "strength": (0.93, 1.07), "no_load_speed": (20.0, 28.0)}
"""Ranges of motors: torque constants are known to a few per cent; viscous friction follows the grease's temperature;
speeds of leg motors with 25 to 45 N m [rad/s]."""

KNEE = (0.5, 0.7)
CHARGE = (0.85, 1.0)
RESISTANCE = (2e-5, 8e-5)
"""Ranges of the battery: lithium cells fall by 15 % from full to nearly empty; 0.05 to 0.2 Ω at 50 V are 2e-5 to 8e-5
of the voltage per watt."""

COMMAND_DELAY = (0.002, 0.008)
SENSOR_DELAY = (0.001, 0.006)
"""Range of delays: one to several cycles of a bus at 500 to 1000 Hz, and the computer's processing [s]. Training draws
the sum from 0 to 0.02 s."""

GAP = (0.002, 0.009)
"""Backlash of planetary gears, 7 to 30 minutes of arc [rad]."""

ENCODER_STEP = 2 * np.pi / 2**14 / 6.0
"""Step of an encoder of 14 bits on the rotor behind a gear of 6 [rad]."""

VELOCITY_FILTER = 0.002
"""Range of the filter of a motor controller at 1 kHz and more [s]."""

ENCODER_OFFSET = 0.01
TORQUE_NOISE = 0.005
TORQUE_ZERO = 0.005
GYROSCOPE_NOISE = 0.01
GYROSCOPE_BIAS = 0.01
TILT_BIAS = 0.01
TILT_WANDER = 0.003
"""Half-widths of the constant errors, deviations of the others, in the units of `SensorErrors`."""

BASE_MASS, LINK_MASS = (0.95, 1.15), (0.9, 1.15)
"""Ranges of masses: a robot is mostly heavier than its drawing, which lacks cables and screws."""

BASE_COM = (0.03, 0.01, 0.02)
"""Half-widths along x, y, z [m]."""


def draw(spec: Robot, seed: int) -> Hidden:
    """Return the robot of a seed; every group has a separate random stream, so that a change in one shifts no other."""
    streams = seed_streams(seed, [f"virtual robot, {group}" for group in GROUPS])
    by = {group: streams[f"virtual robot, {group}"] for group in GROUPS}
    joints = spec.num_joints
    return Hidden(
        friction=_friction(by["friction"], joints),
        motors=_motors(by["motors"], joints),
        delays=Delays(by["delays"].uniform(*COMMAND_DELAY), by["delays"].uniform(*SENSOR_DELAY)),
        gears=by["gears"].uniform(*GAP, joints),
        sensors=_sensors(by["sensors"], joints),
        masses=_masses(by["masses"], spec.joint_kinds),
    )


def _friction(generator: np.random.Generator, joints: int) -> FrictionShape:
    """Draw the friction shape; the shares are scaled to a mean of one."""
    drawn = {name: generator.uniform(*span, joints) for name, span in FRICTION.items()}
    for name in ("share", "load_share"):
        drawn[name] = drawn[name] / drawn[name].mean()
    return FrictionShape(**drawn)


def _motors(generator: np.random.Generator, joints: int) -> Motors:
    """Draw every motor independently, and one battery."""
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


def _masses(generator: np.random.Generator, kinds: Sequence[str]) -> Masses:
    """Draw a factor for the trunk and for every kind of link, and the shift of the trunk's centre of mass."""
    base = float(generator.uniform(*BASE_MASS))
    links = {kind: float(generator.uniform(*LINK_MASS)) for kind in kinds}
    x, y, z = (float(half * generator.uniform(-1.0, 1.0)) for half in BASE_COM)
    return Masses(base, links, (x, y, z))
