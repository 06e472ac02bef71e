"""A quadruped as MJCF, with what robots' files of today vary: inertia and damping at the joint or at its actuator."""

from __future__ import annotations

CORNERS = {"FL": (0.2, 0.1), "FR": (0.2, -0.1), "RL": (-0.2, 0.1), "RR": (-0.2, -0.1)}
KINDS = {"hip": "1 0 0", "thigh": "0 1 0", "calf": "0 1 0"}
JOINTS = tuple(f"{corner}_{kind}_joint" for corner in CORNERS for kind in KINDS)


def quad(
    joint: str = 'armature="0.01"',
    actuator: str = '<motor ctrlrange="-30 30"',
    limits: tuple[float, float] = (-3.0, 3.0),
    calf: tuple[float, float] | None = None,
    trunk: float = 8.0,
    key: bool = True,
    option: str = "",
) -> str:
    """Return the model: twelve hinges, legs of 0.4 m, spheres for feet, a keyframe `home`.

    joint: attributes of every joint; actuator: begin of every actuator's element; limits, calf: of the joints and the
    calves [rad]; trunk: its mass [kg]; key: whether there is a keyframe; option: attributes of the option.
    """
    legs = "".join(_leg(name, x, y, joint, (limits, limits, calf or limits)) for name, (x, y) in CORNERS.items())
    acts = "".join(f'{actuator} name="{name.removesuffix("_joint")}" joint="{name}"/>' for name in JOINTS)
    home = f'<keyframe><key name="home" qpos="0 0 0.3 1 0 0 0{" 0 0.8 -1.6" * 4}"/></keyframe>' if key else ""
    return (
        f'<mujoco model="quad"><compiler angle="radian"/><option {option}/><worldbody>'
        f'<body name="trunk" pos="0 0 0.3"><freejoint/><inertial pos="0 0 0" mass="{trunk}" diaginertia=".05 .2 .2"/>'
        f'<geom type="box" size="0.2 0.08 0.05"/>{legs}</body></worldbody><actuator>{acts}</actuator>{home}</mujoco>'
    )


def _leg(name: str, x: float, y: float, joint: str, ranges: tuple[tuple[float, float], ...]) -> str:
    """Return the bodies of one leg."""
    hip, thigh, calf = (
        f'<joint name="{name}_{kind}_joint" axis="{axis}" range="{low} {high}" {joint}/>'
        for (kind, axis), (low, high) in zip(KINDS.items(), ranges, strict=True)
    )
    return (
        f'<body name="{name}_hip" pos="{x} {y} 0"><inertial pos="0 0 0" mass=".5" diaginertia=".001 .001 .001"/>{hip}'
        f'<body name="{name}_thigh" pos="0 {0.05 if y > 0 else -0.05} 0">'
        f'<inertial pos="0 0 -0.1" mass=".8" diaginertia=".004 .004 .001"/>{thigh}'
        f'<body name="{name}_calf" pos="0 0 -0.2"><inertial pos="0 0 -0.1" mass=".2" diaginertia=".001 .001 .0001"/>'
        f'{calf}<geom name="{name}_foot" type="sphere" size="0.02" pos="0 0 -0.2"/></body></body></body>'
    )
