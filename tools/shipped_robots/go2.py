"""Unitree Go2: 15.2 kg, 12 joints, in the maker's axes, zero pose, names and order (FR, FL, RR, RL).

Masses, centres, inertias, lengths, limits and torque limits are those of the maker's public description
(`go2_description` of `unitree_ros`, BSD-3-Clause); rotor inertia and gains of the maker's model for simulation
(`unitree_mujoco`: armature 0.01 kg m²) and of its training examples (`unitree_rl_gym`: kp 20 N m/rad, kd 0.5), the
gains doubled as for the Go1, of the same legs. Friction is what `stiction identify` finds on a robot; here is none.
"""

from dataclasses import replace

from quadruped import Quadruped, Segment

from stiction.robots.model import Base, Joint

_HIP = Joint(
    name="",
    kind="hip",
    torque_limit=23.7,
    armature=0.01,
    damping=0.0,
    frictionloss=0.0,
    kp=40.0,
    kd=1.0,
    lower=-1.0472,
    upper=1.0472,
    default_position=0.0,
    action_scale=0.25,
)

ROBOT = Quadruped(
    name="go2",
    base=Base(
        mass=6.921,
        com=(0.021112, 0.0, -0.005366),
        inertia=(0.02448, 0.098077, 0.107, 1.2166e-4, 1.4849e-3, -3.12e-5),
        size=(0.3762, 0.0935, 0.114),
    ),
    hip=Segment(
        origin=(0.1934, 0.0465, 0.0),
        mass=0.678,
        com=(-0.0054, 0.00194, -0.000105),
        inertia=(4.8e-4, 8.84e-4, 5.96e-4, -3.01e-6, 1.11e-6, -1.42e-6),
    ),
    thigh=Segment(
        origin=(0.0, 0.0955, 0.0),
        mass=1.152,
        com=(-0.00374, -0.0223, -0.0327),
        inertia=(5.84e-3, 5.8e-3, 1.03e-3, 8.72e-5, -2.89e-4, 8.08e-4),
    ),
    calf=Segment(
        origin=(0.0, 0.0, -0.213),
        mass=0.241352,
        com=(0.0062959, -0.0006221, -0.141417),
        inertia=(1.46354e-3, 1.48999e-3, 5.32693e-5, 2.17545e-7, 5.96681e-6, 1.22479e-5),
    ),
    calf_is_mirrored=True,
    foot=(-0.002, 0.0, -0.213),
    foot_radius=0.022,
    joints=(
        _HIP,
        replace(_HIP, kind="thigh", lower=-1.5708, upper=3.4907, default_position=0.8),
        replace(_HIP, kind="calf", torque_limit=45.43, lower=-2.7227, upper=-0.83776, default_position=-1.5),
    ),
    rear_thigh_limits=(-0.5236, 4.5379),
).robot()
