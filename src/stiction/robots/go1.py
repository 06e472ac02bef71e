"""Unitree Go1 in the proportions of its public description: 12 kg, 12 joints.

Torque limits are the paper's Table I; inertia and friction of every motor are the paper's Table III, measured at the
shank. Link lengths and hip positions are those of the public description; masses are rounded to the paper's 12 kg in
total. Gains: left alone in its standing pose the frictionless model topples with kp 20 and with 30 N m/rad, and
stands with 40, which is also the gain at which the paper's friction is usually turned into a dead band; kd 1 N m
s/rad.
"""

from dataclasses import replace

from stiction.robots.model import JointSpec, LegSpec, LinkSpec, RobotSpec

_HIP = JointSpec(
    torque_limit=23.7,
    armature=0.0121,
    damping=0.0342,
    frictionloss=0.0481,
    stiffness=40.0,
    derivative=1.0,
    lower=-0.86,
    upper=0.86,
    standing=0.0,
)

ROBOT = RobotSpec(
    name="go1",
    base=LinkSpec(mass=5.0, size=(0.376, 0.094, 0.114)),
    hip_link=LinkSpec(mass=0.6, size=(0.08, 0.08, 0.08)),
    thigh_link=LinkSpec(mass=0.95, size=(0.034, 0.025, 0.213)),
    shank_link=LinkSpec(mass=0.2, size=(0.016, 0.016, 0.213)),
    foot_radius=0.02,
    hip=_HIP,
    thigh=replace(_HIP, torque_limit=35.55, lower=-0.69, upper=4.5, standing=0.9),
    shank=replace(_HIP, torque_limit=35.55, lower=-2.82, upper=-0.89, standing=-1.65),
    legs=(
        LegSpec("FL", (0.188, 0.047, 0.0), group=0),
        LegSpec("FR", (0.188, -0.047, 0.0), group=1),
        LegSpec("RL", (-0.188, 0.047, 0.0), group=1),
        LegSpec("RR", (-0.188, -0.047, 0.0), group=0),
    ),
    action_scale=0.25,
)
