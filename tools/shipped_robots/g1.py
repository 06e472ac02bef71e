"""Unitree G1 with 29 joints: 33.3 kg; its 12 leg joints are driven, waist and arms are held.

Names, order, axes and zero pose are the maker's; masses, centres, inertias, lengths, limits and torque limits are those
of its public description (`g1_description` of `unitree_ros`, BSD-3-Clause), rotor inertias those that mjlab computes
from the maker's gear ratios (Apache-2.0). Gains and crouch of the legs are those of the maker's training examples
(`unitree_rl_gym`); the arms hang as in mjlab's standing pose. The sole is a box of the extent of the description's
contact points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from boxes import reflect

from stiction.robots.hold import hold
from stiction.robots.model import Base, Foot, Joint, Link, Robot, Vendor, with_standing_height
from stiction.robots.shapes import Shape, Vector

Moments = tuple[float, float, float, float, float, float]

TILT = 0.1749
"""Angle by which the hip's roll and yaw axes lean in the zero pose [rad]."""

FORWARD: Vector = (float(np.cos(TILT)), 0.0, float(np.sin(TILT)))
UPWARD: Vector = (-float(np.sin(TILT)), 0.0, float(np.cos(TILT)))
SHOULDER: Vector = (0.000199, 0.9612505, 0.2756757)
X: Vector = (1.0, 0.0, 0.0)
Y: Vector = (0.0, 1.0, 0.0)
Z: Vector = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Motor:
    """One of the maker's motors at a joint."""

    torque_limit: float
    """[N m]."""
    armature: float
    """[kg m²]."""


SMALL = Motor(25.0, 0.003609725)
WRIST = Motor(5.0, 0.00425)
LARGE = Motor(88.0, 0.010177520)
STRONG = Motor(139.0, 0.025101925)
PAIR = Motor(50.0, 2 * 0.003609725)
"""Two small motors that move ankle or waist together."""


@dataclass(frozen=True)
class Part:
    """A joint and its link: kind, motor, limits [rad], angle [rad], kp and kd, then the link in the zero pose."""

    kind: str
    motor: Motor
    limits: tuple[float, float]
    angle: float
    gains: tuple[float, float]
    origin: Vector
    axis: Vector
    mass: float
    com: Vector
    inertia: Moments
    radius: float = 0.0
    """Radius of the visible capsule [m]; 0: no capsule."""


LEG = (
    Part("hip_pitch", LARGE, (-2.5307, 2.8798), -0.1, (100.0, 2.0), (0.0, 0.064452, -0.1027), Y,
         1.35, (0.002741, 0.047791, -0.02606),
         (1.811e-3, 1.4193e-3, 1.2812e-3, 3.68e-5, -3.44e-5, 1.71e-4)),
    Part("hip_roll", STRONG, (-0.5236, 2.9671), 0.0, (100.0, 2.0), (0.0, 0.052, -0.030465), FORWARD,
         1.52, (0.0446586, -0.001045, -0.0814049),
         (2.4895e-3, 2.4123e-3, 1.54731e-3, -6.944e-6, -2.44135e-4, 1.74581e-5)),
    Part("hip_yaw", LARGE, (-2.7576, 2.7576), 0.0, (100.0, 2.0), (0.046218, 0.0, -0.117876), UPWARD,
         1.702, (-0.0305914, -0.010981, -0.1585216),
         (6.51853e-3, 7.6124e-3, 2.40786e-3, -4.09786e-4, -1.79939e-3, -7.9057e-4), 0.05),
    Part("knee", STRONG, (-0.087267, 2.8798), 0.3, (150.0, 4.0), (-0.04622, 0.002149, -0.188255), Y,
         1.932, (0.005457, 0.003964, -0.12074),
         (1.1329e-2, 1.1277e-2, 1.5168e-3, 4.81665e-5, -4.48975e-5, -7.146e-4), 0.045),
    Part("ankle_pitch", PAIR, (-0.87267, 0.5236), -0.2, (40.0, 2.0), (0.0, -0.000094, -0.30001), Y,
         0.074, (-0.007269, 0.0, 0.011137),
         (8.4e-6, 1.89e-5, 1.26e-5, 0.0, -2.9e-6, 0.0)),
    Part("ankle_roll", PAIR, (-0.2618, 0.2618), 0.0, (40.0, 2.0), (0.0, 0.0, -0.017558), X,
         0.608, (0.026505, 0.0, -0.016425),
         (2.231e-4, 1.6161e-3, 1.6667e-3, 2e-7, 8.91e-5, -1e-7)),
)  # fmt: skip

WAIST = (
    Part("waist_yaw", LARGE, (-2.618, 2.618), 0.0, (100.0, 2.0), (0.0, 0.0, 0.0), Z,
         0.214, (0.003494, 0.000233, 0.018034),
         (1.0673e-4, 1.0422e-4, 1.625e-4, 2.703e-6, -7.631e-6, -2.01e-7)),
    Part("waist_roll", PAIR, (-0.52, 0.52), 0.0, (100.0, 2.0), (-0.003964, 0.0, 0.044), X,
         0.086, (0.0, 2.3e-5, 0.0),
         (7.079e-6, 6.339e-6, 8.245e-6, 0.0, 0.0, 0.0)),
    Part("waist_pitch", PAIR, (-0.52, 0.52), 0.0, (100.0, 2.0), (0.0, 0.0, 0.0), Y,
         7.818, (0.0020316, 0.0003397, 0.184568),
         (0.121698, 0.109825, 0.027522, 3.11e-5, -3.74229e-3, -1.55e-5)),
)  # fmt: skip

ARM = (
    Part("shoulder_pitch", SMALL, (-3.0892, 2.6704), 0.2, (40.0, 2.0), (0.003956, 0.10022, 0.24778), SHOULDER,
         0.718, (7.2e-6, 0.0377068, -0.0012822),
         (4.29096e-4, 4.38746e-4, 4.37258e-4, -1.06045e-5, 3.621e-6, 2.71148e-5)),
    Part("shoulder_roll", SMALL, (-1.5882, 2.2515), 0.2, (40.0, 2.0), (8e-6, 0.04034, -0.002819), X,
         0.643, (-0.0002291, 0.0072737, -0.0632426),
         (6.177e-4, 6.91201e-4, 3.89398e-4, -9.868e-7, 8.686e-6, -5.284e-6)),
    Part("shoulder_yaw", SMALL, (-2.618, 2.618), 0.0, (40.0, 2.0), (-4e-6, 0.006246, -0.1032), Z,
         0.734, (0.0107685, -0.0029468, -0.0720098),
         (9.98822e-4, 1.0605e-3, 4.35382e-4, 7.902e-6, 1.41165e-4, -2.85908e-5), 0.035),
    Part("elbow", SMALL, (-1.0472, 2.0944), 1.28, (40.0, 2.0), (0.015779, 2e-6, -0.080519), Y,
         0.6, (0.0649563, 0.0044421, -0.0100653),
         (2.89127e-4, 4.15176e-4, 4.19698e-4, 6.5323e-5, 1.721e-5, -5.607e-6)),
    Part("wrist_roll", SMALL, (-1.97222, 1.97222), 0.0, (20.0, 1.0), (0.1, 0.001869, -0.010005), X,
         0.085445, (0.0171395, 0.0005343, -4e-7),
         (4.82138e-5, 3.72306e-5, 5.48211e-5, -4.247e-6, 0.0, 0.0)),
    Part("wrist_pitch", WRIST, (-1.61443, 1.61443), 0.0, (20.0, 1.0), (0.038, -7e-6, -2e-6), Y,
         0.48405, (0.0229996, -0.0011212, -0.0011179),
         (1.65793e-4, 4.29545e-4, 4.29536e-4, -1.22622e-5, 1.23309e-5, 8.126e-7)),
    Part("wrist_yaw", WRIST, (-1.61443, 1.61443), 0.0, (20.0, 1.0), (0.046, -9e-6, -3e-6), Z,
         0.254576, (0.0708245, 0.0001781, 0.0016135),
         (1.50459e-4, 6.43099e-4, 5.60114e-4, 3.76977e-5, -2.929e-6, 3.779e-6)),
)  # fmt: skip

SOLE = Shape("box", (0.085, 0.03, 0.005), (0.035, 0.0, -0.03), contact="ground", color=(0.9, 0.45, 0.15))
"""Contact shape of the sole."""

MIRRORED_AXES = ("roll", "yaw")
"""Motors of these names turn left and right limbs about the same direction; so do those of pitch."""


def _chain(side: str, parts: tuple[Part, ...], parent: int, first: int) -> tuple[list[Link], list[Joint]]:
    """Return links and joints of a limb, or of the waist (side ''), whose first link is number `first`."""
    links, joints = [], []
    for number, part in enumerate(parts):
        name = f"{side}_{part.kind}" if side else part.kind
        # The knuckle's own axis is mirrored as a direction, so that all motors of a kind point the same way.
        right = side == "right"
        axis = (part.axis[0], part.axis[1], part.axis[2])
        if right and part.kind == "shoulder_pitch":
            axis = (-axis[0], axis[1], -axis[2])
        down = parts[number + 1].origin if number + 1 < len(parts) else None
        bone = _bone(down, part.radius) if down and part.radius else ()
        link = Link(
            name=f"{name}_link",
            parent=parent if number == 0 else first + number - 1,
            origin=part.origin,
            axis=axis,
            mass=part.mass,
            com=part.com,
            inertia=part.inertia,
            shapes=bone,
        )
        links.append(replace(reflect(link, y=True), shapes=bone) if right else link)
        opens = part.kind.endswith(MIRRORED_AXES)
        lower, upper = (-part.limits[1], -part.limits[0]) if right and opens else part.limits
        kp, kd = part.gains
        joints.append(
            Joint(
                name=f"{name}_joint",
                kind=part.kind,
                torque_limit=part.motor.torque_limit,
                armature=part.motor.armature,
                damping=0.0,
                frictionloss=0.0,
                kp=kp,
                kd=kd,
                lower=lower,
                upper=upper,
                default_position=-part.angle if right and opens else part.angle,
                action_scale=0.25,
            )
        )
    return links, joints


def _bone(end: Vector, radius: float) -> tuple[Shape, ...]:
    """Return a capsule straight down along a link whose next joint is at `end`."""
    half = max(-end[2] / 2 - radius / 2, 0.01)
    return (Shape("capsule", (radius, half, 0.0), (end[0] / 2, 0.0, end[2] / 2), color=(0.45, 0.5, 0.56)),)


def whole() -> Robot:
    """Return the robot with all 29 joints driven."""
    links: list[Link] = []
    joints: list[Joint] = []
    for side, parts, parent in (("left", LEG, -1), ("right", LEG, -1), ("", WAIST, -1), ("left", ARM, 14), ("right", ARM, 14)):  # fmt: skip  # noqa: E501
        more = _chain(side, parts, parent, len(links))
        links += more[0]
        joints += more[1]
    torso = Shape("box", (0.09, 0.11, 0.2), (0.0, 0.0, 0.2), color=(0.82, 0.84, 0.86))
    links[14] = replace(links[14], shapes=(torso,))
    pelvis = Shape("box", (0.07, 0.07, 0.07), (0.0, 0.0, -0.08), contact="ground", color=(0.82, 0.84, 0.86))
    names = tuple(joint.name for joint in joints)
    feet = tuple(
        Foot(f"{side}_foot", link, SOLE.position, SOLE.size[2], (SOLE,)) for side, link in (("left", 5), ("right", 11))
    )
    robot = Robot(
        name="g1",
        base=Base(
            mass=3.813,
            com=(0.0, 0.0, -0.07605),
            inertia=(0.010549, 0.0093089, 0.0079184, 0.0, 2.1e-6, 0.0),
            shapes=(pelvis,),
            size=(0.14, 0.14, 0.14),
            center=(0.0, 0.0, -0.08),
        ),
        links=tuple(links),
        joints=tuple(joints),
        feet=feet,
        standing_height=1.0,
        vendor=Vendor(names, (1.0,) * len(names), (0.0,) * len(names)),
    )
    return with_standing_height(robot)


def _legs_driven(robot: Robot) -> Robot:
    """Return the robot with waist and arms rigid in the pose."""
    kinds = {part.kind for part in LEG}
    return hold(robot, {joint.name: joint.default_position for joint in robot.joints if joint.kind not in kinds})


ROBOT = _legs_driven(whole())
