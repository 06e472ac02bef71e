"""Unitree Go1: 12.7 kg, 12 joints, in the maker's axes, zero pose, names and order (FR, FL, RR, RL).

Masses, centres, inertias, lengths and limits are those of the maker's public description (`go1_description` of
`unitree_ros`, BSD-3-Clause); torque limits are the paper's Table I; inertia and friction of every motor are the paper's
Table III, measured at the shank. Gains: left alone in its standing pose the frictionless robot sags with kp 20 N m/rad
and stands with 40, at which the paper's friction is usually turned into a dead band; kd 1 N m s/rad.
"""

from dataclasses import replace

from quadruped import Quadruped, Segment

from stiction.robots.model import Base, Joint

_HIP = Joint(
    name="",
    kind="hip",
    torque_limit=23.7,
    armature=0.0121,
    damping=0.0342,
    frictionloss=0.0481,
    kp=40.0,
    kd=1.0,
    lower=-0.863,
    upper=0.863,
    default_position=0.0,
    action_scale=0.25,
)

DATA = Quadruped(
    name="go1",
    base=Base(
        mass=5.204,
        com=(0.0223, 0.002, -0.0005),
        inertia=(0.0168128, 0.0630095, 0.0716547, -2.29676e-4, -2.94553e-4, -4.18733e-5),
        size=(0.3762, 0.0935, 0.114),
    ),
    hip=Segment(
        origin=(0.1881, 0.04675, 0.0),
        mass=0.68,
        com=(-0.0049166, -0.0076261, -8.86e-5),
        inertia=(3.9938e-4, 7.33419e-4, 4.68422e-4, -1.45897e-5, 1.24609e-6, 1.57518e-6),
    ),
    thigh=Segment(
        origin=(0.0, 0.08, 0.0),
        mass=1.009,
        com=(-0.0030472, -0.019315, -0.0305004),
        inertia=(4.5988e-3, 4.68922e-3, 8.17448e-4, 6.13737e-5, -2.2753e-4, 6.10808e-4),
    ),
    calf=Segment(
        origin=(0.0, 0.0, -0.213),
        mass=0.195862,
        com=(0.0042986, 0.0009767, -0.146197),
        inertia=(1.48449e-3, 1.49764e-3, 3.60682e-5, -6.18625e-7, -1.772e-5, -3.56628e-6),
    ),
    calf_is_mirrored=False,
    foot=(0.0, 0.0, -0.213),
    foot_radius=0.023,
    joints=(
        _HIP,
        replace(_HIP, kind="thigh", torque_limit=35.55, lower=-0.686, upper=4.501, default_position=0.9),
        replace(_HIP, kind="calf", torque_limit=35.55, lower=-2.818, upper=-0.888, default_position=-1.65),
    ),
)

ROBOT = DATA.robot()
