"""From a `RobotSpec` to a MuJoCo model. The only module of this room that imports mujoco.

Every joint has a `position` actuator of the same name, in the order of `RobotSpec.joint_names`; every foot has a touch
sensor (normal force, N). On request every joint also has a force and a torque sensor, after those of the feet. Dry
friction is the solver's `frictionloss`, set stiff enough to hold, or a slider (see `robots.physics`).
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from stiction.robots.model import DELAY_SAMPLES, JointSpec, LegSpec, RobotSpec, box_inertia
from stiction.robots.physics import EXACT, SMALLEST_YIELD, PhysicsCfg
from stiction.robots.tree import SHANK_RADIUS, THIGH_RADIUS, foot_position, links

Color = tuple[float, float, float]

TRUNK: Color = (0.82, 0.84, 0.86)
THIGH: Color = (0.25, 0.3, 0.36)
SHANK: Color = (0.55, 0.6, 0.66)

FEET: tuple[Color, Color] = ((0.9, 0.45, 0.15), (0.15, 0.5, 0.85))
"""By contact group."""

STONES: tuple[Color, Color] = ((0.80, 0.81, 0.77), (0.72, 0.74, 0.70))
"""Of the boxes of a course, by turns."""

SOLVERS = {"newton": mujoco.mjtSolver.mjSOL_NEWTON, "pgs": mujoco.mjtSolver.mjSOL_PGS}
"""MuJoCo's solvers by the names of `PhysicsCfg`."""


def _friction(joint: JointSpec, timestep: float, physics: PhysicsCfg) -> dict[str, Any]:
    """Return what makes a joint's dry friction, as fields of `MjsJoint`."""
    if physics.plastic:
        # The angle in the state `plastic` is the one at which the spring is slack: its reference is zero.
        return {
            "stiffness": np.array([physics.stiffness, 0.0, 0.0]),
            "springref": 0.0,
            "springyield": max(joint.frictionloss / physics.stiffness, SMALLEST_YIELD),
        }
    return {
        "frictionloss": joint.frictionloss,
        "solref_friction": [2 * timestep, 1.0],
        "solimp_friction": [physics.impedance, physics.impedance, 0.001, 0.5, 2.0],
    }


def _add_links(
    spec: mujoco.MjSpec, base: mujoco.MjsBody, robot: RobotSpec, physics: PhysicsCfg
) -> list[mujoco.MjsBody]:
    """Add the bodies of all legs, with their joints; return them in the order of the joints."""
    bodies: list[mujoco.MjsBody] = []
    kinds = (robot.hip, robot.thigh, robot.shank) * len(robot.legs)
    for link, joint in zip(links(robot), kinds, strict=True):
        body = (bodies[link.parent] if link.parent >= 0 else base).add_body(
            name=link.name,
            pos=link.origin,
            mass=link.mass,
            ipos=link.com,
            inertia=link.inertia,
            explicitinertial=True,
        )
        body.add_joint(
            name=link.joint,
            axis=link.axis,
            range=[joint.lower, joint.upper],
            limited=mujoco.mjtLimited.mjLIMITED_TRUE,
            armature=joint.armature,
            damping=np.array([joint.damping, 0.0, 0.0]),
            **_friction(joint, spec.option.timestep, physics),
        )
        bodies.append(body)
    return bodies


def _add_shapes(
    spec: mujoco.MjSpec, thigh: mujoco.MjsBody, shank: mujoco.MjsBody, robot: RobotSpec, leg: LegSpec
) -> None:
    """Add what is seen and touched of one leg, and its foot's sensor."""
    knee, foot = [0.0, 0.0, -robot.thigh_link.size[2]], foot_position(robot)
    visual = {"type": mujoco.mjtGeom.mjGEOM_CAPSULE, "contype": 0, "conaffinity": 0}
    thigh.add_geom(size=[THIGH_RADIUS, 0, 0], fromto=[0, 0, 0, *knee], rgba=[*THIGH, 1], **visual)
    visual["contype"] = OBSTACLE
    shank.add_geom(size=[SHANK_RADIUS, 0, 0], fromto=[0, 0, 0, *foot], rgba=[*SHANK, 1], **visual)
    shank.add_geom(
        name=f"{leg.name}_foot",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[robot.foot_radius, 0, 0],
        pos=foot,
        rgba=[*FEET[leg.group], 1],
        priority=1,
        friction=[1.0, 0.005, 0.0001],
    )
    shank.add_site(name=f"{leg.name}_foot", size=[1.2 * robot.foot_radius, 0, 0], pos=foot, group=4)
    spec.add_sensor(
        name=f"{leg.name}_touch",
        type=mujoco.mjtSensor.mjSENS_TOUCH,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=f"{leg.name}_foot",
    )


GROUND, OBSTACLE = 1, 2
"""Collision bits: feet and trunk touch the plane, obstacles and each other, shanks obstacles alone, thighs nothing."""


def build(
    robot: RobotSpec,
    timestep: float = 0.005,
    obstacles: np.ndarray | None = None,
    joint_sensors: bool = False,
    physics: PhysicsCfg = EXACT,
) -> mujoco.MjSpec:
    """Return the robot on the ground as an `MjSpec`, its base free, in its standing pose (keyframe 0).

    `timestep`: physics step [s]; `obstacles`: half sizes of boxes [m], (boxes, 3), parked far below until somebody
    places them; `joint_sensors`: measure what every joint transmits, see `_add_joint_sensors`; `physics`: of dry
    friction. On the plane only feet and trunk touch the ground; a shank can catch on the edge of a box.
    """
    spec = mujoco.MjSpec()
    spec.modelname = robot.name
    spec.compiler.degree = False
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_AUTORESET
    spec.option.solver = SOLVERS[physics.solver_name]
    spec.option.iterations = physics.solver_iterations
    _add_scene(spec)
    _add_obstacles(spec, np.zeros((0, 3)) if obstacles is None else obstacles)
    base = spec.worldbody.add_body(
        name="base",
        pos=[0, 0, robot.standing_height],
        mass=robot.base.mass,
        ipos=[0.0, 0.0, 0.0],
        inertia=box_inertia(robot.base.mass, robot.base.size),
        explicitinertial=True,
    )
    base.add_freejoint(name="root")
    base.add_geom(
        name="base",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[extent / 2 for extent in robot.base.size],
        rgba=[*TRUNK, 1],
    )
    bodies = _add_links(spec, base, robot, physics)
    for leg, thigh, shank in zip(robot.legs, bodies[1::3], bodies[2::3], strict=True):
        _add_shapes(spec, thigh, shank, robot, leg)
    if joint_sensors:
        _add_joint_sensors(spec, robot)
    _add_actuators(spec, robot)
    standing = robot.joint_values("standing")
    slack = {"plastic": standing} if physics.plastic else {}
    spec.add_key(name="standing", qpos=[0, 0, robot.standing_height, 1, 0, 0, 0, *standing], ctrl=standing, **slack)
    return spec


def _add_joint_sensors(spec: mujoco.MjSpec, robot: RobotSpec) -> None:
    """Add sensors of force [N] and torque [N m] between each joint's two links, joint by joint, three axes each.

    The torque is about the centre of mass of the link behind the joint: there PhysX takes it for its joint friction
    (`stiction.sim.friction`).
    """
    for name in robot.joint_names:
        link = spec.joint(name).parent
        link.add_site(name=f"{name}_load", pos=link.ipos, size=[0.01, 0, 0], group=4)
        for kind, quantity in (("force", mujoco.mjtSensor.mjSENS_FORCE), ("torque", mujoco.mjtSensor.mjSENS_TORQUE)):
            spec.add_sensor(
                name=f"{name}_{kind}", type=quantity, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=f"{name}_load"
            )


def _add_scene(spec: mujoco.MjSpec) -> None:
    """Add ground, light and the offscreen size."""
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 960, 720
    spec.add_texture(
        name="grid",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.93, 0.93, 0.91],
        rgb2=[0.84, 0.85, 0.84],
        width=256,
        height=256,
    )
    material = spec.add_material(name="grid", texrepeat=[2, 2], texuniform=True)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "grid"
    spec.worldbody.add_light(pos=[0, 0, 4], dir=[0.2, 0.2, -1], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.5], material="grid")


def _add_obstacles(spec: mujoco.MjSpec, half_sizes: np.ndarray) -> None:
    """Add boxes that each simulation puts where it wants.

    MuJoCo sorts the boxes of a body into a tree when it compiles, which knows nothing of later places: it is left out.
    And it takes a box that is not turned when it compiles for one that never is: these are, about z.
    """
    for number, half in enumerate(half_sizes):
        spec.worldbody.add_geom(
            name=f"obstacle{number}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=half,
            pos=[0.0, 0.0, -10.0],
            quat=[0.8, 0.0, 0.0, 0.6],
            contype=OBSTACLE,
            conaffinity=GROUND | OBSTACLE,
            rgba=[*STONES[number % 2], 1],
        )
    if len(half_sizes):
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE


def _add_actuators(spec: mujoco.MjSpec, robot: RobotSpec) -> None:
    """Add one PD position actuator per joint, limited to the motor's torque."""
    rows = zip(
        robot.joint_names,
        robot.joint_values("stiffness"),
        robot.joint_values("derivative"),
        robot.joint_values("torque_limit"),
        strict=True,
    )
    for name, kp, kd, limit in rows:
        spec.add_actuator(
            name=name,
            target=name,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            gaintype=mujoco.mjtGain.mjGAIN_FIXED,
            biastype=mujoco.mjtBias.mjBIAS_AFFINE,
            gainprm=[kp, *[0.0] * 9],
            biasprm=[0.0, -kp, -kd, *[0.0] * 7],
            forcerange=[-limit, limit],
            forcelimited=mujoco.mjtLimited.mjLIMITED_TRUE,
            nsample=DELAY_SAMPLES,
        )


def build_model(
    robot: RobotSpec,
    timestep: float = 0.005,
    obstacles: np.ndarray | None = None,
    joint_sensors: bool = False,
    physics: PhysicsCfg = EXACT,
) -> mujoco.MjModel:
    """Return the compiled model of `build`."""
    return build(robot, timestep, obstacles, joint_sensors, physics).compile()
