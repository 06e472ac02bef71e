"""Small robot files for tests: a quadruped as MJCF, its legs as URDF, and copies of it with something broken."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import go1

LEG = """
<body name="{n}_hip" pos="{x} {y} 0"><inertial pos="0 {c} 0" mass="0.7" diaginertia="5e-4 7e-4 5e-4"/>
 <joint name="{n}_hip_joint" axis="1 0 0" range="-0.9 0.9"/>
 <body name="{n}_thigh" pos="0 {o} 0"><inertial pos="0 0 -.03" mass="1" diaginertia="5e-3 5e-3 8e-4"/>
  <joint name="{n}_thigh_joint" axis="0 1 0" range="-0.7 4.5"/>
  <geom class="seen" fromto="0 0 0 0 0 -.2" size=".02"/>
  <body name="{n}_calf" pos="0 0 -.2"><inertial pos="0 0 -.1" mass="0.2" diaginertia="1e-3 1e-3 4e-5"/>
   <joint name="{n}_calf_joint" axis="0 1 0" range="-2.8 -0.8"/>
   <geom name="{n}_shin" type="capsule" fromto="0 0 0 0 0 -.15" size=".015"/>
   <body name="{n}_foot" pos="0 0 -.2"><geom name="{n}_ball" type="sphere" size=".02" mass="0.05"/></body>
  </body></body></body>"""

CORNERS = {"FL": (0.2, 0.05), "FR": (0.2, -0.05), "RL": (-0.2, 0.05), "RR": (-0.2, -0.05)}

LEGS = "".join(
    LEG.format(n=n, x=x, y=y, c=0.01 * (1 if y > 0 else -1), o=0.08 * (1 if y > 0 else -1))
    for n, (x, y) in CORNERS.items()
)

MJCF = (
    """<mujoco model="dog"><compiler angle="radian"/><default><joint armature="0.01" damping="0.5" frictionloss="0.3"/>
<default class="seen"><geom type="capsule" contype="0" conaffinity="0"/></default></default>
<worldbody><geom type="plane" size="1 1 1"/><body name="trunk" pos="0 0 .4"><freejoint/>
<inertial pos="0 0 0" mass="6" diaginertia=".02 .07 .08"/><geom name="hull" type="box" size=".2 .05 .06"/>"""
    + LEGS
    + """</body></worldbody><actuator>"""
    + "".join(
        f'<motor joint="{n}_{kind}_joint" gear="2" ctrlrange="-12 12"/>'
        for n in CORNERS
        for kind in ("hip", "thigh", "calf")
    )
    + """</actuator><keyframe><key name="home" qpos="0 0 .33 1 0 0 0 """
    + "0 .8 -1.5 " * 4
    + """"/></keyframe></mujoco>"""
)

URDF = """<robot name="biped"><link name="pelvis"><inertial><mass value="5"/><inertia ixx=".05" iyy=".05" izz=".05"
 ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry><box size=".2 .2 .1"/></geometry></collision>
 <visual><geometry><mesh filename="package://nobody/meshes/pelvis.dae"/></geometry></visual></link>{legs}</robot>"""

URDF_LEG = """<link name="{s}_thigh"><inertial><origin xyz="0 0 -.15"/><mass value="2"/><inertia ixx=".02" iyy=".02"
 izz=".005" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{s}_hip" type="revolute"><parent link="pelvis"/><child link="{s}_thigh"/><origin xyz="0 {y} -.05"/>
 <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="60" velocity="10"/></joint>
<link name="{s}_shank"><inertial><origin xyz="0 0 -.15"/><mass value="1.5"/><inertia ixx=".01" iyy=".01" izz=".002"
 ixy="0" ixz="0" iyz="0"/></inertial><collision><origin xyz="0 0 -.3"/><geometry><box size=".2 .08 .04"/></geometry>
 </collision></link>
<joint name="{s}_knee" type="revolute"><parent link="{s}_thigh"/><child link="{s}_shank"/><origin xyz="0 0 -.3"/>
 <axis xyz="0 1 0"/><limit lower="-0.1" upper="2.5" effort="80" velocity="10"/></joint>"""


_DATA = replace(go1.DATA.base, com=(0.02, 0.0, 0.0), inertia=(*go1.DATA.base.inertia[:3], 0.0, -3e-4, 0.0))

TWIN = replace(go1.DATA, name="twin", base=_DATA, calf_is_mirrored=True).robot()
"""A Go1 whose right half is the mirror image of its left one to the last digit; all hips turn about +x."""

SIDED = replace(
    TWIN, name="sided", joints=tuple(replace(joint, kind=f"{joint.name[1]}_{joint.kind}") for joint in TWIN.joints)
)
"""The same with six kinds of joints, which know their side: L_hip, ..., R_calf."""


def urdf() -> str:
    """Return a biped with boxes for feet."""
    legs = "".join(URDF_LEG.format(s=side, y=y) for side, y in (("left", 0.1), ("right", -0.1)))
    return URDF.format(legs=legs)


def write(folder: Path, settings: str = "model: robot.xml\n", model: str = MJCF, name: str = "robot.xml") -> Path:
    """Write a model and its `robot.yaml`; return the path of the latter."""
    (folder / name).write_text(model)
    (folder / "robot.yaml").write_text(settings)
    return folder / "robot.yaml"
