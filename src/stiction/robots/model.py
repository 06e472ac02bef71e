"""Legged robot as data: links, joints, feet, limits, gains, pose. NumPy alone.

Everything that is built or derived (the MuJoCo model, PhysX, ODE, Webots, the mirror, the contract) comes from this
data, whatever its source: boxes (`boxes`), a MuJoCo or URDF file with a `robot.yaml` (`load`), or Python.

Frames. At joint angles of zero every frame of a link is parallel to the base's: x forward, y left, z up. The frame of a
link has its origin on the axis of the joint that moves it. The axis and the zero pose of a joint are therefore the same
on the base, and no orientation is stored.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from stiction.core.errors import RobotError, unknown_name
from stiction.core.rotation import GRAVITY as GRAVITY
from stiction.core.rotation import about_vector, matrix, quaternion_of, uprightness
from stiction.robots.shapes import Shape, Vector

TRUNK_LENGTH = 0.70
"""Length of the trunk of the paper's robot, to which its table of randomisation refers [m]."""

LARGEST = 1e9
"""Bound of the numbers of a robot, in every unit; a larger one is an error, or made to overflow."""

GAITS = {4: "trot", 6: "tripod"}
"""Number of feet -> name of the gait in which one contact group is on the ground; no other robot has one."""

DELAY_SAMPLES = 8
"""Physics steps of delayed controls for which every robot's model has room."""


@dataclass(frozen=True)
class Body:
    """Mass and shapes of one rigid body, in its frame."""

    mass: float
    """[kg]."""
    com: Vector
    """Centre of mass [m]."""
    inertia: tuple[float, float, float, float, float, float]
    """Inertia about the centre of mass, along the frame's axes: xx, yy, zz, xy, xz, yz [kg m²]."""
    shapes: tuple[Shape, ...] = field(default=(), repr=False)

    @property
    def inertia_matrix(self) -> np.ndarray:
        """The inertia as a matrix [kg m²], shape (3, 3)."""
        xx, yy, zz, xy, xz, yz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    @property
    def is_physical(self) -> bool:
        """True if a distribution of mass can have this inertia.

        Mass and principal moments are positive, and no moment exceeds the sum of the other two.
        """
        least, middle, most = np.linalg.eigvalsh(self.inertia_matrix)
        return bool(self.mass > 0 and least > 0 and most <= (least + middle) * (1 + 1e-3) + 1e-12)

    def scaled(self, factor: float) -> Self:
        """Return the body with its mass multiplied; inertia follows."""
        xx, yy, zz, xy, xz, yz = (factor * value for value in self.inertia)
        return replace(self, mass=factor * self.mass, inertia=(xx, yy, zz, xy, xz, yz))

    @property
    def principal(self) -> tuple[np.ndarray, np.ndarray]:
        """Principal moments [kg m²], shape (3,), and the quaternion of their axes; along the frame's where they lie."""
        if not any(self.inertia[3:]):
            return np.array(self.inertia[:3]), np.array([1.0, 0.0, 0.0, 0.0])
        moments, axes = np.linalg.eigh(self.inertia_matrix)
        # `eigh` may return a reflection, of which there is no quaternion.
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        return moments, np.array(quaternion_of(axes))


@dataclass(frozen=True)
class Base(Body):
    """Floating trunk. Its frame is the robot's."""

    size: Vector = (0.0, 0.0, 0.0)
    """Full extent of its contact box [m]."""
    center: Vector = (0.0, 0.0, 0.0)
    """Middle of that box [m]."""


@dataclass(frozen=True)
class Link(Body):
    """Body moved by one joint; link i is moved by joint i."""

    name: str = ""
    parent: int = -1
    """Number of the link that carries it, smaller than its number; -1 for the base."""
    origin: Vector = (0.0, 0.0, 0.0)
    """Place of the joint in the parent's frame [m]."""
    axis: Vector = (0.0, 0.0, 1.0)
    """Axis of the joint, of unit length: the angle increases by the right-hand rule about it."""


@dataclass(frozen=True)
class Joint:
    """Driven joint."""

    name: str
    kind: str
    """Kind, the same in every leg: `hip`, `knee`; friction and rewards are set per kind."""
    torque_limit: float
    """Torque limit of the motor, at the joint [N m]."""
    armature: float
    """Inertia of the rotor reflected to the joint, I [kg m²]."""
    damping: float
    """Viscous friction, B [N m s/rad]."""
    frictionloss: float
    """Dry (Coulomb) friction, b_c [N m], as measured; the level in training overrides it."""
    kp: float
    """Proportional gain of the joint controller [N m/rad]."""
    kd: float
    """Derivative gain of the joint controller [N m s/rad]."""
    lower: float
    """Lower limit of the angle [rad]."""
    upper: float
    """Upper limit of the angle [rad]."""
    default_position: float
    """Angle in the standing pose, θ_stand [rad]."""
    action_scale: float
    """Angle per unit of action [rad]."""


WIDEST = 4 * np.pi
"""Maximum range of a joint that is plausible in radians [rad]."""


@dataclass(frozen=True)
class HeldJoint:
    """Joint that no policy moves: rigid here, and held at this angle on the robot."""

    name: str
    position: float
    """[rad]."""
    axis: Vector
    """Axis in the base's frame, at angles of zero of all driven joints."""


@dataclass(frozen=True)
class Foot:
    """Foot of a robot: all contact shapes of one link that belong to it."""

    name: str
    link: int
    """Number of its link."""
    position: Vector
    """Middle in the link's frame [m]."""
    radius: float
    """Height of that middle above the ground in the standing pose [m]."""
    shapes: tuple[Shape, ...] = field(repr=False)
    group: int | None = None
    """Contact group of the tripod or trot, 0 or 1, C^G of the paper; None without groups."""

    @property
    def geometry_names(self) -> list[str]:
        """Names of its shapes in the simulated model; the first has the foot's name."""
        return [f"{self.name}{number}" if number else self.name for number in range(len(self.shapes))]

    @property
    def is_ball(self) -> bool:
        """True if it is one sphere, which touches the ground in a point, without a moment."""
        return len(self.shapes) == 1 and self.shapes[0].kind == "sphere"


GAIT_PERIODS = (0.2, 3.0)
"""Shortest and longest period of one stride [s]."""


@dataclass(frozen=True)
class Vendor:
    """Maker's protocol: the order of its joints, and its signs and zeros."""

    order: tuple[str, ...]
    """Names of the joints, held ones too, in the order of the maker."""
    sign: tuple[float, ...]
    """+1 or -1 each: maker's angle = sign · angle + offset."""
    offset: tuple[float, ...]
    """Between -2π and 2π each [rad]."""

    def __post_init__(self) -> None:
        """Reject a protocol that maps no angles."""
        sizes = {len(self.order), len(self.sign), len(self.offset)}
        if sizes != {len(set(self.order))} or not all(abs(sign) == 1 for sign in self.sign):
            raise RobotError(
                f"vendor: got signs {self.sign} of {len(self.order)} joints and {len(self.offset)} offsets; expected "
                "different joints, and 1 or -1 and an offset for each"
            )
        if not all(abs(offset) <= 2 * np.pi for offset in self.offset):
            raise RobotError(f"vendor: got offsets {self.offset}; expected angles from -2π to 2π")


@dataclass(frozen=True)
class Robot:
    """Legged robot. Joints, and with them links, are in the order of actions and observations."""

    name: str
    """Identifier, as in file names: `saturn_lite`."""
    base: Base
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    feet: tuple[Foot, ...]
    standing_height: float
    """Height of the base's frame above flat ground in the standing pose, feet touching [m]."""
    held: tuple[HeldJoint, ...] = ()
    vendor: Vendor | None = None
    mirror_names: tuple[str, ...] | None = None
    """Name of each joint's left-right image, if stated; otherwise derived (`mirror`)."""
    gait_period: float | None = None
    """Period of the gait clock, one stride, whose phase the policy observes [s]; None without a clock."""

    def __post_init__(self) -> None:
        """Reject a robot that cannot be built."""
        names = self.joint_names
        if not names or len(set(names)) != len(names) or len(self.links) != len(names):
            raise RobotError(
                f"robot {self.name!r}: {len(names)} joints {list(names)} and {len(self.links)} links; expected a link "
                "for each joint, and joints with different names"
            )
        if any(not -1 <= link.parent < number for number, link in enumerate(self.links)):
            raise RobotError(f"robot {self.name!r}: a link comes before the link that carries it")
        if len(self.feet) < 1 or len(set(self.foot_names)) != len(self.feet):
            raise RobotError(f"robot {self.name!r}: feet {list(self.foot_names)}; expected feet with different names")
        every = sorted((*names, *(joint.name for joint in self.held)))
        if self.vendor is not None and sorted(self.vendor.order) != every:
            raise RobotError(
                f"robot {self.name!r}: vendor.order is {list(self.vendor.order)}; expected each of {every} once"
            )
        axes = {**{link.name: link.axis for link in self.links}, **{joint.name: joint.axis for joint in self.held}}
        for name, axis in axes.items():
            if not abs(float(np.linalg.norm(axis)) - 1.0) < 1e-3:
                raise RobotError(f"robot {self.name!r}: axis of {name!r} is {axis}; expected unit length")
        if any(not 0 <= foot.link < len(self.links) for foot in self.feet):
            raise RobotError(
                f"robot {self.name!r}: a foot belongs to no link; expected numbers below {len(self.links)}"
            )
        groups = {foot.group for foot in self.feet}
        if groups not in ({None}, {0, 1}):
            raise RobotError(
                f"robot {self.name!r}: every foot is in contact group 0 or 1 and neither is empty, or none is"
            )
        if self.gait_period is not None:
            shortest, longest = GAIT_PERIODS
            if not shortest <= self.gait_period <= longest or (groups == {None} and len(self.feet) != 2):
                raise RobotError(
                    f"robot {self.name!r}: gait_period is {self.gait_period:g} s, with {len(self.feet)} feet; expected "
                    f"{shortest:g} to {longest:g} s, and two feet or two contact groups, which step in turn"
                )
        for joint in self.joints:
            if not joint.lower < joint.default_position < joint.upper:
                raise RobotError(
                    f"robot {self.name!r}: joint {joint.name!r} stands at {joint.default_position:g} rad, outside its "
                    f"limits [{joint.lower:g}, {joint.upper:g}]"
                )
            for name in ("torque_limit", "armature", "kp", "action_scale", "kd", "damping", "frictionloss"):
                value, positive = getattr(joint, name), name in ("torque_limit", "armature", "kp", "action_scale")
                if not 0 <= value < LARGEST or (positive and value == 0):
                    raise RobotError(
                        f"robot {self.name!r}: {name} of joint {joint.name!r} is {value:g}; expected "
                        f"{'' if positive else 'zero, or '}a positive number below {LARGEST:g}"
                    )

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(joint.name for joint in self.joints)

    @property
    def num_joints(self) -> int:
        """Number of driven joints."""
        return len(self.joints)

    @cached_property
    def joint_kinds(self) -> tuple[str, ...]:
        """Kinds of its joints, in the order of their first joint."""
        return tuple(dict.fromkeys(joint.kind for joint in self.joints))

    @property
    def foot_names(self) -> tuple[str, ...]:
        """Names of the feet."""
        return tuple(foot.name for foot in self.feet)

    @property
    def mass(self) -> float:
        """Mass of the whole robot [kg]."""
        return self.base.mass + sum(link.mass for link in self.links)

    @property
    def weight(self) -> float:
        """Weight of the whole robot [N]."""
        return self.mass * GRAVITY

    @property
    def foot_phases(self) -> np.ndarray:
        """Phase of each foot at the start of the gait clock [rad], shape (feet,): groups, or two feet, step in turn."""
        groups = self.groups()
        return np.pi * (np.arange(len(self.feet)) if groups is None else groups)

    def joint_values(self, name: str) -> np.ndarray:
        """Return one field of `Joint` for every joint, shape (num_joints,)."""
        return np.array([getattr(joint, name) for joint in self.joints])

    def joints_of(self, kind: str) -> np.ndarray:
        """Return the numbers of the joints of one kind, shape (count,).

        Raises `RobotError` for an unknown kind.
        """
        numbers = np.flatnonzero([joint.kind == kind for joint in self.joints])
        if not len(numbers):
            raise RobotError(f"robot {self.name!r}: {unknown_name('kind of joint', kind, self.joint_kinds)}")
        return numbers

    @property
    def sideways_joints(self) -> tuple[int, ...]:
        """Numbers of the joints that move a leg sideways or turn it: their axes are not across the base."""
        return tuple(number for number, link in enumerate(self.links) if abs(link.axis[1]) < 0.7)

    @property
    def action_scale(self) -> float | np.ndarray:
        """Joint angle per unit of action [rad]: one number, or one of each joint, shape (num_joints,)."""
        scales = self.joint_values("action_scale")
        return float(scales[0]) if (scales == scales[0]).all() else scales

    def groups(self) -> np.ndarray | None:
        """Return the contact group of each foot, shape (num_feet,), or None."""
        return None if self.feet[0].group is None else np.array([foot.group for foot in self.feet])

    @property
    def gait(self) -> str:
        """Name of the gait in which one contact group is on the ground; empty where no name is known."""
        return "" if self.groups() is None else GAITS.get(len(self.feet), "")

    def chain(self, link: int) -> tuple[int, ...]:
        """Return the numbers of the joints from the base to a link, see `chain_to`."""
        return chain_to(self.links, link)

    @property
    def dead_band(self) -> float:
        """Largest angle by which friction as strong as the motor holds a joint off its target, τ_max/kp [rad]."""
        return float((self.joint_values("torque_limit") / self.joint_values("kp")).max())

    def kind(self, name: str) -> Joint:
        """Return the first joint of a kind.

        Raises `RobotError` for an unknown kind.
        """
        return self.joints[self.joints_of(name)[0]]

    def with_joints(self, name: str, **factors: float) -> Robot:
        """Return a robot called `name` with fields of every joint multiplied."""
        joints = [
            replace(joint, **{key: getattr(joint, key) * value for key, value in factors.items()})
            for joint in self.joints
        ]
        return replace(self, name=name, joints=tuple(joints))


def link_poses(robot: Robot, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the frames of all links of a robot, see `tree_poses`."""
    return tree_poses(robot.links, angles)


def chain_to(links: Sequence[Link], link: int) -> tuple[int, ...]:
    """Return the numbers of the joints from the base to a link, including its joint."""
    chain = [link]
    while links[chain[0]].parent >= 0:
        chain.insert(0, links[chain[0]].parent)
    return tuple(chain)


def tree_poses(links: Sequence[Link], angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the frames of all links on the base: positions [m], (joints, 3), rotations, (joints, 3, 3).

    angles: of all joints [rad], shape (joints,).
    """
    position, rotation = np.zeros((len(links), 3)), np.zeros((len(links), 3, 3))
    for number, link in enumerate(links):
        below = (np.zeros(3), np.eye(3)) if link.parent < 0 else (position[link.parent], rotation[link.parent])
        position[number] = below[0] + below[1] @ np.array(link.origin)
        rotation[number] = below[1] @ matrix(about_vector(np.array(link.axis), float(angles[number])))
    return position, rotation


def foot_places(robot: Robot, angles: np.ndarray) -> np.ndarray:
    """Return the middles of the feet on the base [m], (feet, 3), at joint angles [rad], (joints,)."""
    position, turn = link_poses(robot, angles)
    return np.array([position[foot.link] + turn[foot.link] @ np.array(foot.position) for foot in robot.feet])


def with_standing_height(robot: Robot) -> Robot:
    """Return a robot with the height at which its lowest foot touches flat ground in the standing pose."""
    places = foot_places(robot, robot.joint_values("default_position"))
    radii = np.array([foot.radius for foot in robot.feet])
    return replace(robot, standing_height=float((radii - places[:, 2]).max()))


FALLEN_UP = 0.5
"""Minimum `uprightness` of a robot that has not fallen: its up axis is at most 60° off vertical."""

FALLEN_HEIGHT = 0.45
"""Minimum height of the base of a robot that has not fallen, as a fraction of its standing height."""


def leans_too_far(quaternion: np.ndarray) -> np.ndarray:
    """Return whether each base leans too far, bool, shape (...). `quaternion`: w, x, y, z, (..., 4)."""
    return uprightness(quaternion) < FALLEN_UP


def too_low(height: np.ndarray, standing_height: float) -> np.ndarray:
    """Return whether each base is too near the ground under it, bool, shape (...). Heights above that ground [m]."""
    return height < FALLEN_HEIGHT * standing_height
