"""Unitree Go1 in the proportions of its public description: 12 kg, 12 joints.

Torque limits are the paper's Table I; inertia and friction of every motor are the paper's Table III, measured at the
shank. Link lengths and hip positions are those of the public description; masses are rounded to the paper's 12 kg in
total. Gains: left alone in its standing pose the frictionless model topples with kp 20 and with 30 N m/rad, and
stands with 40, which is also the gain at which the paper's friction is usually turned into a dead band; kd 1 N m
s/rad.
"""

from dataclasses import replace

from stiction.robots.boxes import Box, BoxLegs, Leg, LegJoint

_HIP = LegJoint(
    torque_limit=23.7,
    armature=0.0121,
    damping=0.0342,
    frictionloss=0.0481,
    kp=40.0,
    kd=1.0,
    lower=-0.86,
    upper=0.86,
    default_position=0.0,
)

ROBOT = BoxLegs(
    name="go1",
    trunk=Box(mass=5.0, size=(0.376, 0.094, 0.114)),
    hip_link=Box(mass=0.6, size=(0.08, 0.08, 0.08)),
    thigh_link=Box(mass=0.95, size=(0.034, 0.025, 0.213)),
    shank_link=Box(mass=0.2, size=(0.016, 0.016, 0.213)),
    foot_radius=0.02,
    hip=_HIP,
    thigh=replace(_HIP, torque_limit=35.55, lower=-0.69, upper=4.5, default_position=0.9),
    shank=replace(_HIP, torque_limit=35.55, lower=-2.82, upper=-0.89, default_position=-1.65),
    legs=(
        Leg("FL", (0.188, 0.047, 0.0), group=0),
        Leg("FR", (0.188, -0.047, 0.0), group=1),
        Leg("RL", (-0.188, 0.047, 0.0), group=1),
        Leg("RR", (-0.188, -0.047, 0.0), group=0),
    ),
    action_scale=0.25,
).robot()
