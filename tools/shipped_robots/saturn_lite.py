"""Saturn Lite, the paper's hexapod: 32 kg, 18 joints.

The paper gives the mass, the torque limits (Table I) and the shank motor's inertia, viscous and dry friction (Table
III). It gives neither geometry, nor gains, nor the other joints' friction. Those are ours, with these reasons:

* Geometry. A trunk of 0.70 m with a leg pair every 0.31 m, legs of 0.22 + 0.24 m: the reach that lets a 45 N m shank
  carry a third of the weight in the standing crouch at 40 % of its limit, as a machine built for stairs would.
* Masses. 2.6 kg a leg, its motors near the trunk (hip and thigh links carry them); the trunk, with the batteries that
  buy the paper's two hours, has the rest.
* Hip and thigh motors. Table I gives them 25 N m against 45 N m. Same family, so inertia and viscous friction as
  measured at the shank; dry friction 0.25 N m, the same fraction of the limit as the shank's (0.98 %).
* Gains. With kp 60 N m/rad the machine, left alone in its standing pose and without friction, sags 0.37 rad and
  pitches up by 0.17 rad: its weight nearly outruns the springs. kp 100 holds it within 0.15 rad. kd 2.5 N m s/rad
  damps the unloaded leg to about half of critical. Both were set with no friction in the joints and are the same for
  every training method.
* Standing pose. Feet 2 cm behind the hip joints, under the centre of mass (the knees point backward).
"""

from dataclasses import replace

from boxes import Box, BoxLegs, Leg

from stiction.robots.model import Joint

_HIP = Joint(
    name="",
    kind="hip",
    torque_limit=25.0,
    armature=0.0145,
    damping=0.0704,
    frictionloss=0.25,
    kp=100.0,
    kd=2.5,
    lower=-0.8,
    upper=0.8,
    default_position=0.0,
    action_scale=0.25,
)

BOXES = BoxLegs(
    name="saturn_lite",
    trunk=Box(mass=16.4, size=(0.70, 0.26, 0.14)),
    hip_link=Box(mass=0.9, size=(0.10, 0.08, 0.10)),
    thigh_link=Box(mass=1.3, size=(0.06, 0.05, 0.22)),
    shank_link=Box(mass=0.4, size=(0.035, 0.035, 0.24)),
    foot_radius=0.025,
    hip=_HIP,
    thigh=replace(_HIP, lower=-0.6, upper=2.4, default_position=0.85),
    shank=replace(_HIP, torque_limit=45.0, frictionloss=0.442, lower=-2.6, upper=-0.4, default_position=-1.5),
    legs=(
        Leg("FL", (0.31, 0.11, 0.0), group=0),
        Leg("FR", (0.31, -0.11, 0.0), group=1),
        Leg("ML", (0.0, 0.15, 0.0), group=1),
        Leg("MR", (0.0, -0.15, 0.0), group=0),
        Leg("RL", (-0.31, 0.11, 0.0), group=0),
        Leg("RR", (-0.31, -0.11, 0.0), group=1),
    ),
)

ROBOT = BOXES.robot()
