"""What a legged robot is, as data: joints, limits, gains, standing pose, masses, contact groups.

A robot is a module with one `RobotSpec`; nothing else in the house names a robot. `box_legs.py` turns it into a
MuJoCo model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.core.errors import RobotError
from stiction.core.rotation import uprightness

JOINT_KINDS = ("hip", "thigh", "shank")
"""The joints of a leg, from the trunk down: abduction, flexion, knee. Fields of `RobotSpec` have these names."""

JOINTS_PER_LEG = len(JOINT_KINDS)

GRAVITY = 9.81
"""Acceleration of fall [m/s²], in every engine and wherever a weight is known."""

DELAY_SAMPLES = 8
"""Room for delayed controls in every robot's model, in physics steps."""


@dataclass(frozen=True)
class JointSpec:
    """One kind of joint; the same for every leg of a robot."""

    torque_limit: float
    """Largest torque of the motor, at the joint [N m]."""
    armature: float
    """Inertia of the rotor reflected to the joint, I [kg m²]."""
    damping: float
    """Viscous friction, B [N m s/rad]."""
    frictionloss: float
    """Dry (Coulomb) friction, b_c [N m]: what was measured, the level in training overrides it."""
    stiffness: float
    """Proportional gain of the joint controller, kp [N m/rad]."""
    derivative: float
    """Derivative gain of the joint controller, kd [N m s/rad]."""
    lower: float
    """Lower limit of the angle [rad]."""
    upper: float
    """Upper limit of the angle [rad]."""
    standing: float
    """Angle in the standing pose, θ_stand [rad]."""


@dataclass(frozen=True)
class LegSpec:
    """Where one leg is mounted. Legs on the right mirror the hip axis of those on the left."""

    name: str
    """Two letters, front/middle/rear and left/right: `FL`."""
    mount: tuple[float, float, float]
    """Position of the hip joint in the base frame, x forward, y left, z up [m]."""
    group: int
    """Contact group of the tripod or trot (0 or 1), C^G of the paper."""

    @property
    def side(self) -> float:
        """+1 on the left, -1 on the right."""
        return 1.0 if self.mount[1] > 0 else -1.0


@dataclass(frozen=True)
class LinkSpec:
    """One rigid link, a capsule or a box for contact, a box of uniform density for inertia."""

    mass: float
    """Mass [kg]."""
    size: tuple[float, float, float]
    """Full extent along x, y, z in the link's frame [m]."""


def box_inertia(mass: float, size: tuple[float, float, float]) -> np.ndarray:
    """Return the principal moments of a uniform box [kg m²], shape (3,). `size` is its full extent [m]."""
    x, y, z = size
    return mass / 12.0 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])


@dataclass(frozen=True)
class RobotSpec:
    """A legged robot with any number of three-jointed legs."""

    name: str
    """Identifier, as in file names: `saturn_lite`."""
    base: LinkSpec
    """The trunk: its mass, and its box."""
    hip_link: LinkSpec
    """From the hip axis to the thigh axis; `size[1]` is the lateral offset between them."""
    thigh_link: LinkSpec
    """From the thigh axis down to the knee; `size[2]` is its length."""
    shank_link: LinkSpec
    """From the knee down to the foot; `size[2]` is its length."""
    foot_radius: float
    """Radius of the spherical foot [m]."""
    hip: JointSpec
    """Abduction, axis x."""
    thigh: JointSpec
    """Flexion at the hip, axis y."""
    shank: JointSpec
    """Knee, axis y."""
    legs: tuple[LegSpec, ...]
    """The legs, in the order of the joints."""
    action_scale: float
    """Joint angle per unit of action [rad]."""

    def __post_init__(self) -> None:
        """Refuse a robot that could not be built."""
        names = [leg.name for leg in self.legs]
        if len(names) < 2 or len(set(names)) != len(names):
            raise RobotError(f"robot {self.name!r}: legs {names}; at least two legs with different names are needed")
        if {leg.group for leg in self.legs} != {0, 1}:
            raise RobotError(f"robot {self.name!r}: every leg is in contact group 0 or 1, and neither may be empty")
        for kind, joint in zip(JOINT_KINDS, (self.hip, self.thigh, self.shank), strict=True):
            if not joint.lower < joint.standing < joint.upper:
                raise RobotError(
                    f"robot {self.name!r}: the {kind}'s standing angle {joint.standing} is outside its limits "
                    f"[{joint.lower}, {joint.upper}]"
                )
            if min(joint.torque_limit, joint.armature, joint.stiffness) <= 0:
                raise RobotError(f"robot {self.name!r}: the {kind}'s torque limit, armature and kp must be positive")

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, leg by leg: `FL_hip`, `FL_thigh`, `FL_shank`, ..."""
        return tuple(f"{leg.name}_{kind}" for leg in self.legs for kind in JOINT_KINDS)

    @property
    def num_joints(self) -> int:
        """Three per leg."""
        return JOINTS_PER_LEG * len(self.legs)

    @property
    def foot_names(self) -> tuple[str, ...]:
        """Names of the feet, in the order of the legs."""
        return tuple(f"{leg.name}_foot" for leg in self.legs)

    @property
    def mass(self) -> float:
        """Mass of the whole robot [kg]."""
        return self.base.mass + len(self.legs) * (self.hip_link.mass + self.thigh_link.mass + self.shank_link.mass)

    @property
    def weight(self) -> float:
        """Weight of the whole robot [N]."""
        return self.mass * GRAVITY

    def joint_values(self, field: str) -> np.ndarray:
        """Return one field of `JointSpec` for every joint, shape (num_joints,)."""
        return np.array([getattr(joint, field) for joint in (self.hip, self.thigh, self.shank)] * len(self.legs))

    def groups(self) -> np.ndarray:
        """Return the contact group of each foot, shape (num_legs,)."""
        return np.array([leg.group for leg in self.legs])

    @property
    def standing_height(self) -> float:
        """Height of the base above flat ground in the standing pose, feet touching [m].

        Planar kinematics of thigh and shank; the hip's standing angle is small and enters as its cosine.
        """
        leg = self.thigh_link.size[2] * np.cos(self.thigh.standing)
        leg += self.shank_link.size[2] * np.cos(self.thigh.standing + self.shank.standing)
        return float(leg * np.cos(self.hip.standing) + self.foot_radius)


FALLEN_UP = 0.5
"""A robot has fallen where the base's up axis is more than 60° off vertical: its `uprightness` is under this."""

FALLEN_HEIGHT = 0.45
"""... or where the base is lower than this fraction of its standing height."""


def leans_too_far(quaternion: np.ndarray) -> np.ndarray:
    """Return whether each base leans too far, bool, shape (...). `quaternion`: w, x, y, z, (..., 4)."""
    return uprightness(quaternion) < FALLEN_UP


def too_low(height: np.ndarray, standing_height: float) -> np.ndarray:
    """Return whether each base is too near the ground under it, bool, shape (...). Heights above that ground [m]."""
    return height < FALLEN_HEIGHT * standing_height
